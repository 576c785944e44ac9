# SPDX-License-Identifier: Apache-2.0
"""Does the driver get everything out of the sensor? Limits: docs/error-budget.md, lines F, I1."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest

from hil.measure import Measurement
from tests.hil.conftest import Judge

JudgeRole = Callable[..., None]


@pytest.fixture(params=["leader", "follower"])
def judge_fifo(
    request: pytest.FixtureRequest, measured: Mapping[str, Measurement], judge: Judge
) -> JudgeRole:
    """Judges measurements of one node's FIFO by the last part of their names."""
    prefix = f"fifo.{request.param}."
    if not any(name.startswith(prefix) for name in measured):
        pytest.skip(
            f"the {request.param} had no sensor: its protocol table is older than the FIFO driver"
        )

    def by_name(*names: str) -> None:
        judge(*(prefix + name for name in names))

    return by_name


def test_throughput(judge_fifo: JudgeRole) -> None:
    judge_fifo("rate_hz", "level_max_share", "overruns", "short_reads")


def test_words_are_sound(judge_fifo: JudgeRole) -> None:
    judge_fifo("tag_gaps", "parity_errors", "config_changes")


def test_bus_and_interrupt_work(judge_fifo: JudgeRole) -> None:
    judge_fifo("bus_errors", "bus_occupancy", "missed_edges", "edges_refused", "restarts")


def test_every_sample_of_the_chip_arrives(judge_fifo: JudgeRole) -> None:
    """At the sensor's full rate, whatever the stream is decimated to; needs the chip's truth."""
    judge_fifo("truth_crc_mismatches", "truth_slots_unread")


def test_nothing_else_of_the_fifo_is_wrong(judge_fifo: JudgeRole) -> None:
    """Load, wake-up, injected faults, and whatever else the suite measures."""
    judge_fifo("")
