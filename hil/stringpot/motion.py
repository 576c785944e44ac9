# SPDX-License-Identifier: Apache-2.0
"""Samples of a string pot -> position and velocity, without a shift in time.

The position is filtered by a Butterworth low-pass once forwards and once backwards (zero phase,
``scipy.signal.sosfiltfilt``), then differentiated by central differences. Two passes of a filter
of order n with cutoff f' are 3 dB down at f = f' (sqrt(2) - 1)^(1/2n) (Winter, Biomechanics and
Motor Control of Human Movement, 4th ed., section 3.4.4.2): f' is chosen so that ``cutoff_hz`` is
where the whole is 3 dB down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError
from hil.stringpot.calibration import Calibration
from hil.stringpot.samples import Samples, StringPotError

Float = NDArray[np.float64]

CUTOFF_HZ: Final = 12.0
ORDER: Final = 4
"""Of both passes together."""
BRIDGED_S: Final = 0.02
"""Samples missing for no longer are bridged by a line: the filter's cutoff is far below."""
SPIKE_MM: Final = 20.0
"""Off the median of five samples: a digit lost on the line, for no bar does 10 m/s."""
SEGMENT_MIN_S: Final = 0.5
"""Of a segment without its ends, one period of the cutoff each, where the filter knows one side
alone and single noisy samples count for much."""
PERIOD_US: Final = (200.0, 20_000.0)


@dataclass(frozen=True, eq=False)
class Motion:
    """n instants at an even period within each segment.

    Attributes:
        t_s: float64[n], the ESP32's clock since its first sample; increasing.
        position_mm, velocity_mps: float64[n].
        segments: pieces without a pause; between them nothing is said.
        spikes, outside, other_runs: samples left out as spikes; outside of what was calibrated,
            but kept; of other runs than the longest, left out.
    """

    t_s: Float
    position_mm: Float
    velocity_mps: Float
    segments: int
    spikes: int
    outside: int
    other_runs: int


def motion(
    samples: Samples, calibration: Calibration, cutoff_hz: float = CUTOFF_HZ, order: int = ORDER
) -> Motion:
    """Position and velocity of the string's end; lengths grow as it is pulled out.

    Raises:
        StringPotError: nothing to filter, or a cutoff that the rate does not allow.
        HilError: scipy is not installed.
    """
    run = samples.run == np.bincount(samples.run, minlength=1).argmax()
    t_us, raw = samples.t_us[run], samples.raw[run]
    if len(t_us) < 2:
        raise StringPotError("no two samples of a string pot", "look at the log: hil stringpot log")
    period_us = float(np.median(np.diff(t_us)))
    if not PERIOD_US[0] <= period_us <= PERIOD_US[1]:
        raise StringPotError(
            f"samples {period_us:g} us apart: not the log of a string pot",
            "it sends 1,000 a second",
        )
    position = calibration.mm(raw)
    spike = _spikes(position)
    t_us, position = t_us[~spike], position[~spike]
    sos = _low_pass(cutoff_hz, order, 1e6 / period_us)
    end_us = 1e6 / cutoff_hz
    cuts = np.flatnonzero(np.diff(t_us) > max(BRIDGED_S * 1e6, 1.5 * period_us)) + 1
    pieces = [
        _filtered(t, x, period_us, sos, round(end_us / period_us))
        for t, x in zip(np.split(t_us, cuts), np.split(position, cuts), strict=True)
        if t[-1] - t[0] >= SEGMENT_MIN_S * 1e6 + 2.0 * end_us
    ]
    if not pieces:
        raise StringPotError(
            f"no {SEGMENT_MIN_S + 2e-6 * end_us:.2g} s without a pause: nothing to filter",
            "look at the losses: hil stringpot log",
        )
    low, high = calibration.raw_range
    t, x, v = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return Motion(
        (t - t_us[0]) / 1e6,
        x,
        v,
        segments=len(pieces),
        spikes=int(spike.sum()),
        outside=int(np.count_nonzero((raw < low) | (raw > high))),
        other_runs=int(np.count_nonzero(~run)),
    )


def _filtered(
    t_us: NDArray[np.int64], x: Float, period_us: float, sos: Float, ends: int
) -> tuple[Float, ...]:
    """Times in us, positions, velocities; without ``ends`` rows at either end."""
    from scipy.signal import sosfiltfilt  # noqa: PLC0415 (an extra)

    # An even grid: what is missing or jitters is put on the line between its neighbours.
    n = int((t_us[-1] - t_us[0]) / period_us) + 1
    grid = t_us[0] + period_us * np.arange(n)
    # The default padding, three filter lengths, is too short for a cutoff far below the rate.
    pad = min(n - 1, round(0.25e6 / period_us))
    smooth: Float = sosfiltfilt(sos, np.interp(grid, t_us, x), padlen=pad)
    velocity = np.gradient(smooth, period_us * 1e-6) * 1e-3
    return grid[ends:-ends], smooth[ends:-ends], velocity[ends:-ends]


def _low_pass(cutoff_hz: float, order: int, rate_hz: float) -> Float:
    try:
        from scipy.signal import butter  # noqa: PLC0415 (an extra)
    except ImportError as error:
        raise HilError("filtering needs scipy", "pip install 'hil[stringpot]'") from error
    if order < 2 or order % 2:
        raise StringPotError(f"an order of {order}", "two passes of the same filter: 2, 4, 6 or 8")
    passed = order // 2
    each_hz = cutoff_hz / (math.sqrt(2.0) - 1.0) ** (1.0 / (2 * passed))
    if not cutoff_hz >= 0.5 or each_hz >= 0.45 * rate_hz:
        raise StringPotError(
            f"a cutoff of {cutoff_hz:g} Hz does not go with {rate_hz:.0f} samples a second",
            "a barbell needs 10 to 20 Hz",
        )
    sos: Float = butter(passed, each_hz, fs=rate_hz, output="sos")
    return sos


def _spikes(x: Float) -> NDArray[np.bool_]:
    if len(x) < 5:
        return np.zeros(len(x), np.bool_)
    padded = np.pad(x, 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    found: NDArray[np.bool_] = np.abs(x - middle) > SPIKE_MM
    return found
