# SPDX-License-Identifier: Apache-2.0
"""INT1 on the analyser as a witness of sample times, with no truth at hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil import timesync
from hil.imu import int1
from hil.imu.batches import Batches
from hil.measure import Verdict
from hil.recording import Recording
from hil.synthesis import Plan, synthesise
from hil.wire.messages import IMU_FLAGS


def batches(decimation: int = 1) -> Batches:
    """Batches of four samples, 1000 ticks apart at the sensor's rate, from tick 10,000 on."""
    index = np.arange(0, 40, 4, dtype=np.int64)
    n = index.size
    return Batches(
        first=index,
        count=np.full(n, 4, np.int64),
        t_first_ticks=10_000 + index * 1000 * decimation,
        period_ticks=np.full(n, 1000.0 * decimation),
        flags=np.full(n, IMU_FLAGS["hardware_time"], np.int64),
        offset=np.arange(n, dtype=np.int64),
        seen_t_ns_bench=np.arange(n, dtype=np.int64),
        samples=np.zeros((4 * n, 6), np.int16),
    )


@pytest.mark.parametrize("decimation", [1, 8])
def test_an_edge_belongs_to_the_nearest_sample(decimation: int) -> None:
    b = batches(decimation)
    end = 10_000 + 40_000 * decimation
    at = np.array([10_000.0, 10_040, 12_990, 17_200, end - 1000 - 7, end - 499, 9_400])
    late = int1.late_ticks(b, decimation, at)
    assert late[:5] == pytest.approx([0, 40, -10, 200, -7])
    assert np.isnan(late[5:]).all()


def test_edges_in_a_hole_or_without_a_hardware_time_are_left_out() -> None:
    b = batches()
    b.flags[3] = 0
    gone = np.arange(10) != 6
    columns = ("first", "count", "t_first_ticks", "period_ticks", "flags")
    held = replace(b, **{name: getattr(b, name)[gone] for name in columns})
    assert np.isnan(int1.late_ticks(held, 1, np.array([23_000.0, 35_000.0]))).all()
    assert int1.late_ticks(held, 1, np.array([21_000.0])) == pytest.approx([0.0])
    silent = replace(b, flags=b.flags * 0)
    assert np.isnan(int1.late_ticks(silent, 1, np.array([10_000.0]))).all()


@pytest.fixture(scope="module")
def sound() -> Recording:
    return synthesise(Plan(duration_s=8.0))


def as_bench(recording: Recording, resolution_ns: float = 10.0) -> Recording:
    return replace(
        recording,
        provenance=replace(recording.provenance, source="bench", scenario={}),
        edges=replace(recording.edges, resolution_ns=resolution_ns),
    )


def test_the_pulses_tie_the_clocks_to_a_microsecond(sound: Recording) -> None:
    sync = timesync.analyse(sound)
    at_ns = np.arange(4_000, 7_500, 13, dtype=np.int64) * 1_000_000
    for role in ("leader", "follower"):
        ticks = int1.node_ticks(sound, role, sync, at_ns)
        assert np.isfinite(ticks).sum() > 200
        error_us = (ticks - sync.truth.clocks[role].ticks(at_ns)) / 16
        assert np.nanmax(np.abs(error_us)) < 0.05


def test_it_works_on_a_bench(sound: Recording) -> None:
    """A bench knows nothing of the simulator's grid, by which its pulse edges are then early."""
    bench = as_bench(sound)
    sync = timesync.analyse(bench)
    assert not sync.truth
    for role in ("leader", "follower"):
        (m,) = int1.measure(bench, role, sync)
        assert m.value is not None
        assert m.value < 2.0
        assert m.uncertainty == pytest.approx(0.01)
        assert m.limits.high == 1.0


def test_a_coarse_analyser_leaves_it_open(sound: Recording) -> None:
    leader = as_bench(sound, resolution_ns=1000.0)
    (m,) = int1.measure(leader, "leader", timesync.analyse(leader))
    assert m.verdict is Verdict.INCONCLUSIVE


def test_a_line_that_nobody_watched(sound: Recording) -> None:
    names = tuple(f"x{n}" if "int1" in n else n for n in sound.edges.channels)
    blind = replace(sound, edges=replace(sound.edges, channels=names))
    (m,) = int1.measure(blind, "leader", timesync.analyse(blind))
    assert m.verdict is Verdict.FAIL
    (m,) = int1.measure(as_bench(blind), "leader", timesync.analyse(as_bench(blind)))
    assert m.verdict is Verdict.UNSET
    assert "no analyser channel" in m.how


@pytest.mark.parametrize("late_us", [-2.0, 2.0])
def test_a_late_edge_shows_by_how_much(sound: Recording, late_us: float) -> None:
    edges = sound.edges
    mine = edges.channel == edges.channels.index("leader.imu_int1")
    t_ns = edges.t_ns_bench + np.where(mine, int(1e3 * late_us), 0)
    moved = replace(sound, edges=replace(edges, t_ns_bench=t_ns))
    (m,) = int1.measure(moved, "leader", timesync.analyse(moved))
    assert m.verdict is Verdict.FAIL
    assert m.details["mean_us"] == pytest.approx(late_us, abs=0.1)
