# SPDX-License-Identifier: Apache-2.0
"""What the checks say of imported samples: of these what is so, of all else that it was not there.

The samples are made here by hand: 416 Hz, the middle of what the chip may do, gravity along z.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil import checks
from hil.exchange.foreign import Said
from hil.exchange.recorded import imported
from hil.measure import Verdict
from hil.recording import Recording

SAMPLES = 4160
HEADER = ",".join(["t_s", *(f"gyro_{a}_radps" for a in "xyz"), *(f"accel_{a}_mps2" for a in "xyz")])


def made(tmp_path, *, sensors: int, wander: float = 0.0) -> Recording:
    rng = np.random.default_rng(5)
    files = []
    for name in ("leader", "follower")[:sensors]:
        t_s = np.arange(SAMPLES) / 416.0
        t_s += wander * np.sin(t_s)
        gyro = 0.01 * rng.standard_normal((SAMPLES, 3))
        accel = np.array([0.0, 0.0, 9.81]) + 0.02 * rng.standard_normal((SAMPLES, 3))
        files.append(tmp_path / f"{name}.csv")
        np.savetxt(
            files[-1],
            np.column_stack([t_s, gyro, accel]),
            delimiter=",",
            comments="",
            header=HEADER,
        )
    found, _ = imported(files, Said(None, None, None, None, {}), "made", lambda *_: None)
    return found


@pytest.mark.parametrize("sensors", [1, 2])
def test_nothing_fails_that_was_never_there_and_nothing_of_it_passes(tmp_path, sensors):
    found = {m.name: m for m in checks.evaluate(made(tmp_path, sensors=sensors))}
    assert [m.name for m in found.values() if m.verdict is Verdict.FAIL] == []
    for name, one in found.items():
        if name.startswith(("sync.", "node.", "fifo.", "cal.")):
            assert one.verdict is Verdict.UNSET, name
            assert one.how.startswith("not applicable: imported samples came without "), name
    for name in ("imu.leader.rate_hz", "imu.leader.samples_lost", "link.recording_cut"):
        assert found[name].verdict is Verdict.PASS, name
    follower = found["imu.follower.samples_lost"]
    assert follower.verdict is (Verdict.PASS if sensors == 2 else Verdict.UNSET)
    assert sensors == 2 or follower.how.endswith("without a follower")


def test_a_rate_that_wanders_is_no_fault_of_a_period_that_nobody_stated(tmp_path):
    found = {m.name: m for m in checks.evaluate(made(tmp_path, sensors=1, wander=1e-3))}
    period = found["imu.leader.period_error_ppm"]
    assert period.verdict is Verdict.UNSET
    assert period.how.endswith("without a period that a node measured")


def test_without_the_leaders_samples_an_import_fails(tmp_path):
    whole = made(tmp_path, sensors=1)
    found = checks.evaluate(replace(whole, serial={}))
    assert {m.name for m in found if m.verdict is Verdict.FAIL} >= {"imu.leader.rate_hz"}


@pytest.mark.parametrize("source", ["sim", "bench", "synthetic"])
def test_a_run_of_this_rig_without_the_same_messages_fails(tmp_path, source):
    bare = made(tmp_path, sensors=2)
    run = replace(bare, provenance=replace(bare.provenance, source=source))
    failed = {m.name for m in checks.evaluate(run) if m.verdict is Verdict.FAIL}
    assert {"sync.locked_share", "node.leader.hello_errors", "fifo.leader.rate_hz"} <= failed
    assert {"link.tx_dropped", "cal.leader.branch_wrong"} <= failed
