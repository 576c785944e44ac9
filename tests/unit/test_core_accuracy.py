# SPDX-License-Identifier: Apache-2.0
"""The core's accuracy on seeded sets, held to the limits of docs/estimator.md, section 9."""

from __future__ import annotations

import dataclasses

import pytest

from hil.accuracy import Score, faults, study, table
from hil.motion.repetitions import Concentric

SETS = 20


@pytest.fixture(scope="module")
def scores() -> list[Score]:
    return study(range(SETS))


def test_twenty_sets_of_each_kind_keep_to_the_limits(scores):
    assert {s.rests for s in scores} == {False, True}
    assert len(scores) == 2 * SETS
    assert not faults(scores), table(scores)


def moved(phase: Concentric, by_mps: float) -> Concentric:
    return dataclasses.replace(
        phase, mean_mps=phase.mean_mps + by_mps, peak_mps=phase.peak_mps + by_mps
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: {"pairs": [(a, moved(b, 0.05)) for a, b in s.pairs]}, "mean_rmse"),
        (lambda s: {"pairs": [(a, moved(b, -0.05)) for a, b in s.pairs]}, "peak_rmse"),
        (lambda s: {"missed": [s.pairs[0][0]]}, "missed"),
        (lambda s: {"invented": [s.pairs[0][1]]}, "invented"),
        (lambda _: {"false_zupt": 1}, "false_zupt"),
        (lambda _: {"nees_mean": 20.0}, "NEES in its band"),
        (lambda _: {"nees_above": 0.1}, "NEES above its band"),
    ],
)
def test_the_limits_can_fail(scores, change, message):
    for rests in (False, True):
        kind = [s for s in scores if s.rests == rests]
        wrong = [dataclasses.replace(s, **change(s)) for s in kind]
        assert any(message in line for line in faults(wrong))
