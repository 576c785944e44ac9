# SPDX-License-Identifier: Apache-2.0
"""Did the nodes wait for a still second and decide rightly about their calibration? Lines C."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, frames
from hil.wire.messages import BOOT_CHECKS
from tests.hil.conftest import Judge

EXPECTED = {
    "cal-boot": {"leader": "applied", "follower": "warned"},
    "cal-refused": {"leader": "refused", "follower": "applied"},
    "cal-moving": {"leader": "applied", "follower": "applied"},
}
"""Scenario -> what each node's boot check must come to."""


@pytest.fixture
def judge_cal(measured: Mapping[str, Measurement], judge: Judge) -> Judge:
    """Judges measurements of the calibration by the last part of their names."""
    if not any(name.startswith("cal.") for name in measured):
        pytest.skip("the nodes had no boot check: their protocol table is older than it")

    def by_name(*names: str) -> None:
        wanted = [f"cal.{role}.{name}" for role in ROLES for name in names]
        known = [name for name in wanted if name in measured]
        if not known:
            pytest.skip("not measured: the chips' own biases are not known")
        judge(*known)

    return by_name


def test_nodes_wait_for_a_still_second(judge_cal: Judge) -> None:
    judge_cal("ready_s", "early_estimates")


def test_boot_check_decides_by_its_limits(judge_cal: Judge) -> None:
    judge_cal("branch_wrong", "refusal_unsaid")


def test_bias_in_force_is_the_chips(judge_cal: Judge) -> None:
    judge_cal("gyro_bias_error_dps", "boot_delta_error_dps")


def test_branch_that_the_scenario_is_there_for(recording: Recording, judge_cal: Judge) -> None:
    expected = EXPECTED.get(recording.provenance.scenario.get("name", ""))
    if expected is None:
        pytest.skip("the scenario is there for something else")
    for role, branch in expected.items():
        status = frames(recording, role, "cal_status")
        decided = status[status["ready"] == 1]
        assert set(decided["boot_check"].tolist()) == {BOOT_CHECKS[branch]}, role


def test_a_bar_in_hand_is_seen_moving(recording: Recording, judge_cal: Judge) -> None:
    """Reported as moving, window after window, until the bar lies."""
    handled_s = recording.provenance.scenario.get("motion", {}).get("handled_s", 0.0)
    if not handled_s:
        pytest.skip("nobody has the bar in hand in this scenario")
    for role in ROLES:
        status = frames(recording, role, "cal_status")
        assert BOOT_CHECKS["moving"] in status["boot_check"], role
        assert int(status["boot_attempts"][-1]) >= int(handled_s) - 1, role
