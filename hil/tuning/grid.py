# SPDX-License-Identifier: Apache-2.0
"""What the detector does at every pair of thresholds: counted, never run again.

A step fires at all thresholds above its two statistics, so the steps that fire at each cell of
the grid are a two-dimensional histogram, summed along both axes. Beginnings of spans are the steps
that fire less those that fire like the step before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.tuning.statistics import Statistics

Float = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Grid:
    """Thresholds, increasing: ``accel_var`` float64[a] in (m/s^2)^2, ``gyro_var`` float64[g] in
    (rad/s)^2. All tables over a grid have a rows and g columns."""

    accel_var: Float
    gyro_var: Float

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.accel_var), len(self.gyro_var)


def around(accel_var: float, gyro_var: float, cells: int = 40, factor: float = 100.0) -> Grid:
    """A grid of ``cells`` by ``cells``, logarithmic, from 1 / ``factor`` to ``factor`` times."""
    steps = np.geomspace(1.0 / factor, factor, cells)
    return Grid(accel_var * steps, gyro_var * steps)


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """What is true of each step of a run.

    Attributes:
        moving: bool[n], either sensor truly moves faster than a zero-velocity update may claim.
        rests: (first, end) steps of each true rest that is long enough to be seen.
    """

    moving: NDArray[np.bool_]
    rests: Sequence[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Table:
    """Counts at each cell, int64[a, g].

    Attributes:
        steps: on which the detector says still; ``spans``: uninterrupted runs of them.
        false_spans: runs of them in which the bar truly moves; ``missed``: true rests without
            any. Both None where the truth is not known.
        total: steps of the run.
        period_s: time of a step.
        rests: true rests that could be seen.
    """

    steps: Counts
    spans: Counts
    false_spans: Counts | None
    missed: Counts | None
    total: int
    period_s: float
    rests: int


def count(found: Statistics, grid: Grid, known: KnownMotion | None) -> Table:
    """Every cell of ``grid`` over one run."""
    a = np.searchsorted(grid.accel_var, found.accel_var, side="right")
    g = np.searchsorted(grid.gyro_var, found.gyro_var, side="right")
    total = len(a)
    false_spans = missed = None
    if known is not None:
        false_spans = _spans(a, g, grid, known.moving)
        missed = np.zeros(grid.shape, np.int64)
        for first, end in known.rests:
            missed += _fires(a[first:end], g[first:end], grid) == 0
    return Table(
        _fires(a, g, grid),
        _spans(a, g, grid, np.ones(total, bool)),
        false_spans,
        missed,
        total,
        found.period_s,
        len(known.rests) if known else 0,
    )


def _spans(a: Counts, g: Counts, grid: Grid, among: NDArray[np.bool_]) -> Counts:
    """Runs of steps that fire and are ``among``."""
    both = among[1:] & among[:-1]
    again = _fires(np.maximum(a[1:], a[:-1])[both], np.maximum(g[1:], g[:-1])[both], grid)
    spans: Counts = _fires(a[among], g[among], grid) - again
    return spans


def _fires(a: Counts, g: Counts, grid: Grid) -> Counts:
    """int64[a, g]: steps whose first firing cell lies at or below each cell, in both directions."""
    rows, columns = grid.shape
    flat = np.bincount(a * (columns + 1) + g, minlength=(rows + 1) * (columns + 1))
    table = flat.reshape(rows + 1, columns + 1)[:rows, :columns]
    summed: Counts = table.cumsum(axis=0).cumsum(axis=1).astype(np.int64)
    return summed
