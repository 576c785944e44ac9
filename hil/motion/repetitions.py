# SPDX-License-Identifier: Apache-2.0
"""Concentric phases of a set: the same definition for truth and for estimates.

A concentric phase is a span in which the centre of the bar rises: it begins where the vertical
velocity climbs through ``on_mps`` and ends where it falls through ``on_mps`` again; crossings
are found by linear interpolation between samples. Phases shorter in travel than
``min_travel_m`` or slower at their peak than ``min_peak_mps`` (sway, unracking) are no
repetitions. Mean velocity is travel over duration, which is what linear transducers report.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil.motion.bar import Trajectory
from hil.motion.curves import FloatArray


@dataclass(frozen=True)
class Concentric:
    """One concentric phase. Times in s, velocities in m/s, travel in m, all of the bar's centre."""

    t_start_s: float
    t_end_s: float
    mean_mps: float
    peak_mps: float
    t_peak_s: float
    travel_m: float


def concentrics(
    t_s: FloatArray,
    velocity_z_mps: FloatArray,
    on_mps: float = 0.05,
    min_travel_m: float = 0.15,
    min_peak_mps: float = 0.25,
) -> list[Concentric]:
    """All concentric phases of a vertical velocity trace.

    Args:
        t_s: (n,) increasing.
        velocity_z_mps: (n,) at those times.

    Returns:
        Phases in order of time. A phase cut off by either end of the trace is left out.
    """
    t, v = np.asarray(t_s, dtype=np.float64), np.asarray(velocity_z_mps, dtype=np.float64)
    above = v > on_mps
    rises = np.flatnonzero(~above[:-1] & above[1:])
    falls = np.flatnonzero(above[:-1] & ~above[1:])
    found = []
    for i in rises:
        later = falls[falls > i]
        if not len(later):
            break
        j = int(later[0])
        begin = _crossing(t[i : i + 2], v[i : i + 2], on_mps)
        end = _crossing(t[j : j + 2], v[j : j + 2], on_mps)
        inner = slice(i + 1, j + 1)
        tt = np.concatenate([[begin], t[inner], [end]])
        vv = np.concatenate([[on_mps], v[inner], [on_mps]])
        travel = float(np.trapezoid(vv, tt))
        k = i + 1 + int(np.argmax(v[inner]))
        t_peak, peak = _vertex(t[k - 1 : k + 2], v[k - 1 : k + 2])
        if travel >= min_travel_m and peak >= min_peak_mps:
            found.append(Concentric(begin, end, travel / (end - begin), peak, t_peak, travel))
    return found


def truth(trajectory: Trajectory, rate_hz: float = 2000.0) -> list[Concentric]:
    """Concentric phases of the analytic trajectory.

    Sampled at ``rate_hz``; at 2 kHz linear crossings and parabolic peaks are exact to below
    0.1 mm/s for any motion a person can make.
    """
    n = int(np.ceil(trajectory.duration_s * rate_hz)) + 1
    t = np.linspace(0.0, trajectory.duration_s, n)
    return concentrics(t, trajectory.z(t)[1])


def match(
    true: list[Concentric], estimated: list[Concentric]
) -> tuple[list[tuple[Concentric, Concentric]], list[Concentric], list[Concentric]]:
    """Pair phases that overlap by more than half of the shorter one.

    Returns:
        (pairs, missed true phases, invented estimated phases).
    """
    free = list(estimated)
    pairs, missed = [], []
    for a in true:
        best = max(free, key=lambda b: _overlap(a, b), default=None)
        if best is not None and _overlap(a, best) > 0.5:
            pairs.append((a, best))
            free.remove(best)
        else:
            missed.append(a)
    return pairs, missed, free


def _overlap(a: Concentric, b: Concentric) -> float:
    common = min(a.t_end_s, b.t_end_s) - max(a.t_start_s, b.t_start_s)
    return common / min(a.t_end_s - a.t_start_s, b.t_end_s - b.t_start_s)


def _crossing(t: FloatArray, v: FloatArray, level: float) -> float:
    return float(t[0] + (level - v[0]) / (v[1] - v[0]) * (t[1] - t[0]))


def _vertex(t: FloatArray, v: FloatArray) -> tuple[float, float]:
    """Vertex of the parabola through three samples around a maximum; the sample if flat."""
    if len(v) < 3:
        return float(t[np.argmax(v)]), float(v.max())
    left, right = v[1] - v[0], v[1] - v[2]
    if left + right <= 0 or left < 0 or right < 0:
        k = int(np.argmax(v))
        return float(t[k]), float(v[k])
    shift = 0.5 * (left - right) / (left + right)
    h = 0.5 * (t[2] - t[0])
    return float(t[1] + shift * h), float(v[1] + 0.25 * (left - right) * shift)
