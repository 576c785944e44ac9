# SPDX-License-Identifier: Apache-2.0
"""A clock line through the pairs of the last 2 s, ten times a second, over 1, 10 and 60 minutes."""

from __future__ import annotations

import numpy as np

from benchmarks.measure import Row, best, reading_s
from hil.timesync.fit import trailing_lines

INTERVAL_S, WINDOW_S, EVERY_S = 0.0075, 2.0, 0.1


def by_polyfit(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Value at each instant."""
    first = np.searchsorted(x, at - WINDOW_S, side="right")
    last = np.searchsorted(x, at, side="right")
    return np.array(
        [np.polyfit(x[a:b] - t, y[a:b], 1)[1] for a, b, t in zip(first, last, at, strict=True)]
    )


def rows() -> list[Row]:
    return [_row(minutes) for minutes in (1, 10, 60)]


def _row(minutes: int) -> Row:
    rng = np.random.default_rng(1)
    x = np.arange(INTERVAL_S, 60.0 * minutes, INTERVAL_S)
    y = 2e-5 * x + 1e-7 * np.sin(x / 40) + rng.normal(0, 3e-8, len(x))
    at = np.arange(WINDOW_S, 60.0 * minutes, EVERY_S)
    few = at[:: max(1, minutes // 2)]
    if not np.allclose(
        trailing_lines(x, y, few, WINDOW_S).value, by_polyfit(x, y, few), atol=1e-12
    ):
        raise RuntimeError("polyfit finds other lines")
    ours_s = best(lambda: trailing_lines(x, y, at, WINDOW_S), 5)
    peer_s = best(lambda: by_polyfit(x, y, few), 2) * len(at) / len(few)
    return Row(
        work=f"clock lines of {minutes} min: {len(at):,} windows of {len(x):,} pairs",
        ours=f"{1e3 * ours_s:.1f} ms",
        peer=f"polyfit per window: {1e3 * peer_s:.0f} ms",
        ratio=peer_s / ours_s,
        limit=reading_s(x.nbytes + y.nbytes) / ours_s,
        aim="20 times",
        met=peer_s >= 20 * ours_s,
    )
