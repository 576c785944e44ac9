# SPDX-License-Identifier: Apache-2.0
"""Accounting for IMU samples: every index once, in order, on time, and on the leader."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hil import imu, timesync
from hil.budget import Conditions
from hil.imu import batches as imu_batches
from hil.imu import measures, outages
from hil.imu.batches import Batches, Continuity, batches, continuity, delivery
from hil.measure import Verdict
from hil.recording import Event, Recording
from hil.streams import hold_s
from hil.synthesis import Plan, synthesise
from hil.wire.messages import IMU_FLAGS

RATE = 16_000_000
CONDITIONS = Conditions(conn_interval_us=7_500)
COUNT = 8


def make(first: list[int], period_ticks: float = 38_400.0, t0: int = 0) -> Batches:
    """Batches of eight samples at ``period_ticks``, whose values name their sample."""
    index = np.array(first, dtype=np.int64)
    n = index.size
    samples = np.repeat(index, COUNT) + np.tile(np.arange(COUNT), n)
    return Batches(
        first=index,
        count=np.full(n, COUNT, dtype=np.int64),
        t_first_ticks=np.rint(t0 + index * period_ticks).astype(np.int64),
        period_ticks=np.full(n, period_ticks),
        flags=np.full(n, IMU_FLAGS["hardware_time"], dtype=np.int64),
        offset=np.arange(n, dtype=np.int64) * 100,
        seen_t_ns_bench=np.rint((index + COUNT) * period_ticks * 62.5).astype(np.int64),
        samples=np.repeat(samples.astype(np.int16)[:, None], 6, axis=1),
    )


def starts(n: int) -> list[int]:
    return list(range(0, n * COUNT, COUNT))


@pytest.mark.parametrize(
    ("first", "expected"),
    [
        ([], Continuity(0, 0, 0)),
        ([0, 8, 16, 24], Continuity(0, 0, 0)),
        ([0, 16, 24], Continuity(8, 0, 0)),
        ([0, 8, 8, 16], Continuity(0, 8, 0)),
        ([0, 16, 8, 24], Continuity(0, 0, 1)),
        ([0, 8, 12, 20], Continuity(0, 4, 0)),
        ([0, 8, 16, 0, 24], Continuity(0, 8, 0)),
        ([40, 48, 64, 64, 56, 96], Continuity(24, 8, 1)),
    ],
)
def test_continuity_by_hand(first: list[int], expected: Continuity) -> None:
    index = np.array(first, dtype=np.int64)
    assert continuity(index, np.full(index.size, COUNT, dtype=np.int64)) == expected


@given(
    lost=st.sets(st.integers(1, 48), max_size=10),
    repeated=st.sets(st.integers(0, 49), max_size=10),
)
def test_continuity_counts_what_was_taken_and_added(lost: set[int], repeated: set[int]) -> None:
    kept = [k for k in range(50) if k not in lost]
    sent = [k for k in kept for _ in range(2 if k in repeated else 1)]
    first = np.array(sent, dtype=np.int64) * COUNT
    found = continuity(first, np.full(first.size, COUNT, dtype=np.int64))
    assert found == Continuity(COUNT * len(lost), COUNT * len(repeated - lost), 0)


@given(st.permutations(range(20)))
def test_continuity_never_invents_a_loss(order: list[int]) -> None:
    first = np.array(order, dtype=np.int64) * COUNT
    found = continuity(first, np.full(first.size, COUNT, dtype=np.int64))
    assert (found.lost, found.duplicated) == (0, 0)
    assert (found.out_of_order == 0) == (order == sorted(order))


def test_delivery_finds_the_missing_and_the_altered() -> None:
    own = make(starts(20))
    copy = make([8 * k for k in range(3, 20) if k != 10])
    copy.samples[5, 2] += 1
    assert delivery(own, copy, in_flight=0) == imu_batches.Delivery(8, 1, 128)


def test_delivery_forgives_only_what_may_be_in_flight() -> None:
    own, copy = make(starts(20)), make(starts(17))
    assert delivery(own, copy, in_flight=24).missing == 0
    assert delivery(own, copy, in_flight=16).missing == 8
    assert delivery(own, make([]), in_flight=0).missing == 160


def test_period_and_its_error() -> None:
    b = make(starts(1000), 38_400.5)
    assert imu_batches.sample_period_ticks(b) == pytest.approx(38_400.5, abs=0.01)
    b.period_ticks[:] = 38_400.5 * (1 + 50e-6)
    error = imu_batches.period_error_ppm(b, RATE / 38_400.5)
    assert error == pytest.approx(50.0, abs=1.0)
    assert math.isnan(imu_batches.sample_period_ticks(make([0, 8])))


def test_a_displaced_batch_time_shows_twice() -> None:
    b = make(starts(1500))
    b.t_first_ticks[1200] += 160
    jitter = imu_batches.time_jitter_us(b)
    assert sorted(jitter[np.abs(jitter) > 0.1]) == pytest.approx([-10.0, 10.0])


def test_a_rest_is_taken_out_of_the_times_and_a_stall_is_not() -> None:
    b = make(starts(1500))
    b.t_first_ticks[700:] += 5 * RATE
    b.t_first_ticks[1100:] += RATE // 10
    rested = imu_batches.without_rests(b, 2)
    assert imu_batches.sample_period_ticks(rested) == pytest.approx(38_400.0)
    assert np.max(np.abs(imu_batches.time_jitter_us(rested))) < 0.1
    assert np.max(np.abs(imu_batches.period_error_ppm(rested, RATE / 38_400))) < 1.0
    # Only as many as the node counted: the shorter pause stays.
    once = imu_batches.time_jitter_us(imu_batches.without_rests(b, 1))
    assert np.max(once) == pytest.approx(1e5)
    assert imu_batches.without_rests(b, 0) is b
    # A pause with a hole in the samples, or one too short for a rest, is none.
    hole = make([*starts(700), *(f + 8 for f in starts(1500)[700:])])
    hole.t_first_ticks[700:] += RATE
    kept = imu_batches.without_rests(hole, 1).t_first_ticks
    np.testing.assert_array_equal(kept, hole.t_first_ticks)
    short = make(starts(1500))
    short.t_first_ticks[700:] += RATE // 100
    kept = imu_batches.without_rests(short, 1).t_first_ticks
    np.testing.assert_array_equal(kept, short.t_first_ticks)


def test_times_without_the_hardware_flag_are_not_used() -> None:
    b = make(starts(1500))
    b.t_first_ticks[::5] = 0
    b.flags[::5] = 0
    assert imu_batches.sample_period_ticks(b) == pytest.approx(38_400.0)
    assert np.max(np.abs(imu_batches.time_jitter_us(b))) < 0.1


def test_rate_over_time_follows_the_sensor() -> None:
    t_ns, rate_hz = imu_batches.sample_rate_hz(make(starts(500)))
    assert rate_hz == pytest.approx(RATE / 38_400.0)
    assert np.all(np.diff(t_ns) >= 0)


def test_latency_without_truth_uses_the_leaders_own_clock() -> None:
    recording = synthesise(Plan(duration_s=10.0))
    bench = without_truth(recording)
    sync = timesync.analyse(bench)
    assert not sync.truth
    own = imu_batches.batches(bench, "follower", "follower")
    copy = imu_batches.batches(bench, "leader", "follower")
    with_truth = measures.latency(own, copy, timesync.analyse(recording))
    without = measures.latency(own, copy, sync)
    assert with_truth.value is not None
    assert without.value is not None
    assert with_truth.uncertainty == 0.0
    assert without.uncertainty == 7.5
    assert without.value == pytest.approx(with_truth.value, abs=without.uncertainty)
    error = measures.time_error(own, copy, sync)
    assert error.verdict is Verdict.PASS
    assert "captures" in error.how


def without_truth(recording: Recording) -> Recording:
    return replace(recording, provenance=replace(recording.provenance, source="bench"))


def test_nominal_rate_is_the_scenarios_or_the_nearest() -> None:
    b: Batches = make(starts(1000), RATE / 193.86)
    given_rate = {m.name: m for m in measures.timing("imu.x", b, CONDITIONS, 208.0)}
    nearest = {m.name: m for m in measures.timing("imu.x", b, CONDITIONS, None)}
    other = {m.name: m for m in measures.timing("imu.x", b, CONDITIONS, 416.0)}
    assert given_rate["imu.x.rate_hz"].limits == nearest["imu.x.rate_hz"].limits
    assert given_rate["imu.x.rate_hz"].verdict is Verdict.PASS
    assert other["imu.x.rate_hz"].verdict is Verdict.FAIL


def test_reading_of_batches_keeps_samples_with_their_index() -> None:
    recording = synthesise(Plan(duration_s=4.0))
    own = imu_batches.batches(recording, "follower", "follower")
    copy = imu_batches.batches(recording, "leader", "follower")
    assert own.samples.shape == (int(own.count.sum()), 6)
    assert own.sample_index.tolist() == list(range(own.samples.shape[0]))
    rows: NDArray[np.int64] = copy.sample_index
    assert np.array_equal(copy.samples, own.samples[rows])
    assert imu_batches.batches(recording, "follower", "leader").samples.shape == (0, 6)


def test_every_measurement_exists_even_for_silence() -> None:
    full = synthesise(Plan(duration_s=6.0))
    silent = synthesise(Plan(duration_s=6.0), ["no_batches"])
    names = [[m.name for m in imu.measure(r, timesync.analyse(r))] for r in (full, silent)]
    assert names[0] == names[1]


def outage_run(hold_ms: int = 0) -> tuple[Recording, Batches]:
    """A second of the leader's copy with a hole of 0.4 s, and a disconnection in the middle."""
    first = np.concatenate([np.arange(0, 100, 4), np.arange(260, 360, 4)])
    seen = np.asarray(first / 400 * 1e9 + 2e7, dtype=np.int64)
    copy = replace(
        batches(synthesise(Plan(duration_s=2.0)), "leader", "follower"),
        first=first,
        count=np.full(first.size, 4),
        seen_t_ns_bench=seen,
    )
    event = Event(300_000_000, "disconnect", "leader", {"hold_ms": hold_ms})
    return replace(synthesise(Plan(duration_s=2.0)), events=(event,)), copy


def test_a_hole_around_a_disconnection_asked_for_is_an_outage() -> None:
    recording, copy = outage_run(hold_ms=100)
    (found,) = outages.asked_for(recording, copy)
    assert (found.first, found.end, found.samples) == (100, 260, 160)
    # From the batch of sample 96 to that of 260 at 400 Hz, less the hold.
    assert found.duration_s == pytest.approx(0.41 - 0.1)
    obeyed, measured = outages.measure(recording, [found], Conditions(7500.0))
    assert measured.verdict is Verdict.PASS
    assert (obeyed.value, obeyed.verdict) == (pytest.approx(0.31), Verdict.PASS)
    slow = replace(found, duration_s=1.2)
    _, measured = outages.measure(recording, [slow], Conditions(7500.0))
    assert measured.verdict is Verdict.FAIL


def test_a_hold_that_is_not_obeyed_fails() -> None:
    recording, copy = outage_run(hold_ms=5000)
    asked = outages.asked_for(recording, copy)
    obeyed, measured = outages.measure(recording, asked, Conditions(7500.0))
    assert obeyed.name == "imu.follower_at_leader.hold_exceeded_s"
    assert obeyed.value == pytest.approx(0.41 - 5.0)
    assert obeyed.verdict is Verdict.FAIL
    # An interruption that takes no time is well below every limit of L7.
    assert measured.verdict is Verdict.PASS
    # A hold around which nothing is missing was not obeyed either.
    assert outages.measure(recording, [], Conditions(7500.0))[0].verdict is Verdict.FAIL
    unheld, _ = outage_run()
    assert len(outages.measure(unheld, asked, Conditions(7500.0))) == 1


@pytest.mark.parametrize("asked", [None, "long", -5, math.nan, math.inf])
def test_a_hold_that_is_no_time_is_none(asked: object) -> None:
    assert hold_s(Event(0, "disconnect", "leader", {"hold_ms": asked})) == 0.0


def test_a_hole_elsewhere_is_none() -> None:
    recording, copy = outage_run()
    early = Event(50_000_000, "disconnect", "leader", {})
    assert outages.asked_for(replace(recording, events=(early,)), copy)[0].first == 100
    late = Event(700_000_000, "disconnect", "leader", {})
    assert outages.asked_for(replace(recording, events=(late,)), copy) == []
    note = Event(300_000_000, "note", "leader", {})
    assert outages.asked_for(replace(recording, events=(note,)), copy) == []
    assert outages.measure(replace(recording, events=(note,)), [], Conditions(7500.0)) == []
