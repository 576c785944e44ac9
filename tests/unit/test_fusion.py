# SPDX-License-Identifier: Apache-2.0
"""The leader's estimator in a recording: inputs as the firmware takes them, frames bit by bit."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil import expected, fusion, timesync
from hil.core import ESTIMATOR_SHA256
from hil.fusion import inputs, measures, parity, replay
from hil.measure import Measurement, Verdict
from hil.motion.imu_model import ImuStream
from hil.motion.lifts import bench
from hil.recording import Recording, SerialStream
from hil.reference.study import simulate
from hil.synthesis import Plan, synthesise
from hil.wire.codec import encode
from hil.wire.messages import TICK_RATE_HZ

BATCH = 8
LATE = 3
"""Leader batches by which the follower's are late."""
STEPS = 1600
RATE_HZ = 416.0


def batch_values(stream: ImuStream, role: int, first: int) -> dict[str, Any]:
    count = min(BATCH, STEPS - first)
    rows = [
        {"gyro_lsb": stream.gyro_lsb[k].tolist(), "accel_lsb": stream.accel_lsb[k].tolist()}
        for k in range(first, first + count)
    ]
    return {
        "source": role,
        "flags": 1,
        "accel_fs_g": 16,
        "gyro_fs_dps": 2000,
        "sample_index": first,
        "t_first_ticks_node": round(float(stream.t_true_s[first]) * TICK_RATE_HZ) + 10**9,
        "period_ticks": round(TICK_RATE_HZ * 256 / RATE_HZ),
        "t_sigma_ticks": 300 * role,
        "temperature_cdegc": 2500,
        "count": count,
        "samples": rows,
    }


@dataclass
class Line:
    """The leader's serial line under construction."""

    data: bytes = b""
    seq: int = 0

    def send(self, name: str, values: dict[str, Any]) -> None:
        self.data += encode(name, values, self.seq & 0xFFFF)
        self.seq += 1


@cache
def streams() -> tuple[ImuStream, ImuStream]:
    lift = bench(1, reps=1)
    return simulate(lift, 3)


@cache
def sent_batches(starts: int = 1) -> bytes:
    line = Line()
    leader, follower = streams()
    for _ in range(starts):
        for number, first in enumerate(range(0, STEPS, BATCH)):
            if number >= LATE:
                line.send("imu_batch", batch_values(follower, 1, first - LATE * BATCH))
            line.send("imu_batch", batch_values(leader, 0, first))
    return line.data


@cache
def synthetic() -> Recording:
    return synthesise(Plan(duration_s=6.0))


def recording_of(data: bytes, **provenance: Any) -> Recording:
    base = synthetic()
    stream = SerialStream(
        np.frombuffer(data, np.uint8), np.zeros(1, np.int64), np.zeros(1, np.int64)
    )
    manifests = {"leader": {"estimator_sha256": ESTIMATOR_SHA256}}
    about = replace(base.provenance, **{"source": "sim", "manifests": manifests, **provenance})
    return replace(base, serial={"leader": stream}, provenance=about)


def frames_of(host: np.ndarray[Any, Any], every: int = 4) -> bytes:
    """EKF and ATTITUDE frames as the firmware would send them, from the host's own steps."""
    line = Line(seq=1000)
    for row in host[host["step"] % every == 0]:
        values = {name: row[mine].tolist() for name, mine in replay.FIELDS.items()}
        line.send(
            "ekf_state",
            {
                **values,
                "t_ticks_leader": int(row["t_ticks"]),
                "step": int(row["step"]),
                "flags": int(row["flags"]),
            },
        )
        values = {name: row[mine].tolist() for name, mine in replay.BASELINE.items()}
        line.send("attitude", {**values, "t_ticks_leader": int(row["t_ticks"])})
    return line.data


@cache
def host() -> np.ndarray[Any, Any]:
    (run,) = inputs.runs(recording_of(sent_batches()))
    return replay.host_steps(run)


def judged(recording: Recording) -> dict[str, Measurement]:
    sync = timesync.analyse(recording)
    return {m.name: m for m in fusion.measure(recording, sync)}


# --- inputs ---------------------------------------------------------------------------------


def test_samples_come_in_the_units_and_at_the_times_of_the_batches() -> None:
    (run,) = inputs.runs(recording_of(sent_batches()))
    leader, follower = streams()
    assert run.params.rate_hz == pytest.approx(RATE_HZ, abs=1e-4)
    np.testing.assert_allclose(run.samples.leader.accel_mps2, leader.accel_mps2[:STEPS], rtol=1e-6)
    np.testing.assert_allclose(run.samples.leader.gyro_radps, leader.gyro_radps[:STEPS], rtol=1e-6)
    since_s = (run.samples.leader.t_ticks - 10**9) / TICK_RATE_HZ
    np.testing.assert_allclose(since_s, leader.t_true_s[:STEPS], atol=1e-7)
    rode = len(run.samples.follower.t_ticks)
    assert rode == STEPS - LATE * BATCH
    np.testing.assert_allclose(
        run.samples.follower.accel_mps2, follower.accel_mps2[:rode], rtol=1e-6
    )
    assert run.samples.follower.t_sigma_s is not None
    assert run.samples.follower.t_sigma_s[0] == pytest.approx(300 / 256 / 16e6)
    # A batch of the follower's is in the stream just before the leader's of its turn.
    first = LATE * BATCH
    assert run.samples.arrival[:9].tolist() == [first] * 4 + [first + 1] * 4 + [first + BATCH]


def test_a_new_start_begins_a_new_run() -> None:
    found = inputs.runs(recording_of(sent_batches(starts=2)))
    assert [len(run.samples.leader.t_ticks) for run in found] == [STEPS, STEPS]
    assert found[0].end == found[1].begin


def test_a_pause_begins_a_new_run() -> None:
    line, (leader, _) = Line(), streams()
    for number in range(10):
        values = batch_values(leader, 0, number * BATCH)
        values["t_first_ticks_node"] += TICK_RATE_HZ // 3 if number >= 6 else 0
        line.send("imu_batch", values)
    found = inputs.runs(recording_of(line.data))
    assert [len(run.samples.leader.t_ticks) for run in found] == [6 * BATCH, 4 * BATCH]


def test_no_batches_no_runs() -> None:
    assert inputs.runs(recording_of(b"")) == []


@given(st.lists(st.booleans(), max_size=400))
def test_who_rides_with_whom(is_own: list[bool]) -> None:
    """Oldest first, at most four a step, none twice, none before it has come."""
    kept, step = inputs.arrivals(np.array(is_own, dtype=bool))
    assert np.all(np.diff(kept) > 0)
    assert np.all(np.diff(step) >= 0)
    assert np.all(np.bincount(step, minlength=1) <= inputs.RIDES_MAX)
    own_before = np.cumsum(is_own)
    came_at = np.flatnonzero(~np.array(is_own, dtype=bool))
    assert all(step[i] >= own_before[came_at[k]] for i, k in enumerate(kept))


def test_the_oldest_are_dropped_when_too_many_wait() -> None:
    is_own = np.array([False] * 70 + [True] * 10)
    kept, step = inputs.arrivals(is_own)
    assert kept.tolist() == list(range(6, 46))
    assert step[:40].tolist() == [k // 4 for k in range(40)]


# --- frames, bit by bit ---------------------------------------------------------------------


def test_frames_of_the_same_steps_are_the_same() -> None:
    found = judged(recording_of(sent_batches() + frames_of(host())))
    assert found["ekf.core_mismatches"].value == 0
    assert found["ekf.core_mismatches"].verdict is Verdict.PASS
    for name in ("ekf.reference_error", "ekf.float_velocity_error_mps", "ekf.frames_per_step"):
        assert found[name].verdict is Verdict.PASS, found[name]


@pytest.mark.parametrize(
    ("field", "says"),
    [("v", "velocity_mps[2]"), ("q_madgwick", "baseline"), ("flags", "flags"), ("t_ticks", "time")],
)
def test_one_bit_is_found_and_named(field: str, says: str) -> None:
    changed = host().copy()
    row = int(np.flatnonzero(changed["step"] % 4 == 0)[100])
    if field in ("flags", "t_ticks"):
        changed[field][row] ^= 1
    else:
        changed[field][row, 2] = np.nextafter(changed[field][row, 2], np.float32(1e9))
    found = judged(recording_of(sent_batches() + frames_of(changed)))["ekf.core_mismatches"]
    assert found.verdict is Verdict.FAIL
    assert f"step {changed['step'][row]}" in found.how
    assert says in found.how


def test_a_frame_of_a_step_that_never_was_is_found() -> None:
    changed = host().copy()
    changed["step"][-4:] += 4000
    found = judged(recording_of(sent_batches() + frames_of(changed)))["ekf.core_mismatches"]
    assert found.value is not None
    assert found.value >= 1


def test_a_sample_that_the_estimator_did_not_get_is_found() -> None:
    """The firmware's frames are of a run in which one follower batch was missing."""
    (run,) = inputs.runs(recording_of(sent_batches()))
    without = np.r_[0:800, 808 : len(run.samples.arrival)]
    fed = run.samples
    follower = inputs._take(fed.follower, without)
    other = replace(run, samples=replace(fed, follower=follower, arrival=fed.arrival[without]))
    data = sent_batches() + frames_of(replay.host_steps(other))
    assert judged(recording_of(data))["ekf.core_mismatches"].verdict is Verdict.FAIL


def test_another_estimator_is_not_compared() -> None:
    manifests = {"leader": {"estimator_sha256": "0" * 64}}
    recording = recording_of(sent_batches() + frames_of(host()), manifests=manifests)
    found = judged(recording)["ekf.core_mismatches"]
    assert found.verdict is Verdict.UNSET
    assert "another estimator" in found.how


def test_no_frames_is_no_pass() -> None:
    assert judged(recording_of(sent_batches()))["ekf.core_mismatches"].verdict is Verdict.FAIL
    assert judged(recording_of(b""))["ekf.core_mismatches"].verdict is Verdict.FAIL


def test_batches_that_no_estimator_takes_are_a_failed_check_and_no_crash() -> None:
    """Time that stands still within a start."""
    line, (leader, _) = Line(), streams()
    for first in (0, BATCH):
        values = batch_values(leader, 0, first)
        line.send("imu_batch", {**values, "t_first_ticks_node": 10**9})
    found = judged(recording_of(line.data))["ekf.core_mismatches"]
    assert found.verdict is Verdict.FAIL
    assert "cannot be fed to the estimator" in found.how


def test_a_motion_that_is_not_known_here_is_no_truth() -> None:
    scenario = {**synthetic().provenance.scenario, "motion": {"lift": "cartwheel"}}
    recording = recording_of(sent_batches() + frames_of(host()), scenario=scenario)
    assert not any("velocity_rmse" in name for name in judged(recording))


def test_nothing_is_expected_where_no_firmware_ran() -> None:
    assert judged(recording_of(sent_batches(), source="synthetic")) == {}


def test_the_reference_check_fails_on_a_changed_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = parity.run_reference

    def wrong(samples: Any, params: Any) -> Any:
        return honest(samples, replace(params, accel_noise_mps2_rthz=1.2e-3))

    monkeypatch.setattr(parity, "run_reference", wrong)
    (run,) = inputs.runs(recording_of(sent_batches()))
    conditions = timesync.analyse(recording_of(b"")).conditions
    found = {m.name: m for m in measures.reference(run, conditions)}
    assert found["ekf.reference_error"].verdict is Verdict.FAIL


# --- expected outputs -----------------------------------------------------------------------


def test_expected_outputs_are_written_and_a_difference_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = expected.table(recording_of(sent_batches()))
    assert text.count("\n") > 4
    assert len(text.splitlines()[0].split(",")) == len(text.splitlines()[-1].split(","))
    file = tmp_path / "a.csv"
    file.write_text(text)
    assert not expected._differs(file, text)
    assert expected._differs(file, text.replace("e-", "e-1", 1))
    assert "---" in capsys.readouterr().err
    assert expected.table(recording_of(b"")) == ""


def test_expected_outputs_of_the_fixtures(tmp_path: Path) -> None:
    """The command itself: it writes, agrees with what it wrote, and sees a changed file."""
    source = Path(__file__).parents[2] / "fixtures" / "recordings" / "imu-rest"
    shutil.copytree(source, tmp_path / "recordings" / "imu-rest")
    assert expected.main(["--fixtures", str(tmp_path)]) == 0
    assert expected.main(["--fixtures", str(tmp_path), "--check"]) == 0
    (tmp_path / "expected" / "imu-rest.csv").unlink()
    assert expected.main(["--fixtures", str(tmp_path), "--check"]) == 1
