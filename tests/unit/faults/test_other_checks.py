# SPDX-License-Identifier: Apache-2.0
"""Checks that neither an injected nor a synthetic fault reaches, each caught failing here."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil import timesync
from hil.calibration import measures as calibration
from hil.fusion import measures
from hil.fusion.inputs import runs
from hil.fusion.parity import repeat
from hil.imu import measure as judge_imu
from hil.imu import measure_fifo
from hil.measure import Measurement, Verdict
from hil.recording import Recording, SerialStream, load
from hil.streams import frames, seen_t_ns_bench
from hil.wire.messages import IMU_FLAGS

RECORDINGS = Path(__file__).parents[3] / "fixtures" / "recordings"


def failing(found: list[Measurement]) -> set[str]:
    return {m.name for m in found if m.verdict is Verdict.FAIL}


def with_scenario(recording: Recording, change: Callable[[Any], None]) -> Recording:
    scenario = json.loads(json.dumps(recording.provenance.scenario))
    change(scenario)
    return replace(recording, provenance=replace(recording.provenance, scenario=scenario))


def with_leader(recording: Recording, data: np.ndarray[Any, np.dtype[np.uint8]]) -> Recording:
    old = recording.serial["leader"]
    stream = SerialStream(data, old.block_offset, old.block_t_ns_bench)
    return replace(recording, serial={**recording.serial, "leader": stream})


def damaged(recording: Recording, offsets: Any) -> Recording:
    """The frames that begin at ``offsets`` arrive with a byte changed."""
    data = recording.serial["leader"].data.copy()
    at = np.asarray(offsets, dtype=np.int64) + 6
    data[at] = np.where(data[at] == 0x55, 0xAA, 0x55)
    return with_leader(recording, data)


def test_estimates_from_before_the_decision(sound: Recording) -> None:
    """Without the first corrected batches, the first estimates seem to come of none."""
    batches = frames(sound, "leader", "imu_batch")
    corrected = batches[
        (batches["source"] == 0) & ((batches["flags"] & IMU_FLAGS["uncorrected"]) == 0)
    ]
    broken = damaged(sound, corrected["offset"][:200])
    conditions = timesync.analyse(sound).conditions
    assert "cal.leader.early_estimates" not in failing(calibration.measure(sound, conditions))
    assert "cal.leader.early_estimates" in failing(calibration.measure(broken, conditions))


def test_estimates_that_do_not_arrive(sound: Recording) -> None:
    sent = frames(sound, "leader", "ekf_state")["offset"]
    broken = damaged(sound, np.delete(sent, np.s_[::20]))
    conditions = timesync.analyse(sound).conditions
    found = measures.firmware(broken, runs(broken), conditions)
    assert "ekf.frames_per_step" in failing(found)


def test_single_precision_that_errs(sound: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    """In velocity by 1 m/s, in attitude by a few degrees."""
    honest = repeat(run := runs(sound)[-1])
    turned = honest.single.copy()
    turned["v"] += 1.0
    turned["q"] += [0.0, 0.05, 0.0, 0.0]
    monkeypatch.setattr(measures, "repeat", lambda _: replace(honest, single=turned))
    found = failing(measures.reference(run, timesync.analyse(sound).conditions))
    assert {"ekf.float_velocity_error_mps", "ekf.float_attitude_error_deg"} <= found


def test_another_lift_than_was_estimated(sound: Recording) -> None:
    def other(scenario: Any) -> None:
        scenario["motion"] = {"lift": "bench", "seed": 99, "start_s": 4.0}

    lied = with_scenario(sound, other)
    found = measures.truth(lied, timesync.analyse(lied), runs(lied)[-1])
    assert {
        "ekf.mean_velocity_rmse_mmps",
        "ekf.peak_velocity_rmse_mmps",
        "ekf.repetitions_wrong",
        "ekf.false_zupt_frames",
        "ekf.inclination_rmse_deg",
    } <= failing(found) | {m.name for m in found if m.value is None}


def test_an_outage_that_lasts() -> None:
    """After a disconnection asked for, the follower's batches stay away for two seconds."""
    asked = load(RECORDINGS / "reconnect" / "recording.mcap")
    copies = frames(asked, "leader", "imu_batch")
    seen_s = seen_t_ns_bench(asked, "leader", copies) / 1e9
    (first_s, *_) = (e.t_ns_bench / 1e9 for e in asked.events if e.kind == "disconnect")
    away = (copies["source"] == 1) & (seen_s > first_s) & (seen_s < first_s + 2.0)
    longer = damaged(asked, copies["offset"][away])
    name = "imu.follower_at_leader.outage_s"
    assert name not in failing(judge_imu(asked, timesync.analyse(asked)))
    assert name in failing(judge_imu(longer, timesync.analyse(longer)))


def test_a_recovery_that_lasts() -> None:
    """The scenario says that INT1 was missing for a moment, and it was missing for longer."""
    faulty = load(RECORDINGS / "imu-faults" / "recording.mcap")

    def shorter(scenario: Any) -> None:
        scenario["nodes"]["leader"]["imu"]["faults"][4]["duration_s"] = 0.01

    name = "fifo.leader.fault_5_missing_int_recovery_s"
    assert name not in failing(measure_fifo(faulty, timesync.analyse(faulty)))
    said = with_scenario(faulty, shorter)
    assert name in failing(measure_fifo(said, timesync.analyse(said)))
