# SPDX-License-Identifier: Apache-2.0
"""Counts kept between runs of the tuner: one file per recording, used for the same inputs only."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.atomic import write_whole
from hil.core import ESTIMATOR_SHA256
from hil.tuning.grid import Counts, Grid, Table

SIZE_MAX: Final = 1 << 24
NAMES: Final = ("steps", "spans", "false_spans", "missed")


def digest(file: Path, grid: Grid) -> str:
    """Hash of everything that the counts depend on: recording, grid, estimator, and counting."""
    found = hashlib.sha256()
    for source in (file, *sorted(Path(__file__).parent.glob("*.py"))):
        found.update(hashlib.sha256(source.read_bytes()).digest())
    found.update(str(ESTIMATOR_SHA256).encode())
    for values in (grid.accel_var, grid.gyro_var):
        found.update(hashlib.sha256(np.ascontiguousarray(values).tobytes()).digest())
    return found.hexdigest()


def write(folder: Path, inputs: str, tables: Sequence[Table]) -> None:
    """Keep the counts of one recording."""
    document = {
        "inputs": inputs,
        "tables": [
            {
                **{name: _listed(getattr(table, name)) for name in NAMES},
                "total": table.total,
                "period_s": table.period_s,
                "rests": table.rests,
            }
            for table in tables
        ],
    }
    write_whole(_file(folder, inputs), json.dumps(document).encode("ascii"))


def read(folder: Path, inputs: str, grid: Grid) -> list[Table] | None:
    """The counts kept for these inputs; None where there are none, or none that can be read."""
    file = _file(folder, inputs)
    try:
        if file.stat().st_size > SIZE_MAX:
            return None
        document = json.loads(file.read_bytes())
        if document["inputs"] != inputs:
            return None
        return [_table(one, grid) for one in document["tables"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError, OverflowError):
        return None


def _file(folder: Path, inputs: str) -> Path:
    return folder / f"zupt-{inputs[:16]}.json"


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
