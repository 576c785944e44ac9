# SPDX-License-Identifier: Apache-2.0
"""Where errors come from, as formulas; ``docs/error-budget.md`` shows the same with numbers.

Symbols::

    q       tick of the 16 MHz TIMER                            62.5 ns
    g       time grid of the radio simulator                    1000 ns
    s       rms error of one time stamp                         q / sqrt(12)
    W, n    window of the fit, pairs in it                      2 s, W / interval
    D       how far beyond its window a model is used           0.10 s or 0.15 s
    c       curvature of the offset under crystal wander, rms   see wander_curvature_rms
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

TICK_NS: Final = 62.5
"""One tick of the 16 MHz TIMER (nRF52840 PS v1.7, section 6.30)."""

STAMP_RMS_NS: Final = TICK_NS / math.sqrt(12.0)
"""Quantisation of one capture, rms: 18.0 ns."""

DIFFERENCE_RMS_NS: Final = STAMP_RMS_NS * math.sqrt(2.0)
"""Difference of two captures, rms: 25.5 ns."""

SIM_GRID_NS: Final = 1000.0
"""Time grid of the radio simulator: its TIMER ticks are whole microseconds times 16."""

SIM_PAIR_RMS_NS: Final = SIM_GRID_NS / math.sqrt(6.0)
"""Offset of one pair in simulation, rms: two independent roundings, 408.2 ns.

Leader, radio channel and follower each count whole microseconds of their own time. A packet
crosses leader -> channel -> follower and back; the way back mirrors both roundings, so of the
halved sum one whole rounding per node is left.
"""

SIM_ALIAS_NS: Final = 200.0
"""Largest bias seen when the drifts are commensurate with the connection interval."""

WINDOW_S: Final = 2.0
"""Window of the offset and skew fit."""

P99: Final = 2.58
"""99th percentile of the magnitude of a normal variable, in rms."""

PEAK: Final = 4.5
"""Allowance for the largest value, in rms: an hour holds 1,800 windows, whose largest is 3.6."""

SHORT_INTERVAL_S: Final = 7.5e-3
LONG_INTERVAL_S: Final = 30e-3

SHORT_AGE_S: Final = 0.10
"""Report two events late, published every 50 ms, sent on, a pulse programmed 10 ms ahead."""
LONG_AGE_S: Final = 0.15


@dataclass(frozen=True)
class Crystal:
    """A node's crystal: drift in ppm, and wander terms (amplitude in ppm, period in s)."""

    drift_ppm: float
    wander: tuple[tuple[float, float], ...] = ()


CALM: Final = (Crystal(13.7, ((0.2, 37.0),)), Crystal(-31.1, ((0.15, 23.0),)))
"""Both nodes' crystals that the limits at intervals up to 10 ms allow for."""
WARMING: Final = (
    Crystal(13.7, ((0.5, 41.0), (0.08, 11.0))),
    Crystal(-31.1, ((0.4, 29.0), (0.06, 7.0))),
)
"""The same beyond 10 ms."""

_HARMONICS: Final = 100
_WANDER_POINTS: Final = 240
_FFT_POINTS: Final = 1 << 16


def fit_rms_ns(pair_rms_ns: float, interval_s: float, age_s: float = 0.0) -> float:
    """Independent errors behind a fitted line, D beyond: p sqrt((1 + 12 (1/2 + D/W)^2) / n)."""
    n = WINDOW_S / interval_s
    return pair_rms_ns * math.sqrt((1.0 + 12.0 * (0.5 + age_s / WINDOW_S) ** 2) / n)


def phase_per_event(drift_ppm: float, interval_s: float) -> float:
    """By what part of the grid a node's clock moves against the channel's from event to event."""
    return math.fmod(abs(drift_ppm) * 1e-6 * interval_s * 1e9 / SIM_GRID_NS, 1.0)


def grid_rms_ns(crystal: Crystal, interval_s: float, age_s: float) -> float:
    """What the fit passes of one node's rounding, rms, D beyond the window.

    The rounding error is no noise: it is the sawtooth of a phase that advances evenly. Its m-th
    harmonic has amplitude g / (pi m) and the frequency of m times the phase, taken modulo one
    turn per event; the line passes it as its weights respond at that frequency.
    """
    return _grid_rms(crystal, interval_s, age_s, slope=False)


def grid_skew_rms_ppb(crystal: Crystal, interval_s: float) -> float:
    """The same of the line's slope."""
    return _grid_rms(crystal, interval_s, 0.0, slope=True)


def _grid_rms(crystal: Crystal, interval_s: float, age_s: float, *, slope: bool) -> float:
    n = round(WINDOW_S / interval_s)
    at_s = -interval_s * np.arange(n)
    centred = at_s - at_s.mean()
    rise = centred / np.sum(centred**2)
    weights = rise if slope else 1.0 / n + (age_s - at_s.mean()) * rise
    harmonic = np.arange(1, _HARMONICS + 1)
    turns = harmonic * interval_s * 1e3 / SIM_GRID_NS * _drifts_ppm(crystal)[:, None]
    # |response| on a grid of turns per event, 240 times finer than the fit can tell apart.
    responses = np.abs(np.fft.fft(weights, _FFT_POINTS))
    bins = np.rint((turns - np.floor(turns)) * _FFT_POINTS).astype(np.int64) % _FFT_POINTS
    response = responses[bins]
    power = np.sum((SIM_GRID_NS * response / (math.pi * harmonic)) ** 2, axis=1) / 2.0
    return float(np.sqrt(np.mean(power)))


def _drifts_ppm(crystal: Crystal) -> NDArray[np.float64]:
    """The rates that the crystal passes through, as long as each lasts."""
    if not crystal.wander:
        return np.array([crystal.drift_ppm])
    t_s = np.linspace(0.0, 900.0, _WANDER_POINTS)
    terms = [a * np.sin(2.0 * math.pi * t_s / period) for a, period in crystal.wander]
    return np.asarray(crystal.drift_ppm + np.sum(terms, axis=0), dtype=np.float64)


def wander_curvature_rms(crystals: Sequence[Crystal]) -> float:
    """Curvature of the offset, ns/s^2, rms: sqrt(sum((A 2 pi / T)^2) / 2), all nodes' terms."""
    terms = [term for crystal in crystals for term in crystal.wander]
    return math.sqrt(sum((1e3 * a * 2.0 * math.pi / t) ** 2 for a, t in terms) / 2.0)


def fit_wander_rms_ns(crystals: Sequence[Crystal], age_s: float) -> float:
    """Error of a line fitted to a parabola: c (W^2 / 12 + W D / 2 + D^2 / 2)."""
    span = WINDOW_S**2 / 12.0 + WINDOW_S * age_s / 2.0 + age_s**2 / 2.0
    return wander_curvature_rms(crystals) * span


def skew_lag_rms_ppb(crystals: Sequence[Crystal], age_s: float) -> float:
    """The slope belongs to the middle of the window: c (W / 2 + D) behind when used."""
    return wander_curvature_rms(crystals) * (WINDOW_S / 2.0 + age_s)


def grids_rms_ns(crystals: Sequence[Crystal], interval_s: float, age_s: float) -> float:
    """Both nodes' rounding behind the fit, rms."""
    return math.hypot(*(grid_rms_ns(c, interval_s, age_s) for c in crystals))


def grids_skew_rms_ppb(crystals: Sequence[Crystal], interval_s: float) -> float:
    """Both nodes' rounding in the slope, rms."""
    return math.hypot(*(grid_skew_rms_ppb(c, interval_s) for c in crystals))


def sync_rms_ns(crystals: Sequence[Crystal], interval_s: float, age_s: float) -> float:
    """Sync error in simulation, rms: grid behind the fit, wander, COMPARE in whole ticks."""
    grid = grids_rms_ns(crystals, interval_s, age_s)
    return math.hypot(grid, fit_wander_rms_ns(crystals, age_s), STAMP_RMS_NS)


def skew_rms_ppb(crystals: Sequence[Crystal], interval_s: float, age_s: float) -> float:
    """Skew error in simulation, rms: grid behind the fit, and lag behind the wander."""
    return math.hypot(grids_skew_rms_ppb(crystals, interval_s), skew_lag_rms_ppb(crystals, age_s))
