# SPDX-License-Identifier: Apache-2.0
"""What the figures of a report show, on runs whose content is known by construction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil import checks, fusion, imu, parity, timesync
from hil.calibration import measures as calibration
from hil.fusion import consistency
from hil.fusion import parity as repeated
from hil.fusion.inputs import runs
from hil.fusion.series import innovations
from hil.imu.fifo_series import counters
from hil.recording import Recording, SerialStream, load
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.series import Series
from hil.synthesis import Plan, synthesise
from hil.timesync.connection_series import phy_in_use
from hil.wire.messages import BOOT_CHECKS

RECORDINGS = Path(__file__).parents[2] / "fixtures" / "recordings"


def named(found: Sequence[Series]) -> dict[str, Series]:
    return {s.name: s for s in found}


def sync_series(recording: Recording) -> dict[str, Series]:
    return named(timesync.series(recording, timesync.analyse(recording)))


@pytest.fixture(scope="module")
def sound() -> Recording:
    return synthesise()


# --- sync ---------------------------------------------------------------------------------------


def test_the_histogram_is_beside_the_budgets_normal(sound: Recording) -> None:
    found = sync_series(sound)
    measured, expected = found["sync.error_histogram"], found["sync.error_expected"]
    assert measured.plot == expected.plot
    assert "27.2 ns" in expected.title
    n, edges = measured.y.sum(), expected.x
    assert n == found["sync.error"].y.size
    # The share of a normal distribution within one sigma is erf(1 / sqrt 2) = 0.6827.
    centre = 0.5 * (edges[1:] + edges[:-1])
    density = expected.y / n / np.diff(edges)
    top = 1.0 / (27.2 * math.sqrt(2.0 * math.pi))
    assert density == pytest.approx(top * np.exp(-0.5 * (centre / 27.2) ** 2), rel=0.02)
    bench = replace(sound, provenance=replace(sound.provenance, source="bench"))
    assert "sync.error_expected" not in sync_series(bench)


def test_each_connection_converges_on_its_own() -> None:
    found = sync_series(synthesise(Plan(reconnect_at_s=8.0)))
    curves = [s for name, s in found.items() if name.startswith("sync.convergence_")]
    assert [s.title for s in curves] == ["connection 1", "connection 2"]
    for curve in curves:
        assert 0.0 <= curve.x[0] < 1.0
        assert curve.x[-1] <= 10.0
        assert np.median(curve.y[-20:]) < 150.0


@pytest.mark.parametrize(("phy", "delay_us", "key"), [(2, 5.0, "2m"), (1, 9.0, "1m")])
def test_one_way_bias_stands_under_its_phy(phy: int, delay_us: float, key: str) -> None:
    found = sync_series(synthesise(Plan(phy=phy, delay_us=delay_us)))
    told = found[f"sync.one_way_{key}"]
    assert np.median(told.y) == pytest.approx(1e3 * delay_us, abs=500.0)
    assert sorted(line.side for line in told.limits) == ["above", "below"]
    # Until the first LINK frame of the connection nobody has said which PHY is in use.
    assert found["sync.one_way_untold"].x[-1] < told.x[0]


def test_the_phy_of_an_earlier_connection_does_not_count() -> None:
    recording = synthesise(Plan(reconnect_at_s=8.0))
    sync = timesync.analyse(recording)
    order = np.argsort(sync.pairs.t_ticks_leader, kind="stable")
    t, generation = sync.pairs.t_ticks_leader[order], sync.pairs.key[order] >> 32
    phy = phy_in_use(recording, t, generation)
    for connection in np.unique(generation):
        mine = phy[generation == connection]
        assert mine[0] == 0
        assert mine[-1] == 2


def test_every_event_without_a_pair_is_counted_once() -> None:
    recording = synthesise(Plan(loss=0.1, duration_s=10.0))
    key = np.sort(timesync.analyse(recording).pairs.key)
    lost = sync_series(recording)["sync.loss_events"]
    assert lost.y.sum() == key[-1] - key[0] + 1 - key.size > 50
    assert sync_series(synthesise())["sync.loss_events"].y.sum() == 0


def test_an_edge_away_from_its_schedule_shows(sound: Recording) -> None:
    before = sync_series(sound)["sync.schedule_follower"]
    assert np.all(np.abs(before.y) <= 1001.0)
    edges = sound.edges
    late = edges.t_ns_bench + np.where(
        edges.channel == edges.channels.index("follower.pulse"), 5000, 0
    )
    order = np.argsort(late, kind="stable")
    moved = replace(
        sound,
        edges=replace(
            edges, t_ns_bench=late[order], channel=edges.channel[order], level=edges.level[order]
        ),
    )
    after = sync_series(moved)["sync.schedule_follower"]
    assert np.median(after.y) - np.median(before.y) == pytest.approx(5000.0, abs=1.0)


def test_the_allan_deviation_of_a_drifting_rate_rises_with_the_averaging_time() -> None:
    """x = a t^2 / 2 has the deviation a tau / sqrt(2) (NIST SP 1065, section 3.1)."""
    t = np.arange(20_000) * 0.03
    tau_s, deviation = timesync.fit.allan_deviation(t, 0.5 * 2e-9 * t**2)
    assert deviation == pytest.approx(2e-9 * tau_s / math.sqrt(2.0), rel=1e-3)


# --- IMU and FIFO ---------------------------------------------------------------------------------


def test_the_latency_from_int1_is_that_of_the_serial_line(sound: Recording) -> None:
    def latency(recording: Recording) -> Series:
        found = named(imu.series(recording, timesync.analyse(recording)))
        return found["fifo.leader.int1_latency"]

    stream = sound.serial["leader"]
    late = SerialStream(stream.data, stream.block_offset, stream.block_t_ns_bench + 3_000_000)
    moved = replace(sound, serial={**sound.serial, "leader": late})
    before, after = latency(sound), latency(moved)
    assert before.y.size > 20
    assert np.all(before.y >= 0.0)
    assert np.median(after.y) - np.median(before.y) == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize("name", ["clean-7ms5", "imu-overrun"])
def test_the_figure_of_slots_leaves_its_limit_when_slots_are_lost(name: str) -> None:
    recording = load(RECORDINGS / name / "recording.mcap")
    sync = timesync.analyse(recording)
    slots = named(imu.series(recording, sync))["fifo.leader.slots"]
    measured = {m.name: m for m in imu.measure_fifo(recording, sync)}
    lost = measured["fifo.leader.truth_slots_unread"].value
    assert lost is not None
    assert (lost > 0) == (name == "imu-overrun")
    assert max(0.0, slots.y[-1] - slots.limits[0].value) == lost
    assert slots.y.min() >= 0.0


def test_only_counters_that_moved_are_drawn(sound: Recording) -> None:
    assert counters(sound, "leader") == []
    broken = load(RECORDINGS / "imu-faults" / "recording.mcap")
    found = counters(broken, "leader")
    measured = {m.name: m.value for m in checks.evaluate_suites(broken)["fifo"]}
    assert len(found) >= 3
    for s in found:
        assert s.y[-1] == measured[s.check] > 0


# --- calibration ----------------------------------------------------------------------------------


def test_decisions_are_rows_with_the_bias_in_force() -> None:
    status = np.zeros(
        4,
        [
            ("boot_check", "u1"),
            ("boot_attempts", "u1"),
            ("boot_delta_dps", "f4"),
            ("gyro_bias_radps", "f4", 3),
        ],
    )
    status["boot_check"] = [BOOT_CHECKS[k] for k in ("pending", "pending", "refused", "refused")]
    status["boot_attempts"][2:] = 1
    status["boot_delta_dps"][2:] = 2.5
    status["gyro_bias_radps"][:, 1] = math.radians(0.5)
    rows = calibration._decisions(status)
    assert [row["boot check"] for row in rows] == ["pending", "refused"]
    assert rows[1]["off the stored bias, dps"] == 2.5
    assert rows[1]["y, dps"] == 0.5


# --- estimator ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lifted() -> Recording:
    return load(RECORDINGS / "clean-7ms5" / "recording.mcap")


def test_state_errors_step_by_step_are_those_that_the_check_sums_up(lifted: Recording) -> None:
    found = repeated.repeat(runs(lifted)[-1])
    largest = parity.relative_errors(found.double, found.reference)
    for state in repeated.STATES:
        steps = repeated.state_errors(found.double, found.reference, state)
        assert steps.max() == pytest.approx(largest[state], rel=1e-12)
    changed = found.double.copy()
    changed["v"][1000:, 2] += 1e-3
    steps = repeated.state_errors(changed, found.reference, "v")
    assert np.flatnonzero(steps > 1e-5)[0] == 1000


def test_tilt_errors_are_those_of_small_turns() -> None:
    outputs = np.zeros(2, [("q", "f8", 4), ("v", "f8", 3)])
    outputs["q"][:, 0] = 1.0
    outputs["v"][:, 2] = [0.25, 0.0]
    c, s = math.cos(0.01), math.sin(0.01)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    velocity = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    found = consistency.errors(outputs, velocity, np.array([about_x, about_z]))
    assert found[0] == pytest.approx([0, 0, 0.75, 0.01, 0], abs=1e-6)
    # Yaw has no reference.
    assert found[1] == pytest.approx(np.zeros(5), abs=1e-6)


def test_an_estimator_that_is_too_sure_leaves_the_band_of_its_nees(lifted: Recording) -> None:
    sync, run = timesync.analyse(lifted), runs(lifted)[-1]
    t_s, honest = consistency.nees(lifted, sync, run)
    assert t_s.size == honest.size > 1000
    assert np.all(np.diff(t_s) > 0)
    assert 0.05 < np.median(honest) < 12.8
    quiet = {
        name: getattr(run.params, name) / 30.0
        for name in ("accel_noise_mps2_rthz", "gyro_noise_radps_rthz")
    }
    sure = replace(run, params=replace(run.params, **quiet))
    assert np.median(consistency.nees(lifted, sync, sure)[1]) > 2.0 * np.median(honest)


def test_innovations_stand_under_the_update_that_made_them() -> None:
    states = np.zeros(5, [("t_ticks_leader", "u8"), ("nis", "f4"), ("gate", "f4"), ("flags", "u2")])
    states["t_ticks_leader"] = np.arange(5) * 16_000_000
    still, rigid = int(Flag.ZUPT), int(Flag.RIGID_GATED)
    states["flags"] = [still, rigid, still | rigid, 0, still]
    states["nis"] = [1.0, 20.0, 3.0, np.nan, np.nan]
    states["gate"] = [16.27, 16.27, 16.27, 0.0, 0.0]
    found = named(innovations(states, Params()))
    assert found["ekf.nis_stillness"].y.tolist() == [1.0]
    assert found["ekf.nis_rigid_body"].y.tolist() == [20.0, 3.0]
    assert found["ekf.nis_rigid_body"].limits[0].value == pytest.approx(16.27)


def test_the_velocity_chart_has_truth_stillness_and_a_table(lifted: Recording) -> None:
    sync = timesync.analyse(lifted)
    found = named(fusion.series(lifted, sync))
    spans = found["ekf.velocity_zero_velocity_updates"]
    still, velocity = np.isfinite(spans.y), found["ekf.velocity_estimate"].y
    assert 0 < still.sum() < still.size
    assert np.abs(velocity[still]).max() < 0.1 < np.abs(velocity).max()
    measured: dict[str, Any] = {m.name: m for m in fusion.measure(lifted, sync)}
    peaks = measured["ekf.peak_velocity_rmse_mmps"]
    rows = peaks.details["peak_velocity"]
    errors = [row["error, mm/s"] for row in rows]
    assert math.sqrt(np.mean(np.square(errors))) == pytest.approx(peaks.value, abs=0.1)
    for row in rows:
        assert row["estimate, mm/s"] - row["true, mm/s"] == pytest.approx(
            errors[rows.index(row)], abs=0.11
        )


def test_a_run_without_truth_has_its_velocity_alone(lifted: Recording) -> None:
    scenario = {k: v for k, v in lifted.provenance.scenario.items() if k != "motion"}
    blind = replace(lifted, provenance=replace(lifted.provenance, scenario=scenario))
    found = named(fusion.series(blind, timesync.analyse(blind)))
    assert "ekf.velocity_estimate" in found
    assert not {"ekf.velocity_truth", "ekf.nees", "ekf.velocity_error"} & set(found)
