# SPDX-License-Identifier: Apache-2.0
"""Writing an export, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from hil.atomic import write_whole
from hil.exchange import csv_files, hdf5_file, mcap_file, npz_file, parquet_files
from hil.exchange.table import Contents, ExchangeError
from hil.process import scratch

FORMATS: Final = ("csv", "npz", "hdf5", "parquet", "mcap")
FOLDERS: Final = ("csv", "parquet")
"""Formats that hold one table in a file: they become a folder."""


def write(contents: Contents, form: str, path: Path) -> None:
    """Write ``contents`` to the file or, for one of :data:`FOLDERS`, the new folder ``path``.

    Raises:
        ExchangeError: the folder is there already, or it cannot be written.
    """
    try:
        if form in FOLDERS:
            _folder(path, contents, csv_files.write if form == "csv" else parquet_files.write)
        elif form == "hdf5":
            with scratch("export") as place:
                file = place / "export.hdf5"
                hdf5_file.write(contents, file)
                write_whole(path, file.read_bytes())
        else:
            made = npz_file.as_npz if form == "npz" else mcap_file.as_mcap
            write_whole(path, made(contents))
    except OSError as error:
        raise ExchangeError(
            f"{path}: cannot be written: {error.strerror or error}",
            "name a place that you may write to, with room: hil export RECORDING -o FILE",
        ) from error


def _folder(path: Path, contents: Contents, write_into: Callable[[Contents, Path], None]) -> None:
    if path.exists() or path.is_symlink():
        raise ExchangeError(
            f"{path}: is there already, and these formats make a folder",
            "name a folder that is not there, or delete it first",
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    with scratch("export", path.parent) as temporary:
        whole = temporary / path.name
        whole.mkdir()
        write_into(contents, whole)
        whole.rename(path)
