# SPDX-License-Identifier: Apache-2.0
"""Slot times and sample period from watermark edges, against chips whose truth is known.

The estimator is the firmware's own C source, compiled by the host's compiler.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.native import shared_library

ROOT = Path(__file__).resolve().parents[2]
DRIVER = ROOT / "firmware" / "drivers" / "lsm6dsox"
SHIM = ROOT / "tests" / "unit" / "c" / "lsm6dsox_timing_shim.c"

TICKS_PER_US = 16
USED, REFUSED, RESTARTED = 0, 1, 2
ODRS_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)


class Timing:
    def __init__(
        self, library: ctypes.CDLL, nominal_rate_hz: float, edge_sigma_ticks: float = 5.0
    ) -> None:
        self._lib = library
        self._handle = ctypes.c_void_p(
            library.shim_new(ctypes.c_double(nominal_rate_hz), ctypes.c_double(edge_sigma_ticks))
        )

    def close(self) -> None:
        self._lib.shim_free(self._handle)

    def edge(self, slot: int, ticks: int) -> int:
        return int(self._lib.shim_edge(self._handle, ctypes.c_uint32(slot), ctypes.c_uint64(ticks)))

    def newest(self, slot: int, ticks: int) -> None:
        self._lib.lsm6dsox_timing_newest(
            self._handle, ctypes.c_uint32(slot), ctypes.c_uint64(ticks)
        )

    def lose_phase(self) -> None:
        self._lib.lsm6dsox_timing_lose_phase(self._handle)

    def renumber(self, slots: int) -> None:
        self._lib.lsm6dsox_timing_renumber(self._handle, ctypes.c_int32(slots))

    def slot_ticks(self, slot: int) -> int:
        return int(self._lib.lsm6dsox_timing_slot_ticks(self._handle, ctypes.c_uint32(slot)))

    def slot_at(self, ticks: int) -> int:
        return int(self._lib.lsm6dsox_timing_slot_at(self._handle, ctypes.c_uint64(ticks)))

    @property
    def has_phase(self) -> bool:
        return bool(self._lib.lsm6dsox_timing_has_phase(self._handle))

    @property
    def period_ticks(self) -> float:
        return float(self._lib.shim_period_ticks(self._handle))

    @property
    def period_q8(self) -> int:
        return int(self._lib.lsm6dsox_timing_period_q8(self._handle))

    def sigma_ticks(self, slot: int) -> float:
        return float(self._lib.shim_sigma_ticks(self._handle, ctypes.c_uint32(slot)))


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    output = tmp_path_factory.mktemp("lsm6dsox") / "timing.so"
    loaded = shared_library(output, [DRIVER / "lsm6dsox_timing.c", SHIM], [DRIVER])
    loaded.shim_new.restype = ctypes.c_void_p
    loaded.lsm6dsox_timing_slot_ticks.restype = ctypes.c_uint64
    loaded.lsm6dsox_timing_slot_at.restype = ctypes.c_uint32
    loaded.lsm6dsox_timing_period_q8.restype = ctypes.c_uint32
    loaded.lsm6dsox_timing_has_phase.restype = ctypes.c_bool
    loaded.shim_period_ticks.restype = ctypes.c_double
    loaded.shim_sigma_ticks.restype = ctypes.c_double
    return loaded


@pytest.fixture
def make(library: ctypes.CDLL) -> Iterator[Callable[..., Timing]]:
    made: list[Timing] = []

    def new(nominal_rate_hz: float, edge_sigma_ticks: float = 5.0) -> Timing:
        made.append(Timing(library, nominal_rate_hz, edge_sigma_ticks))
        return made[-1]

    yield new
    for one in made:
        one.close()


def slot_times_us(
    nominal_hz: float, error: float, duration_s: float, drift_per_s: float = 0.0
) -> NDArray[np.float64]:
    """Times of a chip's slots: rate nominal * (1 + error + drift * t), from 1 s on."""
    count = int(duration_s * nominal_hz * (1 + error + abs(drift_per_s) * duration_s))
    slots = np.arange(count)
    rate = nominal_hz * (1 + error)
    t = slots / rate
    # The rate's drift enters the time of slot k at second order in t.
    return 1e6 * (1.0 + t - drift_per_s * t**2 / (2 * (1 + error)))


def samples_per_batch(nominal_hz: float) -> int:
    return int(np.clip(round(nominal_hz * 0.04), 1, 16))


def captured(t_us: float) -> int:
    """The simulated bench has events each whole microsecond only."""
    return TICKS_PER_US * round(t_us)


@pytest.mark.parametrize("nominal_hz", ODRS_HZ)
@pytest.mark.parametrize("error", [-0.068, 0.0, 0.05])
def test_batch_times_within_a_microsecond_from_the_third_edge_on(
    make: Callable[..., Timing], nominal_hz: float, error: float
) -> None:
    times = slot_times_us(nominal_hz, error, 20.0)
    timing = make(nominal_hz)
    batch = samples_per_batch(nominal_hz)
    worst = 0.0
    for edges, last in enumerate(range(batch - 1, len(times), batch)):
        assert timing.edge(last, captured(times[last])) == USED
        if edges >= 2:
            first = last - batch + 1
            worst = max(worst, abs(timing.slot_ticks(first) / TICKS_PER_US - times[first]))
    assert worst <= 1.0


@pytest.mark.parametrize("nominal_hz", ODRS_HZ)
def test_period_within_20_ppm_of_a_chip_at_minus_6_8_percent(
    make: Callable[..., Timing], nominal_hz: float
) -> None:
    times = slot_times_us(nominal_hz, -0.068, 20.0)
    timing = make(nominal_hz)
    batch = samples_per_batch(nominal_hz)
    true_ticks = TICKS_PER_US * 1e6 / (nominal_hz * (1 - 0.068))
    for last in range(batch - 1, len(times), batch):
        timing.edge(last, captured(times[last]))
        if times[last] > 3e6:
            assert timing.period_ticks == pytest.approx(true_ticks, rel=20e-6)
    assert timing.period_q8 / 256 == pytest.approx(true_ticks, rel=20e-6)


def test_follows_a_chip_that_warms_up(make: Callable[..., Timing]) -> None:
    times = slot_times_us(416.7, -0.068, 60.0, drift_per_s=5e-6)
    timing = make(416.7)
    worst = 0.0
    for last in range(15, len(times), 16):
        timing.edge(last, captured(times[last]))
        if last > 100:
            worst = max(worst, abs(timing.slot_ticks(last - 15) / TICKS_PER_US - times[last - 15]))
    assert worst <= 1.0


def test_believes_what_it_can_know(make: Callable[..., Timing]) -> None:
    """The filter's own sigma is close to the real scatter over many chips."""
    rng = np.random.default_rng(7)
    errors, sigmas = [], []
    for _ in range(300):
        times = slot_times_us(416.7, rng.uniform(-0.07, 0.07), 4.0) + rng.uniform(0, 1e4)
        timing = make(416.7)
        for last in range(15, len(times), 16):
            jitter_us = rng.normal(0, 5.0 / TICKS_PER_US)
            timing.edge(last, round(TICKS_PER_US * (times[last] + jitter_us)))
        errors.append(timing.slot_ticks(last) - TICKS_PER_US * times[last])
        sigmas.append(timing.sigma_ticks(last))
    assert np.std(errors) == pytest.approx(np.mean(sigmas), rel=0.25)


def test_a_wrong_edge_is_refused_and_does_no_harm(make: Callable[..., Timing]) -> None:
    times = slot_times_us(416.7, -0.068, 6.0)
    timing = make(416.7)
    results = []
    for number, last in enumerate(range(15, len(times), 16)):
        wrong_us = 400.0 if number in (20, 21, 40, 45, 50) else 0.0
        results.append(timing.edge(last, captured(times[last] + wrong_us)))
        if number > 3:
            assert abs(timing.slot_ticks(last) / TICKS_PER_US - times[last]) <= 1.0
    assert [n for n, result in enumerate(results) if result == REFUSED] == [20, 21, 40, 45, 50]


def test_starts_anew_when_the_chip_has_jumped(make: Callable[..., Timing]) -> None:
    times = slot_times_us(416.7, -0.068, 6.0)
    timing = make(416.7)
    results = []
    for number, last in enumerate(range(15, len(times), 16)):
        jump_us = 1234.0 if number >= 30 else 0.0
        results.append(timing.edge(last, captured(times[last] + jump_us)))
    assert results.count(RESTARTED) == 1
    assert results.index(RESTARTED) == 33, "refused three times, believed the fourth"
    assert abs(timing.slot_ticks(last) / TICKS_PER_US - times[last] - 1234.0) <= 1.0


def test_missing_edges_are_bridged(make: Callable[..., Timing]) -> None:
    times = slot_times_us(1667.0, -0.068, 8.0)
    timing = make(1667.0)
    for last in range(15, len(times), 16):
        if 4e6 < times[last] < 5e6:
            assert abs(timing.slot_ticks(last) / TICKS_PER_US - times[last]) <= 3.0
        else:
            assert timing.edge(last, captured(times[last])) == USED


def test_renumbering_moves_numbers_and_not_times(make: Callable[..., Timing]) -> None:
    times = slot_times_us(104.0, 0.02, 4.0)
    timing = make(104.0)
    for last in range(3, len(times), 4):
        timing.edge(last, captured(times[last]))
    before = timing.slot_ticks(last)
    timing.renumber(4)
    assert timing.slot_ticks(last + 4) == before
    assert timing.slot_at(before + 1) == last + 4
    assert timing.slot_at(before - 1) == last + 3


@pytest.mark.parametrize("nominal_hz", [12.5, 417.0, 6667.0])
def test_slot_at_is_the_last_slot_not_after(make: Callable[..., Timing], nominal_hz: float) -> None:
    times = slot_times_us(nominal_hz, -0.068, 4.0)
    timing = make(nominal_hz)
    batch = samples_per_batch(nominal_hz)
    for last in range(batch - 1, len(times), batch):
        timing.edge(last, captured(times[last]))
    period_us = 1e6 / (nominal_hz * 0.932)
    for slot in (last - 5, last, last + 5):
        t_us = times[last] + (slot - last) * period_us
        assert timing.slot_at(int(TICKS_PER_US * (t_us + 0.1 * period_us))) == slot
        assert timing.slot_at(int(TICKS_PER_US * (t_us - 0.1 * period_us))) == slot - 1


def test_without_edges_time_is_known_to_a_period(make: Callable[..., Timing]) -> None:
    times = slot_times_us(416.7, -0.03, 10.0)
    timing = make(416.7)
    rng = np.random.default_rng(3)
    assert not timing.has_phase
    for last in range(15, len(times) - 1, 16):
        poll_us = rng.uniform(times[last], times[last + 1])
        timing.newest(last, round(TICKS_PER_US * poll_us))
        if times[last] > 3e6:
            assert abs(timing.slot_ticks(last) / TICKS_PER_US - times[last]) < 2400.0
            assert timing.sigma_ticks(last) > TICKS_PER_US, "and it does not claim more"
    # The first edges at once put it right.
    for last in range(len(times) - 60, len(times), 16):
        timing.edge(last, captured(times[last]))
    assert abs(timing.slot_ticks(last) / TICKS_PER_US - times[last]) <= 1.0


def test_a_lone_edge_is_not_the_start_of_a_line(make: Callable[..., Timing]) -> None:
    times = slot_times_us(416.7, -0.03, 4.0)
    timing = make(416.7)
    timing.edge(15, captured(times[15]))
    for last in range(31, 400, 16):
        timing.newest(last, round(TICKS_PER_US * (times[last] + 2000.0)))
    for last in (415, 431):
        assert timing.edge(last, captured(times[last])) == USED
    assert abs(timing.slot_ticks(416) / TICKS_PER_US - times[416]) <= 1.5


def test_losing_the_phase_keeps_the_period_until_the_next_edges(
    make: Callable[..., Timing],
) -> None:
    times = slot_times_us(416.7, -0.068, 4.0)
    timing = make(416.7)
    for last in range(15, len(times), 16):
        timing.edge(last, captured(times[last]))
    period = timing.period_ticks
    timing.lose_phase()
    assert not timing.has_phase
    assert timing.period_ticks == period
    shift_us = 777.0
    for last in range(len(times) - 64, len(times), 16):
        timing.edge(last, captured(times[last] + shift_us))
    assert abs(timing.slot_ticks(last) / TICKS_PER_US - times[last] - shift_us) <= 1.0


@pytest.mark.parametrize("name", ["tennis_serve", "tennis_forehand", "tennis_backhand"])
def test_real_logs_configured_for_104_hz_run_at_96_88_hz(
    make: Callable[..., Timing], name: str
) -> None:
    folder = Path(os.environ.get("HIL_DATA", ROOT.parent / "shared" / "data")) / "lsm6dsox"
    path = folder / f"{name}.txt"
    if not path.is_file():
        pytest.skip(f"no real log at {path}; set HIL_DATA to the folder that holds lsm6dsox/")
    t_us = np.genfromtxt(path, skip_header=1, usecols=0)
    # The log's times jump by a few microseconds now and then.
    timing = make(104.0, edge_sigma_ticks=2 * TICKS_PER_US)
    results = [timing.edge(slot, TICKS_PER_US * int(t)) for slot, t in enumerate(t_us)]
    assert results.count(USED) > 0.99 * len(results)
    rate_hz = 1e6 * TICKS_PER_US / timing.period_ticks
    assert rate_hz == pytest.approx(96.88, abs=0.01)
    assert timing.slot_ticks(len(t_us) - 1) / TICKS_PER_US == pytest.approx(t_us[-1], abs=3.0)
