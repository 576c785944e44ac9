# SPDX-License-Identifier: Apache-2.0
"""Verdicts follow from the numbers alone."""

from __future__ import annotations

import json
import math

import pytest

from hil.measure import Limits, Measurement, Verdict


def measurement(value: float | None, limits: Limits, uncertainty: float = 0.0) -> Measurement:
    return Measurement("sync.error", value, "ns", limits, "T1", "by hand", uncertainty)


@pytest.mark.parametrize(
    ("value", "uncertainty", "limits", "verdict"),
    [
        (None, 0, Limits(high=10), Verdict.UNSET),
        (math.nan, 0, Limits(high=10), Verdict.FAIL),
        (math.nan, 0, Limits(), Verdict.FAIL),
        (math.inf, 0, Limits(high=10), Verdict.FAIL),
        (5, 0, Limits(high=10), Verdict.PASS),
        (10, 0, Limits(high=10), Verdict.PASS),
        (10.1, 0, Limits(high=10), Verdict.FAIL),
        (9.5, 0, Limits(high=10, marginal=1), Verdict.MARGINAL),
        (0.5, 0, Limits(low=0, marginal=1), Verdict.MARGINAL),
        (9.5, 1, Limits(high=10), Verdict.INCONCLUSIVE),
        (11.5, 1, Limits(high=10), Verdict.FAIL),
        (10.5, 1, Limits(high=10), Verdict.INCONCLUSIVE),
        (0, 0, Limits(0, 0), Verdict.PASS),
        (1, 0, Limits(0, 0), Verdict.FAIL),
        (0, 5, Limits(-1, 1), Verdict.INCONCLUSIVE),
        (123, 0, Limits(), Verdict.PASS),
    ],
)
def test_verdict(value: float | None, uncertainty: float, limits: Limits, verdict: Verdict) -> None:
    assert measurement(value, limits, uncertainty).verdict is verdict


def test_only_fail_and_inconclusive_stop_a_run() -> None:
    assert {v for v in Verdict if not v.ok} == {Verdict.FAIL, Verdict.INCONCLUSIVE}


def test_crossed_limits_are_refused() -> None:
    with pytest.raises(ValueError, match="crossed"):
        Limits(2, 1)


def test_json_is_strict_json_even_for_nan() -> None:
    text = json.dumps(measurement(math.nan, Limits(high=10)).to_json(), allow_nan=False)
    assert json.loads(text)["value"] == "nan"


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        (Limits(), "none"),
        (Limits(high=150), "<= 150"),
        (Limits(low=1), ">= 1"),
        (Limits(0, 0), "= 0"),
        (Limits(-1, 1), "-1 .. 1"),
    ],
)
def test_limits_read_as_a_sentence(limits: Limits, text: str) -> None:
    assert str(limits) == text
