# SPDX-License-Identifier: Apache-2.0
"""Fewer points, the same picture: keep the smallest and the largest of each span."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def min_max(x: Floats, y: Floats, max_points: int) -> tuple[Floats, Floats]:
    """Thin ``y`` over ``x`` (both float64[n], x ascending) to at most ``max_points``.

    The samples are cut into equal runs and of each run the smallest and the largest are kept, in
    their order, so that no excursion is lost; the first and the last sample stay. Where a run
    holds a NaN (a gap), its first NaN stays too, so that gaps remain gaps.

    Raises:
        ValueError: ``max_points`` is below 8.
    """
    if max_points < 8:
        raise ValueError(f"cannot thin a series to {max_points} points: ask for at least 8")
    n = y.size
    if n <= max_points:
        return x, y
    missing = np.isnan(y)
    runs = (max_points - 2) // (3 if missing.any() else 2)
    length = -(-n // runs)
    full_runs = -(-n // length)
    padded = np.full(full_runs * length, np.nan)
    padded[:n] = y
    table = padded.reshape(full_runs, length)
    start = np.arange(full_runs) * length
    empty = np.isnan(table)
    keep = [
        start + np.where(empty, np.inf, table).argmin(axis=1),
        start + np.where(empty, -np.inf, table).argmax(axis=1),
        np.array([0, n - 1]),
    ]
    if missing.any():
        has_gap = np.logical_or.reduceat(missing, start)
        keep.append((start + empty.argmax(axis=1))[has_gap])
    index = np.unique(np.concatenate(keep))
    return x[index], y[index]
