# SPDX-License-Identifier: Apache-2.0
"""Tables of log lines as files: CSV or Parquet, one for each port and kind of line."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.atomic import write_whole
from hil.errors import HilError
from hil.extras import module
from hil.log.text import Table, tables_of_parts
from hil.recording import Recording

NS_PER_S = 1e9


def write(parts: Sequence[Recording], csv: Path | None, parquet: Path | None) -> list[str]:
    """Write every table of a log and say, in a sentence each, what was written.

    ``run.csv`` becomes ``run-leader-shadow.csv`` and so on.

    Raises:
        HilError: a file cannot be written, or Parquet is wanted and pyarrow is not there.
    """
    said = []
    for role in dict.fromkeys(role for part in parts for role in part.roles):
        for kind, table in tables_of_parts(parts, role).items():
            counts = f"{len(table)} rows, {table.bad_rows} bad ones left out"
            missing = steps_missing(table)
            if missing is not None:
                counts += f", {missing} missing by their times"
            for path, render in ((csv, as_csv), (parquet, as_parquet)):
                if path is not None:
                    target = path.with_name(f"{path.stem}-{role}-{kind}{path.suffix}")
                    _write(target, render(table))
                    said.append(f"{target}: {counts}")
    return said or ["no CSV lines with a heading were logged: no table was written"]


def columns(table: Table) -> Mapping[str, NDArray[Any]]:
    """All columns of a table: when each row was read on the bench clock, then its own."""
    return {"t_s_bench": table.t_ns_bench / NS_PER_S, **table.columns}


def as_csv(table: Table) -> bytes:
    """A heading and the rows; times of the bench to a microsecond, all else as it was sent."""
    named = columns(table)
    text = io.StringIO()
    text.write(",".join(named) + "\n")
    cells = [_cells(name, values) for name, values in named.items()]
    text.writelines(",".join(row) + "\n" for row in zip(*cells, strict=True))
    return text.getvalue().encode("ascii")


def _cells(name: str, values: NDArray[Any]) -> list[str]:
    if name == "t_s_bench":
        return [f"{value:.6f}" for value in values.tolist()]
    # repr of a float64 reads back as the same number.
    return [str(value) for value in values.tolist()]


def as_parquet(table: Table) -> bytes:
    """The same as Parquet, zstd; the kind of line is in the metadata.

    Raises:
        HilError: pyarrow is not installed.
    """
    pyarrow, parquet = module("pyarrow"), module("pyarrow.parquet")
    arrow = pyarrow.table(
        {name: pyarrow.array(values.tolist()) for name, values in columns(table).items()}
    ).replace_schema_metadata({"hil.kind": table.kind, "hil.bad_rows": str(table.bad_rows)})
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(arrow, sink, compression="zstd")
    content: bytes = sink.getvalue().to_pybytes()
    return content


def steps_missing(table: Table) -> int | None:
    """Rows that the times say are missing; None without a clock of the node, or too few rows."""
    name = next((n for n in table.columns if n.startswith("t_us")), None)
    if name is None or len(table) < 3 or table.columns[name].dtype != np.int64:
        return None
    step = np.diff(table.columns[name])
    ahead = step[step > 0]
    if not ahead.size:
        return None
    # A step back is a restart: how much is missing there nobody knows.
    return int(np.sum(np.rint(ahead / np.median(ahead)) - 1.0))


def _write(path: Path, content: bytes) -> None:
    try:
        write_whole(path, content)
    except OSError as error:
        raise HilError(
            f"{path} cannot be written: {error.strerror or error}",
            "name a file that you may write to; the recording is whole: hil log --from",
        ) from error
