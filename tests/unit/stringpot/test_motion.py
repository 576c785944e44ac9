# SPDX-License-Identifier: Apache-2.0
"""Velocity of a string pot against trajectories whose velocity is known exactly.

Stated: with 0.8 mm rms of noise on counts of 0.1 mm, the velocity of a bench press is right within
8 mm/s rms, each mean concentric velocity within 2 mm/s, each peak within 2 %.
"""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import pytest
from esp32 import MM_PER_COUNT, OFFSET_MM, counts

from hil.errors import HilError
from hil.motion.lifts import Lift, bench
from hil.motion.repetitions import truth
from hil.stringpot.calibration import Calibration, Point
from hil.stringpot.motion import Motion, motion
from hil.stringpot.samples import Samples, StringPotError

KNOWN = Calibration(MM_PER_COUNT, OFFSET_MM, (Point(OFFSET_MM, 0.0), Point(1488.0, 16_380.0)), "")
RMS_MPS, MEAN_MPS, PEAK_SHARE = 0.008, 0.002, 0.02


def samples(t_us: np.ndarray, height_mm: np.ndarray, seed: int = 1) -> Samples:
    n = len(t_us)
    return Samples(t_us, counts(height_mm, seed), np.zeros(n, np.int64), 0, 0)


@cache
def measured(seed: int) -> tuple[Lift, Motion]:
    lift = bench(seed, reps=4)
    t_us = np.arange(0, int(lift.duration_s * 1e6), 1000)
    z = lift.trajectory.z(t_us * 1e-6)[0]
    return lift, motion(samples(t_us, 1000.0 * (z - z[0]), seed), KNOWN)


@pytest.mark.parametrize("seed", [3, 11, 31])
def test_the_velocity_of_a_lift_is_right_within_what_is_stated(seed: int) -> None:
    lift, found = measured(seed)
    true_mps = lift.trajectory.z(found.t_s)[1]
    error = found.velocity_mps - true_mps
    assert np.sqrt(np.mean(error**2)) < RMS_MPS
    for phase in truth(lift.trajectory):
        inside = (found.t_s >= phase.t_start_s) & (found.t_s <= phase.t_end_s)
        assert np.mean(found.velocity_mps[inside]) == pytest.approx(phase.mean_mps, abs=MEAN_MPS)
        peak = np.max(found.velocity_mps[inside])
        assert peak == pytest.approx(phase.peak_mps, rel=PEAK_SHARE)


def test_the_stated_errors_fail_a_filter_that_is_wrong() -> None:
    """Too low a cutoff dulls the strokes, none lets the noise through: both are seen."""
    lift, _ = measured(3)
    t_us = np.arange(0, int(lift.duration_s * 1e6), 1000)
    z = lift.trajectory.z(t_us * 1e-6)[0]
    for cutoff_hz in (2.0, 60.0):
        found = motion(samples(t_us, 1000.0 * (z - z[0])), KNOWN, cutoff_hz)
        error = found.velocity_mps - lift.trajectory.z(found.t_s)[1]
        assert np.sqrt(np.mean(error**2)) > RMS_MPS


def test_nothing_is_shifted_in_time() -> None:
    lift, found = measured(3)
    true_mps = lift.trajectory.z(found.t_s)[1]
    lags = np.arange(-30, 31)
    middle = slice(100, -100)
    match = [np.dot(np.roll(found.velocity_mps, k)[middle], true_mps[middle]) for k in lags]
    a, b, c = match[29:32]
    assert lags[int(np.argmax(match))] == 0
    # Where a parabola through the three greatest has its top, in samples of 1 ms.
    assert abs(0.5 * (a - c) / (a - 2.0 * b + c)) < 0.2


@pytest.mark.parametrize(("order", "cutoff_hz"), [(2, 10.0), (4, 15.0), (8, 8.0)])
def test_the_cutoff_is_where_the_whole_is_3_db_down(order: int, cutoff_hz: float) -> None:
    """A sine of that frequency keeps 1/sqrt(2) of its height; one far below keeps all."""
    t_us = np.arange(0, 6_000_000, 1000)
    for hz, share in ((cutoff_hz, np.sqrt(0.5)), (0.1 * cutoff_hz, 1.0)):
        sine = 500.0 + 300.0 * np.sin(2.0 * np.pi * hz * t_us * 1e-6)
        exact = Samples(t_us, np.rint((sine - OFFSET_MM) / MM_PER_COUNT).astype(np.int64),
                        np.zeros(len(t_us), np.int64), 0, 0)  # fmt: skip
        found = motion(exact, KNOWN, cutoff_hz, order)
        inside = found.position_mm[2000:4000]
        assert np.ptp(inside) / 600.0 == pytest.approx(share, abs=0.01)
        speed = np.ptp(found.velocity_mps[2000:4000]) / 2.0
        assert speed == pytest.approx(0.3 * share * 2.0 * np.pi * hz, rel=0.015)


def test_noise_of_a_string_at_rest_is_what_the_filter_lets_through() -> None:
    """White noise s of period h gives s sqrt(2 h integral (2 pi f)^2 |H|^4 df)."""
    t_us = np.arange(0, 30_000_000, 1000)
    found = motion(samples(t_us, np.full(len(t_us), 400.0)), KNOWN)
    f = np.linspace(0.0, 200.0, 200_001)
    each_hz = 12.0 / (np.sqrt(2.0) - 1.0) ** 0.25
    power = (1.0 / (1.0 + (f / each_hz) ** 4)) ** 2
    sigma_m = 8.0 * MM_PER_COUNT * 1e-3
    expected = sigma_m * np.sqrt(2.0 * 1e-3 * np.trapezoid((2.0 * np.pi * f) ** 2 * power, f))
    assert np.std(found.velocity_mps) == pytest.approx(expected, rel=0.08)


def test_a_pause_parts_segments_and_small_losses_do_not() -> None:
    lift, _ = measured(3)
    t_us = np.arange(0, int(lift.duration_s * 1e6), 1000)
    kept = (t_us < 6_000_000) | (t_us > 7_500_000)
    kept &= (t_us // 1000) % 50 > 4
    z = lift.trajectory.z(t_us * 1e-6)[0]
    found = motion(samples(t_us[kept], 1000.0 * (z - z[0])[kept]), KNOWN)
    assert found.segments == 2
    assert not np.any((found.t_s > 6.01) & (found.t_s < 7.49))
    t_s = found.t_s + t_us[kept][0] * 1e-6
    error = found.velocity_mps - lift.trajectory.z(t_s)[1]
    assert np.sqrt(np.mean(error**2)) < 2.0 * RMS_MPS


def test_spikes_and_other_runs_are_left_out_and_counted() -> None:
    t_us = np.arange(0, 5_000_000, 1000)
    made = samples(t_us, np.full(len(t_us), 400.0))
    raw = made.raw.copy()
    raw[1000], raw[2500] = 5, 16_000
    run = np.zeros(len(t_us), np.int64)
    run[4500:] = 1
    found = motion(Samples(t_us, raw, run, 0, 0), KNOWN)
    assert (found.spikes, found.other_runs) == (2, 500)
    assert np.max(np.abs(found.velocity_mps)) < 0.03
    narrow = Calibration(MM_PER_COUNT, OFFSET_MM, (Point(0, 1000.0), Point(1, 2000.0)), "")
    assert motion(made, narrow).outside == 5000


def test_what_cannot_be_filtered_is_refused() -> None:
    t_us = np.arange(0, 5_000_000, 1000)
    still = samples(t_us, np.full(len(t_us), 400.0))
    with pytest.raises(StringPotError, match="cutoff of 450 Hz"):
        motion(still, KNOWN, 450.0)
    with pytest.raises(StringPotError, match="order of 3"):
        motion(still, KNOWN, 15.0, 3)
    with pytest.raises(StringPotError, match="no two samples"):
        motion(samples(t_us[:1], np.zeros(1)), KNOWN)
    with pytest.raises(StringPotError, match="not the log of a string pot"):
        motion(samples(t_us * 100, np.zeros(len(t_us))), KNOWN)
    with pytest.raises(StringPotError, match="without a pause"):
        motion(samples(t_us[:300], np.zeros(300)), KNOWN)


def test_without_scipy_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.signal", None)
    t_us = np.arange(0, 5_000_000, 1000)
    with pytest.raises(HilError, match="scipy") as caught:
        motion(samples(t_us, np.zeros(len(t_us))), KNOWN)
    assert "hil[stringpot]" in caught.value.mend
