# SPDX-License-Identifier: Apache-2.0
"""NumPy's .npz without pickle: headers are held against the sizes of their members first."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from hil.exchange.sheets import BYTES_MAX, SENSORS, RefusedError, Sheet, check_claim, columns_of

MEMBERS_MAX: Final = 1024
HEADER_MAX: Final = 10_000
HEAD_BYTES: Final = HEADER_MAX + 16


def read(path: Path) -> list[Sheet]:
    """The arrays of one sensor, or of the sensors' tables of an export.

    Raises:
        RefusedError: no archive, a member that claims other than it holds, or too much of anything.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _sheets(path, archive)
    except (zipfile.BadZipFile, EOFError, NotImplementedError, ValueError, RuntimeError) as error:
        raise RefusedError(
            f"{path}: not a whole .npz: {error}", "save it with numpy.savez"
        ) from error
    except Exception as error:  # zlib.error and what else a damaged member may raise
        if isinstance(error, RefusedError):
            raise
        raise RefusedError(
            f"{path}: not a whole .npz: {error}", "save it with numpy.savez"
        ) from error


def _sheets(path: Path, archive: zipfile.ZipFile) -> list[Sheet]:
    members = archive.infolist()
    if len(members) > MEMBERS_MAX:
        raise RefusedError(f"{path}: {len(members)} members, the limit is {MEMBERS_MAX}")
    by_name = {m.filename.removesuffix(".npy"): m for m in members if m.filename.endswith(".npy")}
    found = []
    for table in SENSORS:
        own = {
            n.removeprefix(f"{table}/"): m for n, m in by_name.items() if n.startswith(f"{table}/")
        }
        if own:
            found.append(_sheet(f"{path}, {table}", archive, own))
    return found or [_sheet(str(path), archive, by_name)]


def _sheet(where: str, archive: zipfile.ZipFile, members: Mapping[str, zipfile.ZipInfo]) -> Sheet:
    held = sum(m.file_size for m in members.values())
    if held > BYTES_MAX:
        raise RefusedError(
            f"{where}: {held} bytes unpacked, the limit is {BYTES_MAX}", "cut it to one set"
        )
    claims = {name: _claim(where, name, archive, member) for name, member in members.items()}
    usable = {n: c for n, c in claims.items() if c[1].kind in "fiub" and c[1].itemsize <= 8}
    check_claim(where, {name: shape for name, (shape, _, _, _) in usable.items()})
    arrays: dict[str, NDArray[Any]] = {}
    attributes: dict[str, Any] = {}
    for name, (shape, dtype, fortran, begins) in usable.items():
        data = archive.read(members[name])[begins:]
        values = np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
        if values.ndim == 0:
            attributes[name] = values.item()
        else:
            arrays[name] = values
    texts = [name for name in claims if name not in usable]
    return Sheet(where, columns_of(arrays), None, attributes | {"texts": texts})


def _claim(
    where: str, name: str, archive: zipfile.ZipFile, member: zipfile.ZipInfo
) -> tuple[tuple[int, ...], np.dtype[Any], bool, int]:
    """Shape, type, order of a member and where its numbers begin.

    Raises:
        RefusedError: a header that does not fit the size, or objects, which only pickle could read.
    """
    with archive.open(member) as stream:
        try:
            version = npy.read_magic(stream)
            reads = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
            if version not in reads:
                raise RefusedError(f"{where}: '{name[:100]}' has version {version} of .npy")
            shape, fortran, dtype = reads[version](stream, max_header_size=HEADER_MAX)
        except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
            raise RefusedError(
                f"{where}: '{name[:100]}' is no array: {str(error).splitlines()[0][:200]}",
                "save it with numpy.savez",
            ) from error
        begins = stream.tell()
    if dtype.hasobject:
        raise RefusedError(
            f"{where}: '{name[:100]}' holds Python objects, which are never unpickled",
            "save arrays of numbers: numpy.savez with allow_pickle=False",
        )
    numbers = 1
    for length in shape:
        numbers *= length
    if min((*shape, 0)) < 0 or numbers * dtype.itemsize != member.file_size - begins:
        raise RefusedError(
            f"{where}: '{name[:100]}' claims shape {shape} of {dtype}, which is not the "
            f"{member.file_size - begins} bytes that it holds",
            "save it again with numpy.savez",
        )
    return shape, dtype, fortran, begins
