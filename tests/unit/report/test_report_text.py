# SPDX-License-Identifier: Apache-2.0
"""Numbers as people read them."""

from __future__ import annotations

from typing import Any

import pytest

from hil.report import text


def measured(value: Any, unit: str, low: Any = None, high: Any = None, unsure: Any = 0.0) -> Any:
    return text.quantity(
        {
            "value": value,
            "unit": unit,
            "uncertainty": unsure,
            "limits": {"low": low, "high": high, "marginal": 0.0},
        }
    )


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0, "0"),
        (150.0, "150"),
        (41_234.0, "41\u202f234"),
        (1_234_567, "1\u202f234\u202f567"),
        (0.99, "0.99"),
        (-31.1, "−31.1"),
        (92.44444, "92.44"),
        (0.00012346, "0.0001235"),
        (1.5e-9, "1.5e−9"),
        (6.02e23, "6.02e23"),
        ("nan", "not a number"),
        ("inf", "∞"),
        ("-inf", "−∞"),
        (None, "–"),
    ],
)
def test_number(value: Any, expected: str) -> None:
    assert text.number(value) == expected


def test_value_and_limit_share_the_unit_of_the_limit() -> None:
    shown = measured(4.1234e-5, "s", high=1.5e-7)
    assert (shown.measured, shown.allowed) == ("41\u202f234 ns", "≤ 150 ns")


@pytest.mark.parametrize(
    ("value", "unit", "low", "high", "allowed"),
    [
        (3, "1", None, 0.0, "≤ 0"),
        (1.0, "1", 0.99, None, "≥ 0.99"),
        (5003.0, "ns", 4500.0, 5500.0, "4\u202f500 … 5\u202f500 ns"),
        (2.0, "1", 2.0, 2.0, "= 2"),
        (2.0, "us", None, None, "none"),
        (4e-8, "1", None, 2e-7, "≤ 0.2 ppm"),
        (4e-9, "1", None, 2e-9, "≤ 2 ppb"),
    ],
)
def test_limits(value: float, unit: str, low: Any, high: Any, allowed: str) -> None:
    assert measured(value, unit, low, high).allowed == allowed


@pytest.mark.parametrize("value", [150.0000004, 149.9999996])
def test_a_value_next_to_its_limit_is_shown_on_its_own_side(value: float) -> None:
    shown = measured(value, "ns", high=150.0)
    assert shown.value != "150"
    assert (float(shown.value) > 150.0) == (value > 150.0)


def test_uncertainty_is_shown_when_there_is_one() -> None:
    assert measured(92.4, "ns", high=150.0, unsure=2.13).measured == "92.4 ± 2.1 ns"
    assert measured(0, "1", high=0.0, unsure=1.0).measured == "0 ± 1"


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", None])
def test_what_is_no_number_still_has_words(value: Any) -> None:
    assert measured(value, "s", high=5.0).measured
    assert measured(value, "s").measured


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [(60.0, "60 s"), (300.4, "5 min 00 s"), (3600, "1 h 00 min"), (7384, "2 h 03 min")],
)
def test_duration(seconds: float, expected: str) -> None:
    assert text.duration(seconds) == expected


def test_moment_in_utc_and_what_is_none_as_it_is() -> None:
    assert text.moment("2026-11-22T10:30:00+02:00") == "2026-11-22 08:30 UTC"
    assert text.moment("last Tuesday") == "last Tuesday"
