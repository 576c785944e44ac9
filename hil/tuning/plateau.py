# SPDX-License-Identifier: Apache-2.0
"""The stable plateau of a grid: the largest connected region over which the result is one.

The result of a cell is its row of counts (spans, false spans, missed rests of every run); time in
stillness is no part of it, for it grows with each step of a threshold. Cells are neighbours along
the axes of the grid. Among regions that are acceptable (no false span and no missed rest where the
truth is known, at least one span everywhere) the one with the most cells is the plateau; cells are
equal steps of the thresholds' logarithms, so that is the largest range of factors.

The proposal is the cell of the plateau that lies deepest: the centre of the largest square of cells
that fits in (the nearest to the region's mean among equals). Its margin is the factor by which both
thresholds may change, each up or down, without any change of the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.tuning.grid import Grid, Table

Cells = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Plateau:
    """``cells`` bool[a, g]; the proposal's row and column; ``margin``: a factor, 1 for none."""

    cells: Cells
    row: int
    column: int
    margin: float


def plateau(grid: Grid, tables: Sequence[Table]) -> Plateau | None:
    """The plateau over all ``tables`` together; None where no cell is acceptable."""
    results = np.stack(
        [
            counts
            for t in tables
            for counts in (t.spans, t.false_spans, t.missed)
            if counts is not None
        ],
        axis=-1,
    )
    good = np.all([_acceptable(t) for t in tables], axis=0)
    region = largest(good, results)
    if region is None:
        return None
    depth = depths(region)
    deepest = np.argwhere(depth == depth.max())
    middle = np.argwhere(region).mean(axis=0)
    row, column = deepest[np.argmin(np.sum((deepest - middle) ** 2, axis=1))]
    # The square reaches depth - 1 cells to each side; the less of the two axes' factors counts.
    reach = int(depth.max()) - 1
    step = min(_step(grid.accel_var), _step(grid.gyro_var))
    return Plateau(region, int(row), int(column), step**reach)


def _acceptable(table: Table) -> Cells:
    good: Cells = table.spans > 0
    if table.false_spans is not None and table.missed is not None:
        good = (table.false_spans == 0) & (table.missed == 0)
        good = good & ((table.spans > 0) | (table.rests == 0))
    return good


def _step(values: NDArray[np.float64]) -> float:
    return float((values[-1] / values[0]) ** (1.0 / (len(values) - 1))) if len(values) > 1 else 1.0


def largest(good: Cells, results: NDArray[np.int64]) -> Cells | None:
    """The largest connected region of good cells with equal results (a, g, k); None without one."""
    left = good.copy()
    best: Cells | None = None
    while left.any():
        row, column = np.argwhere(left)[0]
        same = left & np.all(results == results[row, column], axis=-1)
        region = _flood(same, int(row), int(column))
        left &= ~region
        if best is None or region.sum() > best.sum():
            best = region
    return best


def _flood(among: Cells, row: int, column: int) -> Cells:
    """Cells of ``among`` that neighbours connect with one of them."""
    region = np.zeros_like(among)
    region[row, column] = True
    while True:
        grown = region.copy()
        grown[1:] |= region[:-1]
        grown[:-1] |= region[1:]
        grown[:, 1:] |= region[:, :-1]
        grown[:, :-1] |= region[:, 1:]
        grown &= among
        if np.array_equal(grown, region):
            return region
        region = grown


def depths(region: Cells) -> NDArray[np.int64]:
    """int64[a, g]: how many times the region survives being eroded by a square of 3 x 3.

    What lies beyond the grid was not looked at and counts as outside.
    """
    depth = np.zeros(region.shape, np.int64)
    now = region
    while now.any():
        depth += now
        padded = np.pad(now, 1)
        rows, columns = region.shape
        now = np.all(
            [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0
        )
    return depth
