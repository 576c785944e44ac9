# SPDX-License-Identifier: Apache-2.0
"""The firmware's sync arithmetic against independent mathematics.

The pure half of ``firmware/lib/timesync`` is compiled by the host's compiler, with undefined
behaviour made to trap, and compared with Python integers, exact fractions and NumPy.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
TIMESYNC = ROOT / "firmware" / "lib" / "timesync"
WIRE = ROOT / "firmware" / "lib" / "wire"
SHIM = ROOT / "tests" / "unit" / "c" / "sync_shim.c"

TICK_RATE_HZ = 16_000_000
NS_PER_TICK = 62.5
SUBTICKS = 256
UNSYNCED, CONVERGING, LOCKED, HOLDOVER = range(4)

Ticks = NDArray[np.uint64]
Library = Any


@pytest.fixture(scope="module")
def lib(tmp_path_factory: pytest.TempPathFactory) -> Library:
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    assert compiler, "no C compiler: install gcc, or set CC"
    path = tmp_path_factory.mktemp("sync") / "sync.so"
    sources = [
        TIMESYNC / f"sync_{part}.c" for part in ("math", "event", "pairing", "estimator", "wire")
    ]
    subprocess.run(
        [
            compiler,
            *("-std=c11", "-O2", "-shared", "-fPIC", "-ffp-contract=off"),
            *("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror"),
            *("-fsanitize=undefined,float-cast-overflow", "-fsanitize-undefined-trap-on-error"),
            *("-I", str(TIMESYNC), "-I", str(WIRE), "-o", str(path)),
            *map(str, (SHIM, *sources)),
            "-lm",
        ],
        check=True,
    )
    library = ctypes.CDLL(str(path))
    u64, i64, u32, i32 = ctypes.c_uint64, ctypes.c_int64, ctypes.c_uint32, ctypes.c_int32
    for name, result, arguments in (
        ("sync_tick_extend_past", u64, (u64, u32)),
        ("sync_end_was_tx", ctypes.c_bool, (u32, u32, u32)),
        ("shim_offset_half_ticks", i64, (ctypes.c_void_p,)),
        ("shim_round_trip_ticks", i64, (ctypes.c_void_p,)),
        ("shim_pair_leader_ticks", u64, (ctypes.c_void_p,)),
        ("shim_to_follower", u64, (u64, i64, i32, u64)),
        ("shim_to_leader", u64, (u64, i64, i32, u64)),
        ("shim_period_to_leader", u32, (i32, u32)),
        ("shim_wire_to_model", ctypes.c_bool, (u64, i64, i32, ctypes.c_uint8)),
        ("shim_new", ctypes.c_void_p, ()),
        ("shim_free", None, (ctypes.c_void_p,)),
        ("shim_make_textbook", None, (ctypes.c_void_p, ctypes.c_double, ctypes.c_double)),
        ("shim_add", None, (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)),
        ("shim_build_events", ctypes.c_size_t, None),
        ("shim_pair_up", u32, None),
    ):
        function = getattr(library, name)
        function.restype = result
        if arguments is not None:
            function.argtypes = arguments
    return library


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


# --- wraps ---------------------------------------------------------------------------------------


@given(
    start=st.integers(0, 2**40),
    steps=st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=40),
)
def test_a_count_read_once_per_wrap_is_extended_exactly(
    lib: Library, start: int, steps: list[int]
) -> None:
    start %= 2**32  # the extender begins at zero, so the first reading is below one wrap
    truth = np.cumsum([start, *steps], dtype=np.uint64)
    counts = (truth % 2**32).astype(np.uint32)
    extended = np.zeros_like(truth)
    lib.shim_extend_sequence(pointer(counts), pointer(extended), ctypes.c_size_t(len(truth)))
    np.testing.assert_array_equal(extended, truth)


@given(now=st.integers(2**32, 2**60), age=st.integers(0, 2**32 - 1))
def test_a_capture_less_than_a_wrap_old_is_extended_exactly(
    lib: Library, now: int, age: int
) -> None:
    assert lib.sync_tick_extend_past(now, (now - age) % 2**32) == now - age


# The longest step leaves room for the step back before it: the extender tells directions apart by
# half the counter's range.
@given(
    steps=st.lists(st.integers(-3, 32767 - 6), min_size=1, max_size=60),
)
def test_the_event_counter_is_extended_over_its_wraps(lib: Library, steps: list[int]) -> None:
    truth = np.maximum.accumulate(np.cumsum([3, *map(abs, steps)]))
    # The odd step back: a packet of the event before may be reported late.
    truth = truth - np.array([0, *(3 if step < 0 else 0 for step in steps)])
    events = (truth % 2**16).astype(np.uint16)
    extended = np.zeros(len(truth), np.uint32)
    lib.shim_extend_events(pointer(events), pointer(extended), ctypes.c_size_t(len(truth)))
    np.testing.assert_array_equal(extended, truth)


@given(end=st.integers(0, 2**32 - 1), gap=st.integers(600, 100_000), on_air=st.integers(1, 60_000))
def test_the_nearer_ready_tells_the_direction(
    lib: Library, end: int, gap: int, on_air: int
) -> None:
    ready, other = (end - on_air) % 2**32, (end - on_air - gap) % 2**32
    assert lib.sync_end_was_tx(end, ready, other)
    assert not lib.sync_end_was_tx(end, other, ready)


# --- one pair ------------------------------------------------------------------------------------


def four(l_tx: int, l_rx: int, f_tx: int, f_rx: int) -> Ticks:
    return np.array([l_tx, l_rx, f_tx, f_rx], np.uint64)


@given(
    l_tx=st.integers(0, 2**60),
    turnaround=st.integers(1000, 100_000),
    offset=st.integers(-(2**52), 2**52),
    delay=st.integers(0, 400),
)
def test_a_delay_equal_in_both_directions_cancels(
    lib: Library, l_tx: int, turnaround: int, offset: int, delay: int
) -> None:
    f_rx = l_tx + offset + delay
    f_tx = f_rx + turnaround
    l_rx = f_tx - offset + delay
    pair = four(l_tx, l_rx, f_tx % 2**64, f_rx % 2**64)
    assert lib.shim_offset_half_ticks(pointer(pair)) == 2 * offset
    assert lib.shim_round_trip_ticks(pointer(pair)) == 2 * delay
    assert lib.shim_pair_leader_ticks(pointer(pair)) == (l_tx + l_rx) // 2


@given(ticks=st.lists(st.integers(0, 2**64 - 1), min_size=4, max_size=4))
def test_whatever_a_peer_sends_is_arithmetic_modulo_2_64(lib: Library, ticks: list[int]) -> None:
    pair = np.array(ticks, np.uint64)
    l_tx, l_rx, f_tx, f_rx = ticks
    expected = (f_rx - l_tx + f_tx - l_rx + 2**63) % 2**64 - 2**63
    assert lib.shim_offset_half_ticks(pointer(pair)) == expected


# --- conversion between the clocks ---------------------------------------------------------------

models = st.tuples(
    st.integers(0, 2**50),
    st.integers(-(2**56), 2**56),
    st.integers(-500_000_000, 500_000_000),
)
HOUR = 3600 * TICK_RATE_HZ


def nearest(exact: Fraction) -> int:
    return (exact + Fraction(1, 2)).__floor__()


@given(model=models, dt=st.integers(-HOUR, HOUR))
def test_conversion_to_the_follower_is_the_wire_formula(
    lib: Library, model: tuple[int, int, int], dt: int
) -> None:
    t_ref, offset_subticks, skew_ppt = model
    t = t_ref + HOUR + dt
    exact = t + Fraction(offset_subticks, SUBTICKS) + Fraction(skew_ppt, 10**12) * (t - t_ref)
    got = lib.shim_to_follower(t_ref, offset_subticks, skew_ppt, t)
    # Half a tick of rounding, and half a subtick from rounding the drift first.
    error = (got - exact + 2**63) % 2**64 - 2**63
    assert abs(error) <= Fraction(1, 2) + Fraction(1, 512) + Fraction(1, 10**6)


@given(model=models, dt=st.integers(-HOUR, HOUR))
def test_there_and_back_is_where_it_started(
    lib: Library, model: tuple[int, int, int], dt: int
) -> None:
    t_ref, offset_subticks, skew_ppt = model
    t = t_ref + HOUR + dt
    there = lib.shim_to_follower(t_ref, offset_subticks, skew_ppt, t)
    assert abs(lib.shim_to_leader(t_ref, offset_subticks, skew_ppt, there) - t) <= 1


@given(model=models, dt=st.integers(0, HOUR), step=st.integers(0, HOUR))
def test_conversion_keeps_the_order_of_time(
    lib: Library, model: tuple[int, int, int], dt: int, step: int
) -> None:
    t_ref, offset_subticks, skew_ppt = model
    first = lib.shim_to_leader(t_ref, offset_subticks, skew_ppt, 2**58 + dt)
    second = lib.shim_to_leader(t_ref, offset_subticks, skew_ppt, 2**58 + dt + step)
    assert (second - first) % 2**64 < 2**63


def test_a_whole_offset_converts_without_rounding(lib: Library) -> None:
    for offset in (-(2**44) - 1, -1, 0, 1, 2**44 + 1):
        assert lib.shim_to_follower(0, offset * SUBTICKS, 0, 2**45) == 2**45 + offset
        assert lib.shim_to_leader(0, offset * SUBTICKS, 0, 2**45 + offset) == 2**45


@given(skew_ppt=st.integers(-500_000_000, 500_000_000), period=st.integers(1, 2**31))
def test_a_period_converts_to_the_nearest_subtick(lib: Library, skew_ppt: int, period: int) -> None:
    exact = period / (1 + Fraction(skew_ppt, 10**12))
    assert abs(lib.shim_period_to_leader(skew_ppt, period) - exact) <= Fraction(501, 1000)


@given(
    model=st.tuples(
        st.integers(0, 2**64 - 1),
        st.integers(-(2**63), 2**63 - 1),
        st.integers(-(2**31), 2**31 - 1),
    ),
    state=st.integers(0, 255),
    t=st.integers(0, 2**64 - 1),
)
def test_an_impossible_model_is_refused_and_an_accepted_one_is_safe(
    lib: Library, model: tuple[int, int, int], state: int, t: int
) -> None:
    _, offset_subticks, skew_ppt = model
    possible = state <= HOLDOVER and abs(skew_ppt) <= 500_000_000 and abs(offset_subticks) <= 2**62
    assert lib.shim_wire_to_model(*model, state) == possible
    if possible:  # undefined behaviour would trap and end the process
        lib.shim_to_follower(*model, t)
        lib.shim_to_leader(*model, t)


# --- the estimator -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Estimate:
    t_ref: int
    offset_subticks: int
    skew_ppt: int
    rms: int
    sigma: int
    window_us: int
    pairs_used: int
    pairs_dropped: int
    state: int

    def offset_ticks(self, t_leader: int) -> float:
        skew = self.skew_ppt * 1e-12
        return self.offset_subticks / SUBTICKS + skew * (t_leader - self.t_ref)


class Estimator:
    """The C estimator behind the shim."""

    def __init__(self, lib: Library) -> None:
        self._lib = lib
        self._shim = ctypes.c_void_p(lib.shim_new())

    def close(self) -> None:
        self._lib.shim_free(self._shim)

    def make_textbook(self, wander_per_sqrt_s: float, pair_variance: float) -> None:
        self._lib.shim_make_textbook(self._shim, wander_per_sqrt_s, pair_variance)

    def add(self, pairs: Ticks) -> NDArray[np.bool_]:
        pairs = np.ascontiguousarray(pairs.reshape(-1, 4))
        used = np.zeros(len(pairs), np.uint8)
        self._lib.shim_add(self._shim, pointer(pairs), pointer(used), len(pairs))
        return used.astype(bool)

    def read(self, now: int) -> Estimate:
        kinds = (
            *(ctypes.c_uint64, ctypes.c_int64, ctypes.c_int32),
            *(ctypes.c_uint32,) * 6,
        )
        values = [kind() for kind in kinds]
        self._lib.shim_read(self._shim, ctypes.c_uint64(now), *map(ctypes.byref, values))
        return Estimate(*(value.value for value in values))


@pytest.fixture
def estimator(lib: Library) -> Iterator[Estimator]:
    made = Estimator(lib)
    yield made
    made.close()


DELAY = 80  # 5 us, the radio chain on 2M


def exchange(
    t_s: NDArray[np.float64],
    offset_ticks: NDArray[np.float64],
    noise_ticks: NDArray[np.float64] | float = 0.0,
    start_leader: int = 2**33,
    start_follower: int = 0,
) -> Ticks:
    """Pairs at leader times ``t_s`` with the true offset given; rows l_tx, l_rx, f_tx, f_rx.

    ``noise_ticks`` has shape (n, 4) or is 0; stamps are rounded to whole ticks.
    """
    l_tx = t_s * TICK_RATE_HZ
    f_rx = l_tx + offset_ticks + DELAY
    f_tx = f_rx + 3200
    l_rx = f_tx - offset_ticks + DELAY
    stamps = np.rint(np.column_stack([l_tx, l_rx, f_tx, f_rx]) + noise_ticks).astype(np.int64)
    stamps += np.array([start_leader, start_leader, start_follower, start_follower])
    return stamps.astype(np.uint64)


def middle(pairs: Ticks) -> NDArray[np.int64]:
    return ((pairs[:, 0] + pairs[:, 1]) // 2).astype(np.int64)


def two_way(pairs: Ticks) -> NDArray[np.float64]:
    signed = pairs.astype(np.int64)
    return (signed[:, 3] - signed[:, 0] + signed[:, 2] - signed[:, 1]) / 2


def test_without_wander_it_is_the_least_squares_line(estimator: Estimator) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(400) * 0.0075
    pairs = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, rng.normal(0, 6, (400, 4)), 12345)
    estimator.make_textbook(0.0, 36.0)
    assert estimator.add(pairs).all()
    last = int(middle(pairs)[-1])
    slope, offset = np.polyfit((middle(pairs) - last) / TICK_RATE_HZ, two_way(pairs), 1)
    estimate = estimator.read(last)
    assert estimate.t_ref == last
    # The filter's prior on the skew, 100 ppm, is worth next to nothing beside 400 pairs.
    assert estimate.offset_subticks / SUBTICKS == pytest.approx(offset, abs=0.01)
    assert estimate.skew_ppt * 1e-12 * TICK_RATE_HZ == pytest.approx(slope, abs=0.01)


def random_walk_smoother(
    t_s: NDArray[np.float64], y: NDArray[np.float64], q: float, r: float
) -> tuple[float, float]:
    """Last state of the same model solved as one big least-squares problem, no recursion.

    Unknowns are (offset, rate) at each instant. Rows: the pairs, the walk between neighbours
    whitened by the Cholesky factor of its covariance, and the prior on the first state.
    """
    n = len(t_s)
    rows: list[NDArray[np.float64]] = []
    values: list[float] = []
    for i in range(n):
        row = np.zeros(2 * n)
        row[2 * i] = 1 / np.sqrt(r)
        rows.append(row)
        values.append(y[i] / np.sqrt(r))
    prior = np.zeros(2 * n)
    prior[1] = 1 / (100e-6 * TICK_RATE_HZ)
    rows.append(prior)
    values.append(0.0)
    for i in range(n - 1):
        dt = t_s[i + 1] - t_s[i]
        covariance = q**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        step = np.zeros((2, 2 * n))
        step[:, 2 * i : 2 * i + 2] = -np.array([[1, dt], [0, 1]])
        step[:, 2 * i + 2 : 2 * i + 4] = np.eye(2)
        rows.extend(white @ step)
        values.extend([0.0, 0.0])
    solution = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    return float(solution[-2]), float(solution[-1])


def test_with_wander_it_is_the_best_linear_estimate(estimator: Estimator) -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.005, 0.08, 50))
    wander, variance = 20e-6, 36.0
    rate = 30e-6 * TICK_RATE_HZ + np.cumsum(rng.normal(0, wander * TICK_RATE_HZ * 0.2, 50))
    pairs = exchange(t, np.cumsum(rate * np.gradient(t)), rng.normal(0, 6, (50, 4)))
    estimator.make_textbook(wander, variance)
    assert estimator.add(pairs).all()
    seconds = (middle(pairs) - middle(pairs)[0]) / TICK_RATE_HZ
    y = two_way(pairs)
    offset, rate_last = random_walk_smoother(seconds, y - y[0], wander * TICK_RATE_HZ, variance)
    estimate = estimator.read(int(middle(pairs)[-1]))
    assert estimate.offset_subticks / SUBTICKS == pytest.approx(offset + y[0], abs=0.01)
    assert estimate.skew_ppt * 1e-12 * TICK_RATE_HZ == pytest.approx(rate_last, abs=0.05)


def wandering_offset_ticks(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """-44.8 ppm and two sinusoids of the relative rate: 0.3 ppm in 23 s, 0.05 ppm in 5.3 s."""
    phase = -44.8e-6 * t_s
    for amplitude, period, start in ((0.3e-6, 23.0, 1.0), (0.05e-6, 5.3, 0.7)):
        angle = 2 * np.pi * t_s / period + start
        phase = phase + amplitude * period / (2 * np.pi) * (np.cos(start) - np.cos(angle))
    return phase * TICK_RATE_HZ


def simulator_stamps(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    """Noise of stamps on a 1 us grid."""
    return rng.uniform(-8, 8, (n, 4))


def errors_ns(
    estimator: Estimator, pairs: Ticks, t_s: NDArray[np.float64], latency_s: float = 0.06
) -> NDArray[np.float64]:
    """Error of each estimate, used ``latency_s`` after its newest pair."""
    found = []
    for pair, t in zip(pairs, t_s, strict=True):
        estimator.add(pair)
        now = int(pair[1]) + round(latency_s * TICK_RATE_HZ)
        estimate = estimator.read(now)
        if estimate.state == LOCKED:
            leader_s = t + (now - int(pair[0])) / TICK_RATE_HZ
            truth = wandering_offset_ticks(np.array([leader_s]))[0]
            found.append((estimate.offset_ticks(now) - truth - START_OFFSET) * NS_PER_TICK)
    return np.array(found)


START_OFFSET = -(2**33)


@pytest.mark.parametrize(("interval_s", "limit_ns"), [(0.0075, 150.0), (0.030, 300.0)])
def test_error_under_wander_stays_within_its_budget(
    estimator: Estimator, interval_s: float, limit_ns: float
) -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0, 40, interval_s)
    pairs = exchange(t, wandering_offset_ticks(t), simulator_stamps(rng, len(t)))
    error = errors_ns(estimator, pairs, t)
    assert len(error) > 0.9 * len(t)
    assert np.percentile(np.abs(error), 99) <= limit_ns
    assert abs(np.mean(error)) <= 30.0


def test_sigma_is_honest(lib: Library) -> None:
    """Over many runs the last error, in its own sigmas, has variance one."""
    scores = []
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        t = np.arange(0, 4, 0.0075)
        walk = np.cumsum(rng.normal(0, 0.2e-6 * np.sqrt(0.0075), len(t)))
        offset = np.cumsum((-44.8e-6 + walk) * 0.0075) * TICK_RATE_HZ
        pairs = exchange(t, offset, rng.normal(0, 6.5, (len(t), 4)))
        estimator = Estimator(lib)
        estimator.add(pairs)
        last = int(middle(pairs)[-1])
        estimate = estimator.read(last)
        # Half the turnaround later than its stamp, at 45 ppm: far below a tick.
        error = estimate.offset_ticks(last) - (offset[-1] + START_OFFSET)
        scores.append(error / (estimate.sigma / SUBTICKS))
        estimator.close()
    assert 0.6 < np.mean(np.square(scores)) < 1.6


def test_the_noise_of_the_pairs_is_measured(estimator: Estimator) -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0, 4, 0.0075)
    pairs = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, rng.normal(0, 3, (len(t), 4)))
    estimator.add(pairs)
    # Half the sum of four independent stamps of 3 ticks: 3 ticks.
    assert estimator.read(int(pairs[-1, 1])).rms / SUBTICKS == pytest.approx(3.0, rel=0.15)


def test_lost_pairs_cost_little(lib: Library) -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0, 40, 0.0075)
    pairs = exchange(t, wandering_offset_ticks(t), simulator_stamps(rng, len(t)))
    kept = rng.random(len(t)) > 0.5
    kept[2000:2020] = False  # a burst of 150 ms
    estimator = Estimator(lib)
    error = errors_ns(estimator, pairs[kept], t[kept])
    estimator.close()
    assert np.percentile(np.abs(error), 99) <= 200.0


def test_outliers_are_rejected_and_leave_no_trace(lib: Library) -> None:
    rng = np.random.default_rng(6)
    t = np.arange(0, 10, 0.0075)
    clean = exchange(t, wandering_offset_ticks(t), simulator_stamps(rng, len(t)))
    wrong = np.arange(300, len(t), 20)
    dirty = clean.copy()
    dirty[wrong, 1] += np.uint64(160)  # 10 us late, 5 us in the offset
    estimators = Estimator(lib), Estimator(lib)
    used = estimators[0].add(dirty)
    estimators[1].add(np.delete(clean, wrong, axis=0))
    now = int(clean[-1, 1])
    with_outliers, without = (estimator.read(now) for estimator in estimators)
    for estimator in estimators:
        estimator.close()
    np.testing.assert_array_equal(np.flatnonzero(~used), wrong)
    assert with_outliers.pairs_dropped == len(wrong)
    assert with_outliers.offset_subticks == without.offset_subticks
    assert with_outliers.skew_ppt == without.skew_ppt


def test_captures_of_different_packets_are_told_by_their_round_trip(estimator: Estimator) -> None:
    rng = np.random.default_rng(7)
    t = np.arange(0, 3, 0.0075)
    pairs = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, simulator_stamps(rng, len(t)))
    # The follower's first was the leader's second: one exchange of empty packets later.
    pairs[:, 2:] += np.uint64(2 * 194 * 16)
    pairs[:, 3] -= np.uint64(194 * 16)
    used = estimator.add(pairs)
    assert not used.any()
    assert estimator.read(int(pairs[-1, 1])).state == UNSYNCED


def test_a_restarted_follower_is_found_again(estimator: Estimator) -> None:
    rng = np.random.default_rng(8)
    t = np.arange(0, 3, 0.0075)
    noise = simulator_stamps(rng, len(t))
    before = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, noise)
    after = exchange(t + 3, -44.8e-6 * TICK_RATE_HZ * t, noise, start_follower=-5_000_000)
    assert estimator.add(before).all()
    used = estimator.add(after)
    assert not used[:16].any()
    assert used[16:].all()
    now = int(after[-1, 1])
    estimate = estimator.read(now)
    assert estimate.state == LOCKED
    truth = -(2**33) - 5_000_000 - 44.8e-6 * TICK_RATE_HZ * t[-1]
    assert estimate.offset_ticks(now) == pytest.approx(truth, abs=5)


def test_states_follow_the_silence(estimator: Estimator) -> None:
    rng = np.random.default_rng(9)
    t = np.arange(0, 6, 0.0075)
    pairs = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, simulator_stamps(rng, len(t)))

    def state_after(silence_s: float, last: int) -> int:
        return estimator.read(int(pairs[last, 1]) + round(silence_s * TICK_RATE_HZ)).state

    assert estimator.read(2**33).state == UNSYNCED
    estimator.add(pairs[:100])
    assert state_after(0.01, 99) == CONVERGING
    estimator.add(pairs[100:300])
    assert state_after(0.01, 299) == LOCKED
    assert state_after(0.3, 299) == HOLDOVER
    assert state_after(3.1, 299) == UNSYNCED
    sigmas = [estimator.read(int(pairs[299, 1]) + s * TICK_RATE_HZ).sigma for s in (0, 1, 2)]
    assert sigmas == sorted(sigmas)
    assert sigmas[2] > 2 * sigmas[0]
    # A single pair after a gap of one second locks again: the skew was not forgotten.
    assert estimator.add(pairs[433:440]).all()
    assert state_after(0.01, 439) == LOCKED


def test_the_window_is_one_of_time(estimator: Estimator) -> None:
    rng = np.random.default_rng(10)
    t = np.arange(0, 9, 0.030)
    pairs = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, simulator_stamps(rng, len(t)))
    estimator.add(pairs)
    estimate = estimator.read(int(pairs[-1, 1]))
    assert estimate.pairs_used == 67  # 2 s at 30 ms, both ends
    assert estimate.window_us == pytest.approx(1_980_000, abs=20)


@given(
    shift_leader=st.integers(0, 2**50),
    shift_follower=st.integers(0, 2**50),
)
def test_only_differences_of_time_matter(
    lib: Library, shift_leader: int, shift_follower: int
) -> None:
    rng = np.random.default_rng(11)
    t = np.arange(0, 2, 0.0075)
    pairs = exchange(t, -44.8e-6 * TICK_RATE_HZ * t, simulator_stamps(rng, len(t)))
    shift = np.array([shift_leader, shift_leader, shift_follower, shift_follower], np.uint64)
    plain, shifted = Estimator(lib), Estimator(lib)
    plain.add(pairs)
    shifted.add(pairs + shift)
    now = int(pairs[-1, 1])
    expected, got = plain.read(now), shifted.read(now + shift_leader)
    plain.close()
    shifted.close()
    assert got.offset_subticks - expected.offset_subticks == SUBTICKS * (
        shift_follower - shift_leader
    )
    assert (got.skew_ppt, got.sigma, got.state) == (
        expected.skew_ppt,
        expected.sigma,
        expected.state,
    )


@given(rows=st.lists(st.lists(st.integers(0, 2**64 - 1), min_size=4, max_size=4), max_size=40))
def test_no_pair_can_break_it(lib: Library, rows: list[list[int]]) -> None:
    estimator = Estimator(lib)
    if rows:
        estimator.add(np.array(rows, np.uint64))
    # Pairs that pass the round trip but jump about.
    for row in rows:
        l_tx, offset = row[0] % 2**60, row[1] % 2**54
        estimator.add(four(l_tx, l_tx + 3360, l_tx + offset + 3280, l_tx + offset + 80))
    estimate = estimator.read(2**61)
    estimator.close()
    assert estimate.state in (UNSYNCED, CONVERGING, LOCKED, HOLDOVER)
    assert abs(estimate.skew_ppt) <= 500_000_000


# --- events and their pairing --------------------------------------------------------------------


def build_events(
    lib: Library, central: bool, ends: list[tuple[int, bool, bool, bool, int]]
) -> tuple[list[tuple[int, ...]], int, int]:
    rows = np.array([[int(value) for value in end] for end in ends], np.uint64)
    captures = np.zeros((len(ends), 3), np.uint64)
    events, given_up = ctypes.c_uint32(), ctypes.c_uint32()
    count = lib.shim_build_events(
        ctypes.c_bool(central),
        pointer(rows),
        ctypes.c_size_t(len(ends)),
        pointer(captures),
        ctypes.byref(events),
        ctypes.byref(given_up),
    )
    found = [tuple(int(x) for x in row) for row in captures[:count]]
    return found, events.value, given_up.value


TX, RX = True, False


def test_the_first_exchange_of_an_event_is_kept(lib: Library) -> None:
    ends = [(7, TX, True, True, 100), (7, RX, True, True, 200), (7, TX, True, True, 300)]
    ends += [(7, RX, True, True, 400), (8, TX, True, True, 500), (8, RX, True, True, 600)]
    assert build_events(lib, True, ends) == ([(7, 100, 200), (8, 500, 600)], 2, 0)
    mirrored = [(event, not tx, crc, timely, t) for event, tx, crc, timely, t in ends]
    assert build_events(lib, False, mirrored) == ([(7, 200, 100), (8, 600, 500)], 2, 0)


@pytest.mark.parametrize(
    "spoilt",
    [
        pytest.param([(7, TX, True, True, 100)], id="no answer"),
        pytest.param([(7, TX, True, True, 100), (7, RX, False, True, 200)], id="broken answer"),
        pytest.param([(7, TX, True, True, 100), (7, RX, True, False, 200)], id="late interrupt"),
        pytest.param([(7, RX, True, True, 200)], id="first packet missed"),
        pytest.param([(7, TX, True, True, 100), (7, TX, True, True, 200)], id="answer missed"),
    ],
)
def test_a_spoilt_event_is_given_up_whole(
    lib: Library, spoilt: list[tuple[int, bool, bool, bool, int]]
) -> None:
    # What comes later in the same event is a different exchange from the other node's first.
    more = [(7, TX, True, True, 1100), (7, RX, True, True, 1200)]
    whole = [(8, TX, True, True, 2100), (8, RX, True, True, 2200)]
    tail = more if len(spoilt) > 1 or spoilt[0][1] == RX else []
    captures, events, given_up = build_events(lib, True, spoilt + tail + whole)
    assert captures == [(8, 2100, 2200)]
    assert (events, given_up) == (2, 1)


def pair_up(
    lib: Library, own: list[int], peer: list[int], reset_between: bool = False
) -> tuple[list[int], int]:
    rows = [np.array([[e, 10 * e, 10 * e + 5] for e in side], np.uint64) for side in (own, peer)]
    matched = np.zeros(len(peer), np.uint8)
    unmatched = lib.shim_pair_up(
        pointer(rows[0]),
        ctypes.c_size_t(len(own)),
        pointer(rows[1]),
        ctypes.c_size_t(len(peer)),
        ctypes.c_bool(reset_between),
        pointer(matched),
    )
    return matched.tolist(), unmatched


def test_reports_find_the_capture_of_their_event(lib: Library) -> None:
    assert pair_up(lib, [1, 2, 3, 5], [2, 4, 5, 1]) == ([1, 0, 1, 1], 1)


def test_a_report_counts_once(lib: Library) -> None:
    assert pair_up(lib, [1, 2], [2, 2]) == ([1, 0], 1)


def test_events_of_an_earlier_connection_are_forgotten(lib: Library) -> None:
    assert pair_up(lib, [1, 2], [1, 2], reset_between=True) == ([0, 0], 2)


def test_a_report_too_old_for_the_memory_matches_nothing(lib: Library) -> None:
    assert pair_up(lib, list(range(200)), [50, 72, 199]) == ([0, 1, 1], 1)
