# SPDX-License-Identifier: Apache-2.0
"""Results kept between runs of a tuner: one file each, used again for the same inputs only.

A file is whole or not there (:mod:`hil.atomic`), so a tuner may be killed at any time. One that
cannot be read, or was made from other inputs, is as good as none.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.atomic import write_whole
from hil.core import ESTIMATOR_SHA256
from hil.tuning.grid import Counts, Grid, Table

SIZE_MAX: Final = 1 << 24
NAMES: Final = ("steps", "spans", "false_spans", "missed")
SOURCES: Final = ("tuning", "fusion", "motion", "reference", "reps", "parity.py", "accuracy.py")
"""Parts of this package that results depend on."""


@cache
def version() -> str:
    """Hash of the estimator and of the sources that judge it."""
    found = hashlib.sha256(str(ESTIMATOR_SHA256).encode())
    package = Path(__file__).parents[1]
    for name in SOURCES:
        part = package / name
        for source in [part] if part.is_file() else sorted(part.rglob("*.py")):
            found.update(hashlib.sha256(source.read_bytes()).digest())
    return found.hexdigest()


def digest(*inputs: str) -> str:
    """Hash of everything that a result depends on: the inputs, the estimator, and the sources."""
    found = hashlib.sha256(version().encode())
    for one in inputs:
        found.update(hashlib.sha256(one.encode()).digest())
    return found.hexdigest()


def of_file(file: Path, grid: Grid) -> str:
    """:func:`digest` of the counts of a recording over a grid."""
    axes = (grid.accel_var, grid.gyro_var)
    return digest(
        hashlib.sha256(file.read_bytes()).hexdigest(),
        *(np.ascontiguousarray(values).tobytes().hex() for values in axes),
    )


def write(folder: Path, kind: str, inputs: str, result: Any) -> None:
    """Keep a result of JSON's own types."""
    document = {"inputs": inputs, "result": result}
    write_whole(_file(folder, kind, inputs), json.dumps(document).encode("ascii"))


def read(folder: Path, kind: str, inputs: str) -> Any:
    """The result kept for these inputs; None where there is none, or none that can be read."""
    file = _file(folder, kind, inputs)
    try:
        if file.stat().st_size > SIZE_MAX:
            return None
        document = json.loads(file.read_bytes())
        return document["result"] if document["inputs"] == inputs else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def write_tables(folder: Path, inputs: str, tables: Sequence[Table]) -> None:
    """Keep the counts of one recording."""
    listed = [
        {
            **{name: _listed(getattr(table, name)) for name in NAMES},
            "total": table.total,
            "period_s": table.period_s,
            "rests": table.rests,
        }
        for table in tables
    ]
    write(folder, "zupt", inputs, listed)


def read_tables(folder: Path, inputs: str, grid: Grid) -> list[Table] | None:
    """The counts kept for these inputs; None where there are none, or none that can be read."""
    found = read(folder, "zupt", inputs)
    try:
        return None if found is None else [_table(one, grid) for one in found]
    except (ValueError, KeyError, TypeError, OverflowError):
        return None


def _file(folder: Path, kind: str, inputs: str) -> Path:
    return folder / f"{kind}-{inputs[:16]}.json"


def _listed(counts: Counts | None) -> list[list[int]] | None:
    return None if counts is None else counts.tolist()


def _table(one: dict[str, Any], grid: Grid) -> Table:
    steps, spans, false_spans, missed = (_counts(one[name], grid) for name in NAMES)
    if steps is None or spans is None or (false_spans is None) != (missed is None):
        raise ValueError("counts are missing")
    return Table(
        steps,
        spans,
        false_spans,
        missed,
        int(one["total"]),
        float(one["period_s"]),
        int(one["rests"]),
    )


def _counts(values: Any, grid: Grid) -> Counts | None:
    if values is None:
        return None
    counts = np.array(values, dtype=np.int64)
    if counts.shape != grid.shape:
        raise ValueError("counts of another grid")
    return counts
