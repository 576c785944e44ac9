# SPDX-License-Identifier: Apache-2.0
"""The maths of the time sync, on plain arrays and on synthetic recordings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hil import checks, timesync
from hil.measure import Measurement, Verdict
from hil.recording import ClockModel, Recording, WanderTerm
from hil.streams import ROLES
from hil.synthesis import Plan, synthesise
from hil.timesync import fit, model, pairs, pulses, ticks, truth
from hil.wire.codec import decode, encode

RATE = 16_000_000


def ints(*values: int) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


# --- pairs ----------------------------------------------------------------------------------


def caps(*rows: tuple[int, int, int, int]) -> pairs.Captures:
    """Captures from rows of (generation, event, tx, rx), through the wire."""
    data = b"".join(
        encode(
            "sync_capture",
            {"generation": g, "event": e, "tx_end_ticks_node": tx, "rx_end_ticks_node": rx},
            seq,
        )
        for seq, (g, e, tx, rx) in enumerate(rows)
    )
    return pairs.captures(decode(data).messages["sync_capture"])


def test_two_way_offset_and_one_way_bias_by_hand() -> None:
    """Offset 1000, delay 80 both ways: leader sends at 0, follower answers 2400 later."""
    p = pairs.join(caps((1, 5, 0, 2560)), caps((1, 5, 3480, 1080)))
    assert p.offset_ticks.tolist() == [1000.0]
    assert p.one_way_ticks.tolist() == [80.0]
    assert p.t_ticks_leader.tolist() == [1280.0]
    assert p.generation.tolist() == [1]


def test_half_ticks_survive_beyond_32_bit() -> None:
    big = 1 << 40
    p = pairs.join(caps((0, 0, big, big + 10)), caps((0, 0, 2 * big + 6, 2 * big + 3)))
    assert p.offset_ticks.tolist() == [big - 0.5]


def test_pairs_are_joined_by_generation_and_event() -> None:
    leader = caps((1, 7, 70, 71), (1, 9, 90, 91), (2, 7, 170, 171))
    follower = caps((1, 9, 1, 2), (2, 7, 3, 4), (2, 8, 5, 6), (1, 9, 8, 8))
    p = pairs.join(leader, follower)
    assert p.key.tolist() == [(1 << 32) | 9, (2 << 32) | 7]
    assert p.l_tx.tolist() == [90, 170]
    assert p.f_rx.tolist() == [2, 4]
    assert (leader.repeated, follower.repeated) == (0, 1)
    assert len(pairs.join(leader, caps())) == 0


def test_reported_pairs_are_held_against_both_nodes() -> None:
    leader, follower = caps((1, 1, 10, 11), (1, 2, 20, 21)), caps((1, 1, 30, 31))
    reported = pairs.Pairs(
        key=ints((1 << 32) | 1, (1 << 32) | 1, (1 << 32) | 2, (1 << 32) | 2),
        l_tx=ints(10, 10, 20, 22),
        l_rx=ints(11, 11, 21, 21),
        f_tx=ints(30, 33, 40, 40),
        f_rx=ints(31, 31, 41, 41),
    )
    found = pairs.compare(reported, leader, follower)
    assert found.mismatched.tolist() == [False, True, False, True]
    assert found.unverified.tolist() == [False, False, True, True]
    assert pairs.compare(reported, leader, caps()).unverified.all()


# --- fit ------------------------------------------------------------------------------------


def test_lines_equal_numpys_over_an_hour() -> None:
    """Prefix sums over 120,000 pairs agree with a fit of each window to 1e-4 tick."""
    rng = np.random.default_rng(1)
    x = np.arange(120_000) * 480_000.0 + rng.integers(0, 100, 120_000)
    y = 5e9 - 44.8e-6 * x + 3 * np.sin(x / 1e8) + rng.normal(0, 4.6, x.size)
    at = x[[5_000, 60_000, 119_999]] + 1_000.0
    lines = fit.trailing_lines(x, y, at, 2.0 * RATE)
    for i, t in enumerate(at):
        inside = (x > t - 2.0 * RATE) & (x <= t)
        slope, level = np.polyfit(x[inside] - t, y[inside] - y[inside][0], 1)
        assert lines.value[i] == pytest.approx(level + y[inside][0], abs=1e-4)
        assert lines.slope[i] == pytest.approx(slope, abs=1e-12)
        assert lines.points[i] == inside.sum()
        rest = y[inside] - y[inside][0] - level - slope * (x[inside] - t)
        expected = math.sqrt(np.sum(rest**2) / (inside.sum() - 2))
        assert lines.residual_rms[i] == pytest.approx(expected, rel=1e-3)


def test_a_window_with_two_points_gives_no_line() -> None:
    x = np.array([0.0, 1.0, 2.0, 10.0, 11.0])
    lines = fit.trailing_lines(x, 3 * x, np.array([2.0, 11.0, -5.0]), 3.0)
    assert lines.points.tolist() == [3, 2, 0]
    assert lines.slope[0] == pytest.approx(3.0)
    assert np.isnan(lines.value[1:]).all()
    assert np.isnan(fit.trailing_lines(x[:2], x[:2], x, 3.0).value).all()


def test_deviations_show_the_outlier_and_spare_its_neighbours() -> None:
    x = np.arange(100) * 120_000.0
    y = 7e8 - 4e-5 * x
    y[40] += 500.0
    found = fit.deviations(x, y)
    assert found[40] == pytest.approx(500.0, abs=1.0)
    assert np.max(np.abs(np.delete(found, 40))) < 1.0
    assert fit.deviations(x[:3], y[:3]).tolist() == [0.0, 0.0, 0.0]


def test_allan_deviation_of_white_phase_noise() -> None:
    """sqrt(3) sigma / tau, whatever the rate."""
    rng = np.random.default_rng(2)
    t = np.arange(40_000) * 7.5e-3
    tau, deviation = fit.allan_deviation(t, 3.0 - 4.48e-5 * t + rng.normal(0, 3e-7, t.size))
    assert tau[0] == pytest.approx(7.5e-3)
    few = tau < 1.0
    assert deviation[few] == pytest.approx(math.sqrt(3) * 3e-7 / tau[few], rel=0.05)
    assert fit.allan_deviation(t[:10], t[:10])[0].size == 0


# --- wraps ----------------------------------------------------------------------------------


def seen_at(ticks_64: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.rint(ticks_64 * 62.5 + 3e6).astype(np.int64)


def test_extended_ticks_cross_a_wrap_without_a_break() -> None:
    true = np.arange(0, 3 * ticks.WRAP_TICKS, RATE)
    assert ticks.breaks(true, seen_at(true)) == ticks.TickBreaks(0, 0, 2)


def test_ticks_that_were_not_extended_jump_at_each_wrap() -> None:
    true = np.arange(0, 3 * ticks.WRAP_TICKS, RATE)
    assert ticks.breaks(true % ticks.WRAP_TICKS, seen_at(true)).jumps == 2


def test_a_wrap_that_is_extended_late_breaks_twice() -> None:
    true = np.arange(0, 2 * ticks.WRAP_TICKS, RATE)
    late = true.copy()
    late[269:272] -= ticks.WRAP_TICKS
    assert ticks.breaks(late, seen_at(true)).jumps == 2


def test_a_small_step_back_is_counted_apart() -> None:
    true = np.arange(0, RATE, 1000)
    back = true.copy()
    back[50] -= 5000
    assert ticks.breaks(back, seen_at(true)) == ticks.TickBreaks(1, 0, 0)
    assert ticks.breaks(ints(), ints()).total == 0


# --- truth ----------------------------------------------------------------------------------

LEADER = truth.NodeClock(ClockModel(13.7e-6, 12_345.0, (WanderTerm(0.2e-6, 37.0),)), 1_500)
FOLLOWER = truth.NodeClock(ClockModel(-31.1e-6, 45_678.0), 2_345)
BOTH = truth.Truth({"leader": LEADER, "follower": FOLLOWER}, {}, "", True)


def test_node_clock_is_its_own_inverse_to_a_hundredth_of_a_tick() -> None:
    t = np.array([0, 1, RATE, 70 * RATE, 3600 * RATE], dtype=np.int64)
    assert LEADER.ticks(LEADER.true_ns(t)) == pytest.approx(t, abs=0.01)


def test_node_clock_by_hand() -> None:
    """At true time 1 s the follower's local time is 1e6 - 31.1 - 45678 us."""
    assert FOLLOWER.ticks(np.array([1e9]))[0] == pytest.approx(16 * (1e6 - 31.1 - 45_678 - 2_345))


def test_true_offset_and_skew_agree() -> None:
    t = np.arange(1, 100) * float(RATE)
    offset = BOTH.offset_ticks(t)
    assert np.diff(offset) / np.diff(t) == pytest.approx(BOTH.skew(t)[:-1], abs=5e-8)
    assert BOTH.skew(t)[0] == pytest.approx(-44.8e-6, abs=0.3e-6)
    assert BOTH.leader_ticks(t + offset) == pytest.approx(t, abs=0.01)


def radio(count: int = 400, seed: int = 3) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """END edges in local us, and captures in ticks of a TIMER started at 777 us."""
    rng = np.random.default_rng(seed)
    tx = 1_000_000 + 7_500 * np.arange(count) + rng.choice([44, 80, 132], count)
    rx = tx + 150 + rng.choice([44, 236, 496], count)
    edges = np.sort(np.concatenate([tx, rx, np.arange(50_000, 900_000, 30_000)]))
    return edges, 16 * (np.concatenate([tx, rx]) - 777)


def test_vote_finds_the_start_of_the_timer() -> None:
    edges, captured = radio()
    found = truth.vote(edges, captured, upper_us=777 + 2_000)
    assert found is not None
    assert (found.t_start_us, found.share, found.captures) == (777, 1.0, 800)
    assert found.sound
    assert found.runner_up < 0.8


def test_vote_survives_missing_edges_and_wrong_captures() -> None:
    edges, captured = radio()
    captured[::10] += 16 * 33
    found = truth.vote(np.delete(edges, slice(100, 140)), captured, upper_us=5_000)
    assert found is not None
    assert found.t_start_us == 777
    assert 0.8 < found.share < 0.9


def test_vote_on_a_strictly_periodic_pattern_is_not_sound() -> None:
    """Nothing tells one event from the next, but for the ends of the run."""
    edges = 1_000_000 + 7_500 * np.arange(400)
    found = truth.vote(edges, 16 * (edges[10:300] - 777), upper_us=5_000)
    assert found is None or not found.sound


def test_vote_without_captures_or_edges() -> None:
    edges, captured = radio()
    assert truth.vote(edges[:3], captured, 0.0) is None
    assert truth.vote(edges, captured[:3], 0.0) is None
    assert truth.vote(edges, captured, upper_us=-1e12) is None


def test_has_edge() -> None:
    edges = ints(10, 20, 30)
    assert truth.has_edge(edges, ints(10, 11, 30, 31)).tolist() == [True, False, True, False]
    assert truth.has_edge(edges, ints(9, 11, 15, 32), 2).tolist() == [True, True, False, True]
    assert not truth.has_edge(ints(), ints(1)).any()


# --- model ----------------------------------------------------------------------------------


def make_models(rows: list[tuple[int, int, int]]) -> model.Models:
    """Models from rows of (now in s, state, generation), through the wire."""
    data = b""
    stamps, at = [], []
    for seq, (now_s, state, generation) in enumerate(rows):
        at.append(2 * seq + 1)
        stamps.append(now_s * RATE)
        data += encode(
            "sync_state",
            {
                "t_ref_ticks_leader": now_s * RATE - 1600,
                "offset_ticks": 1000 * 256 + 128,
                "skew": -44_800_000,
                "residual_rms_ticks": 512,
                "offset_sigma_ticks": 64,
                "window_us": 2_000_000,
                "pairs_used": 266,
                "pairs_dropped": 0,
                "state": state,
                "generation": generation,
            },
            seq,
        )
    states = decode(data).messages["sync_state"].copy()
    states["offset"] = 2 * np.arange(len(rows)) + 2
    clock = model.Progress(np.array(at, dtype=np.int64), np.array(stamps, dtype=np.int64))
    return model.models(states, clock)


def test_model_by_hand() -> None:
    m = make_models([(10, 2, 1), (11, 2, 1)])
    # 1000.5 ticks, and -44.8 ppm over 1600 + 16e6 ticks.
    at = m.offset_at(ints(0), ints(11 * RATE))
    assert at[0] == pytest.approx(1000.5 - 44.8e-6 * 16_001_600)
    assert m.residual_rms_ticks[0] == 2.0
    assert m.row_in_use(ints(9 * RATE, 10 * RATE, 12 * RATE)).tolist() == [-1, 0, 1]


def test_use_of_a_model_ends_with_the_next_or_with_its_connection() -> None:
    m = make_models([(10, 2, 1), (11, 2, 1), (15, 1, 2), (16, 2, 2)])
    assert (m.until_ticks_leader // RATE).tolist() == [11, 11, 16, 16]


def test_locked_share_counts_time_not_frames() -> None:
    assert model.locked_share(make_models([(1, 1, 1), (2, 2, 1), (5, 3, 1), (6, 3, 1)])) == 0.75
    assert model.locked_share(make_models([(1, 1, 1)])) == 0.0
    assert model.locked_share(make_models([])) == 0.0


def test_locked_share_leaves_out_what_was_asked_for() -> None:
    """Locked 1-5 and 14-18 s, and told to stay away from 5 to 10 s: locked again 4 s after that."""
    m = make_models([(1, 2, 1), (5, 3, 1), (12, 1, 2), (14, 2, 2), (18, 3, 2)])
    assert model.locked_share(m) == pytest.approx(8 / 17)
    away = np.array([[5 * RATE, 10 * RATE]])
    assert model.locked_share(m, away) == 1.0
    # Lock lost at another time still counts, once, however often it was asked for.
    m = make_models([(1, 2, 1), (5, 3, 1), (14, 2, 2), (18, 3, 2), (20, 3, 2)])
    assert model.locked_share(m, away) == pytest.approx(8 / 10)
    assert model.locked_share(m, np.repeat(away, 2, axis=0)) == pytest.approx(8 / 10)
    # Nor is a lock that never comes again put down to the hold: 4 of 20 - 1 - 5 s.
    m = make_models([(1, 2, 1), (5, 3, 1), (20, 3, 1)])
    assert model.locked_share(m, away) == pytest.approx(4 / 14)


def test_time_to_lock_by_generation() -> None:
    m = make_models([(1, 1, 1), (4, 2, 1), (9, 1, 2), (12, 3, 3)])
    times = model.time_to_lock_s(m, {1: RATE, 2: 8 * RATE, 3: 11 * RATE})
    assert times == {1: 3.0, 2: math.inf, 3: math.inf}


# --- pulses ---------------------------------------------------------------------------------


def make_pulses(rows: list[tuple[int, int, bool]]) -> pulses.Pulses:
    """Pulses from rows of (index, compare, late)."""
    data = b"".join(
        encode(
            "pulse",
            {
                "index": i,
                "scheduled_ticks_leader": i * 1000,
                "compare_ticks_node": compare,
                "captured_ticks_node": 0,
                "flags": int(late),
            },
            seq,
        )
        for seq, (i, compare, late) in enumerate(rows)
    )
    return pulses.pulses(decode(data).messages["pulse"])


def test_pulses_are_paired_by_index_and_late_ones_left_out() -> None:
    a = make_pulses([(1, 10, False), (2, 20, False), (3, 30, True), (5, 50, False)])
    b = make_pulses([(2, 21, False), (3, 31, False), (4, 41, False), (5, 51, False)])
    pair = pulses.common(a, b)
    assert pair.leader.index.tolist() == pair.follower.index.tolist() == [2, 5]
    assert pair.follower.compare_ticks_node.tolist() == [21, 51]
    assert a.period_ticks == 1000.0
    assert math.isnan(a.take(ints(0)).period_ticks)


def test_error_is_the_leaders_true_time_minus_the_followers() -> None:
    """The follower's COMPARE one tick too late: its pulse comes 62.5 ns after the leader's."""
    scheduled = 20 * RATE
    due = round(float(scheduled + BOTH.offset_ticks(ints(scheduled))[0]))
    leader, follower = make_pulses([(1, scheduled, False)]), make_pulses([(1, due, False)])
    error = pulses.exact_error_ns(pulses.common(leader, follower), BOTH)[0]
    late = make_pulses([(1, due + 1, False)])
    later = pulses.exact_error_ns(pulses.common(leader, late), BOTH)[0]
    assert abs(error) <= 31.3
    assert later - error == pytest.approx(-62.5, abs=0.1)


def test_leading_edges_of_toggles_and_of_wide_pulses() -> None:
    starts = 1_000_000 * np.arange(5)
    wide = np.sort(np.concatenate([starts, starts + 5_000]))
    assert pulses.leading_edges(starts, 1e6).tolist() == starts.tolist()
    assert pulses.leading_edges(wide, 1e6).tolist() == starts.tolist()
    assert pulses.leading_edges(ints(), 1e6).size == 0


def test_edges_without_a_partner_are_counted() -> None:
    leader = 1_000_000 * np.arange(10)
    follower = np.delete(leader + 300, 4)
    found = pulses.edge_pairs(leader, follower, 1e6, -1.0, 1e9)
    assert found.difference_ns.tolist() == [-300.0] * 9
    assert found.alone == 1
    assert pulses.edge_pairs(leader, ints(), 1e6, -1.0, 1e9).alone == 10


def test_nearest() -> None:
    assert pulses.nearest(ints(0, 10), ints(-3, 4, 6, 99)).tolist() == [3, -4, 4, -89]
    assert pulses.nearest(ints(), ints(1)).tolist() == [math.inf]


# --- whole recordings -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def clean() -> Recording:
    return synthesise(Plan(duration_s=14.0))


def by_name(measurements: list[Measurement]) -> dict[str, Measurement]:
    return {m.name: m for m in measurements}


def test_truth_is_found_without_asking_the_firmware(clean: Recording) -> None:
    sync = timesync.analyse(clean)
    starts = {role: vote.t_start_us for role, vote in sync.truth.votes.items()}
    assert starts == {"leader": 1_500, "follower": 2_345}
    assert all(vote.share == 1.0 for vote in sync.truth.votes.values())


def test_recomputed_pairs_and_line_agree_with_truth(clean: Recording) -> None:
    sync = timesync.analyse(clean)
    # Two roundings to a microsecond, uniform: 408 ns rms.
    assert np.std(sync.pair_error_ns) == pytest.approx(408, rel=0.1)
    rows = np.flatnonzero(sync.refit.points > 200)
    now = sync.models.now_ticks_leader[rows]
    error_ns = (sync.refit.value[rows] - sync.truth.offset_ticks(now)) * 62.5
    assert np.sqrt(np.mean(error_ns**2)) < 40.0
    assert np.max(np.abs(sync.refit.slope[rows] - sync.truth.skew(now))) < 200e-9


def test_the_reported_pairs_are_those_found_here(clean: Recording) -> None:
    sync = timesync.analyse(clean)
    missing = len(sync.pairs) - len(sync.reported.pairs)
    assert 0 <= missing <= 3
    assert not sync.reported_wrong.any()
    assert not sync.agreement.unverified.any()


def test_analysis_is_kept_as_long_as_the_recording(clean: Recording) -> None:
    assert timesync.analyse(clean) is timesync.analyse(clean)


def test_five_minutes_cross_the_wrap_of_the_32_bit_counter() -> None:
    """2^32 ticks are 268.4 s; nothing is lost there."""
    plan = Plan(duration_s=275.0, conn_interval_us=30_000, pulse_period_s=1.0, state_period_s=0.5)
    found = by_name(checks.evaluate(synthesise(plan)))
    assert found["sync.wrap_errors"].details["wraps"] == 1
    assert [m.name for m in found.values() if m.verdict is not Verdict.PASS] == []


def as_source(recording: Recording, source: str) -> Recording:
    provenance = replace(
        recording.provenance,
        source=source,
        scenario={"name": "bench", "duration_s": recording.provenance.scenario["duration_s"]},
    )
    edges = replace(recording.edges, resolution_ns=10.0)
    return replace(recording, provenance=provenance, edges=edges)


EXACT = {
    "sync.error_p99_ns",
    "sync.error_max_ns",
    "sync.error_rms_ns",
    "sync.model_error_p99_ns",
    "sync.model_error_max_ns",
    "sync.model_error_rms_ns",
    "sync.skew_error_ppb",
    "sync.compare_to_edge_max_ns",
    "sync.pair_bias_ns",
    "sync.captures_without_edge",
}


CHIP = {
    f"{suite}.{role}.truth_{name}"
    for suite, names in {
        "imu": ("time_error_us", "period_error_ppm", "samples_wrong"),
        "fifo": ("crc_mismatches", "slots_unread"),
    }.items()
    for role in ("leader", "follower")
    for name in names
}


def test_where_no_truth_is_known_exact_measures_are_unset_and_say_why(clean: Recording) -> None:
    bench = as_source(clean, "bench")
    found = by_name(timesync.measure(bench, timesync.analyse(bench)))
    unset = {name for name, m in found.items() if m.verdict is Verdict.UNSET}
    assert unset == EXACT
    assert all("does not know" in found[name].how for name in unset)
    for name in ("sync.model_vs_refit_p99_ns", "sync.pairs_wrong", "sync.edges_alone"):
        assert found[name].value is not None
        assert found[name].verdict is Verdict.PASS


def test_without_truth_a_late_stamp_is_still_a_wrong_pair() -> None:
    recording = as_source(synthesise(Plan(duration_s=14.0), ["some_captures_late"]), "bench")
    found = by_name(timesync.measure(recording, timesync.analyse(recording)))
    assert found["sync.pairs_wrong"].value == 20
    assert "neighbours" in found["sync.pairs_wrong"].how


@pytest.mark.parametrize("source", ["bench", "sim", "import"])
def test_an_empty_run_measures_nothing_and_says_so(clean: Recording, source: str) -> None:
    """Only what the source cannot give is unset; the rest fails, for it should be there."""
    empty = replace(as_source(clean, source), serial={})
    found = by_name(checks.evaluate(empty))
    good = {name for name, m in found.items() if m.verdict is Verdict.PASS}
    assert good == {"link.recording_lost_blocks", "link.recording_cut"}
    unset = {name for name, m in found.items() if m.verdict is Verdict.UNSET}
    # Samples from a file have no arrival to be late.
    late = {f"node.{role}.line_delay_s" for role in ROLES} if source == "import" else set()
    assert unset == (set() if source == "sim" else EXACT | CHIP | late)


def test_a_bench_without_an_analyser_leaves_the_edges_unset(clean: Recording) -> None:
    bench = as_source(clean, "bench")
    blind = replace(bench, edges=replace(bench.edges, channels=("a", "b", "c", "d")))
    found = by_name(timesync.measure(blind, timesync.analyse(blind)))
    for name in ("sync.edge_error_p99_ns", "sync.edge_error_max_ns", "sync.edges_alone"):
        assert found[name].verdict is Verdict.UNSET
        assert "analyser" in found[name].how


def test_series_are_complete_and_named_once(clean: Recording) -> None:
    names = [s.name for s in checks.series(clean)]
    assert len(names) == len(set(names))
    assert {"sync.error", "sync.offset", "sync.residual", "sync.allan", "sync.edges"} <= set(names)
    known = {m.name for m in checks.evaluate(clean)}
    assert {s.check for s in checks.series(clean) if s.check} <= known
    assert checks.series(replace(clean, serial={})) == []
