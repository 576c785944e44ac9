# SPDX-License-Identifier: Apache-2.0
"""Does the leader estimate what the host does, and is it true? Limits: lines K and M."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from hil.measure import Measurement
from tests.hil.conftest import Judge


@pytest.fixture
def judge_ekf(measured: Mapping[str, Measurement], judge: Judge) -> Judge:
    """Judges measurements of the estimator by the last part of their names."""
    if not any(name.startswith("ekf.") for name in measured):
        pytest.skip("the leader had no estimator: its protocol table is older than the fusion")

    def by_name(*names: str) -> None:
        wanted = ["ekf." + name for name in names]
        known = [name for name in wanted if name in measured or name == "ekf."]
        if not known:
            pytest.skip("not measured: the run has no motion whose truth is known")
        judge(*known)

    return by_name


def test_the_firmware_comes_to_the_bits_of_the_host(judge_ekf: Judge) -> None:
    judge_ekf("core_mismatches", "frames_per_step")


def test_the_core_is_the_reference(judge_ekf: Judge) -> None:
    judge_ekf("reference_error", "float_velocity_error_mps", "float_attitude_error_deg")


def test_velocities_of_the_repetitions(judge_ekf: Judge) -> None:
    judge_ekf("mean_velocity_rmse_mmps", "peak_velocity_rmse_mmps", "repetitions_wrong")


def test_attitude_and_stillness(judge_ekf: Judge) -> None:
    judge_ekf("inclination_rmse_deg", "false_zupt_frames")


def test_repetitions_found_on_line_are_those_of_the_definition(judge_ekf: Judge) -> None:
    judge_ekf("rep_frames_wrong", "rep_velocity_error_mmps")


def test_nothing_else_of_the_estimate_is_wrong(judge_ekf: Judge) -> None:
    judge_ekf("")
