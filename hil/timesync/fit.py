# SPDX-License-Identifier: Apache-2.0
"""Least-squares lines through a sliding window of pairs: offset and skew, recomputed.

Independent of the firmware's estimator: other code, other arithmetic (float64, offline), the
same captures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.core import calib

Float = NDArray[np.float64]
Int = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Lines:
    """One line per instant asked for; float64[m], NaN where fewer than three points were in it.

    Attributes:
        value: of the line at the instant.
        slope: change of y per unit of x.
        residual_rms: of the points around the line, n - 2 degrees of freedom.
        points: int64[m], in the window.
    """

    value: Float
    slope: Float
    residual_rms: Float
    points: Int


def trailing_lines(x: Float, y: Float, at: Float, window: float) -> Lines:
    """Fit y = value + slope * (x - at) over the points with at - window < x <= at.

    Args:
        x: float64[n], ascending.
        y: float64[n].
        at: float64[m], instants.
        window: length of the window, in the unit of x.

    Prefix sums make the cost O(n + m). x and y are first centred and y's overall line is taken
    out, so that the sums hold the small remainder and lose nothing to cancellation.
    """
    nothing = np.full(at.size, np.nan)
    if x.size < 3:
        return Lines(nothing, nothing, nothing, np.zeros(at.size, dtype=np.int64))
    x0, y0 = x.mean(), y.mean()
    u = x - x0
    trend = float(np.dot(u, y - y0) / np.dot(u, u))
    v = (y - y0) - trend * u

    first = np.searchsorted(x, at - window, side="right")
    last = np.searchsorted(x, at, side="right")
    n = (last - first).astype(np.int64)

    def window_sum(terms: Float) -> Float:
        total = np.concatenate([[0.0], np.cumsum(terms)])
        return np.asarray(total[last] - total[first], dtype=np.float64)

    with np.errstate(invalid="ignore", divide="ignore"):
        mean_u = window_sum(u) / n
        mean_v = window_sum(v) / n
        suu = window_sum(u * u) - n * mean_u**2
        suv = window_sum(u * v) - n * mean_u * mean_v
        svv = window_sum(v * v) - n * mean_v**2
        slope = suv / suu
        value = mean_v + slope * ((at - x0) - mean_u)
        residual = np.sqrt(np.maximum(svv - slope * suv, 0.0) / (n - 2))
    enough = (n >= 3) & (suu > 0)
    return Lines(
        value=np.where(enough, value + y0 + trend * (at - x0), np.nan),
        slope=np.where(enough, slope + trend, np.nan),
        residual_rms=np.where(enough, residual, np.nan),
        points=n,
    )


def deviations(x: Float, y: Float, neighbours: int = 128) -> Float:
    """float64[n]: how far each point lies from the robust line through its neighbours.

    The points are cut into blocks of ``neighbours``; in each the slope is the median of the
    slopes between points half a block apart (Theil and Sen, thinned) and the level the median.
    An outlier therefore cannot pull its own reference along.
    """
    result = np.zeros(x.size)
    if x.size < 4:
        return result
    blocks = max(1, x.size // neighbours)
    edges = np.linspace(0, x.size, blocks + 1).astype(np.int64)
    # Equal blocks in one matrix, the shorter ones padded with NaN.
    width = int(np.max(np.diff(edges)))
    index = edges[:-1, None] + np.arange(width)[None, :]
    valid = index < edges[1:, None]
    index = np.minimum(index, x.size - 1)
    bx = np.where(valid, x[index], np.nan)
    by = np.where(valid, y[index], np.nan)
    half = width // 2
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = (by[:, half:] - by[:, : width - half]) / (bx[:, half:] - bx[:, : width - half])
    slope = np.nanmedian(slopes, axis=1, keepdims=True)
    flat = by - slope * bx
    deviation = flat - np.nanmedian(flat, axis=1, keepdims=True)
    result[index[valid]] = deviation[valid]
    return result


def allan_deviation(t_s: Float, phase_s: Float) -> tuple[Float, Float]:
    """Overlapping Allan deviation of a phase record (IEEE Std 1139).

    Args:
        t_s: float64[n], ascending, about evenly spaced; gaps are bridged by straight lines.
        phase_s: float64[n].

    Returns:
        averaging times in s, log-spaced up to a quarter of the record, and deviations (1),
        float64[k] each; empty for a short record.
    """
    if t_s.size < 16:
        return np.zeros(0), np.zeros(0)
    step = float(np.median(np.diff(t_s)))
    span = float(t_s[-1] - t_s[0])
    if step <= 0 or span < 16 * step:
        return np.zeros(0), np.zeros(0)
    # The mean rate drops out of the deviation; taken out first, it leaves the bits to the rest.
    trend = (phase_s[-1] - phase_s[0]) / span
    small = phase_s - phase_s[0] - trend * (t_s - t_s[0])
    grid = np.arange(0.0, span, step)
    rate = np.diff(np.interp(grid, t_s - t_s[0], small)) / step
    tau_s, deviation, _ = calib.allan_deviation(rate, 1.0 / step)
    return tau_s, deviation
