# SPDX-License-Identifier: Apache-2.0
"""Are the samples all there, in order and on time? Limits: docs/error-budget.md, lines I."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from hil.measure import Measurement
from tests.hil.conftest import Judge

STREAMS = ("leader", "follower", "follower_at_leader")


@pytest.mark.parametrize("stream", STREAMS)
def test_batches_are_complete_and_in_order(judge: Judge, stream: str) -> None:
    judge(
        f"imu.{stream}.samples_lost",
        f"imu.{stream}.samples_duplicated",
        f"imu.{stream}.batches_out_of_order",
        f"imu.{stream}.overruns",
    )


@pytest.mark.parametrize("stream", ["leader", "follower"])
def test_rate_is_measured(judge: Judge, stream: str) -> None:
    judge(
        f"imu.{stream}.rate_hz",
        f"imu.{stream}.period_error_ppm",
        f"imu.{stream}.time_jitter_us",
    )


@pytest.mark.parametrize("node", ["leader", "follower"])
def test_samples_are_the_chips(
    judge: Judge, measured: Mapping[str, Measurement], node: str
) -> None:
    """Values, times and period against what the chip took, and the interrupt line as a witness."""
    names = ("truth_samples_wrong", "truth_time_error_us", "truth_period_error_ppm")
    present = [f"imu.{node}.{n}" for n in (*names, "int1_error_p99_us")]
    present = [name for name in present if name in measured]
    if not present:
        pytest.skip(f"the {node} had no sensor: its protocol table is older than the driver")
    judge(*present)


def test_leader_has_what_the_follower_sent(judge: Judge) -> None:
    """The leader's copy holds the follower's samples unaltered, on the leader's clock, in time."""
    judge(
        "imu.follower_at_leader.samples_missing",
        "imu.follower_at_leader.samples_altered",
        "imu.follower_at_leader.time_error_p99_ns",
        "imu.follower_at_leader.latency_p99_ms",
    )


def test_nothing_else_of_the_imu_is_wrong(judge: Judge) -> None:
    """Whatever the suite measures beside what is named above."""
    judge("imu.")
