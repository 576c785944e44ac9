# SPDX-License-Identifier: Apache-2.0
"""Measured beside allowed: how much of an allowance is used, and which check says so."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil.measure import Limits, Measurement
from hil.report import budget, build, html, margin
from tests.unit.report.test_report_views import Page

Make = Callable[..., Any]


def measured(value: float | None, unit: str = "ns", **limits: float) -> dict[str, Any]:
    return Measurement("a", value, unit, Limits(**limits), "T1", "").to_json()


@pytest.mark.parametrize(
    ("value", "unit", "limits", "share"),
    [
        (75.0, "ns", {"high": 150.0}, 0.5),
        (300.0, "ns", {"high": 150.0}, 2.0),
        (-20.0, "ns", {"high": 150.0}, 0.0),
        (0.0, "1", {"high": 0.0}, 0.0),
        (1.0, "1", {"high": 0.0}, math.inf),
        # 0.995 of a share that must be 0.99 lacks half of what it may.
        (0.995, "1", {"low": 0.99}, 0.5),
        (1.0, "1", {"low": 0.99}, 0.0),
        (4000.0, "1", {"low": 3000.0}, 0.75),
        (0.0, "1", {"low": 3000.0}, math.inf),
        # 4500 to 5500: the middle is 5000, and 5250 is half of the way to an end.
        (5250.0, "ns", {"low": 4500.0, "high": 5500.0}, 0.5),
        (4000.0, "ns", {"low": 4500.0, "high": 5500.0}, 2.0),
        (None, "ns", {"high": 150.0}, None),
        (math.nan, "ns", {"high": 150.0}, None),
        (3.0, "ns", {}, None),
    ],
)
def test_share_of_the_allowance(
    value: float | None, unit: str, limits: dict[str, float], share: float | None
) -> None:
    found = margin.used(measured(value, unit, **limits))
    assert found == (share if share is None else pytest.approx(share))


def test_share_in_words() -> None:
    assert [margin.percent(x) for x in (None, 0.0, 0.436, 1.2, math.inf)] == [
        "\u2013",
        "0 %",
        "44 %",
        "120 %",
        "over",
    ]


def sync(name: str, value: float, line: str = "T1") -> Measurement:
    return Measurement(name, value, "ns", Limits(high=100.0), line, "")


def test_the_gravest_check_stands_for_its_line_and_the_others_are_named() -> None:
    rows = [
        {"name": n, "budget": "T1", "verdict": v, "used": u}
        for n, v, u in (("a", "pass", 0.2), ("b", "fail", 3.0), ("c", "pass", 0.9))
    ]
    (line,) = budget.of_run(
        [{"id": "T1", "quantity": "q"}, {"id": "T2", "quantity": "r"}], "run", rows
    )
    assert line["first"]["name"] == "b"
    assert [row["name"] for row in line["others"]] == ["c", "a"]
    assert line["anchor"] == "run/budget/T1"


def test_checks_and_budget_lines_link_to_each_other(recording: Make) -> None:
    document = build(
        [
            (recording("one"), [sync("sync.a", 10.0), sync("sync.b", 90.0)]),
            (recording("two"), [sync("sync.a", 40.0)]),
            (recording("bad", expect_fail=("sync.a",)), [sync("sync.a", 400.0)]),
        ]
    )
    page = Page(html.render(document))
    links = [attrs["href"] for tag, attrs in page.elements if tag == "a"]
    for name in ("one", "two", "bad"):
        assert f"{name}/budget/T1" in page.ids
        assert f"#{name}/budget/T1" in links
        assert f"#{name}/sync.a" in links
    assert "90 %" in page.words
    assert "400 %" in page.words


def test_a_run_made_to_fail_is_not_the_closest_of_all() -> None:
    runs = [
        {"id": name, "entry": {"expect_fail": made}, "rows": [row]}
        for name, made, row in (
            ("sound", [], {"name": "a", "budget": "T1", "verdict": "pass", "used": 0.3}),
            ("bad", ["a"], {"name": "a", "budget": "T1", "verdict": "fail", "used": 9.0}),
        )
    ]
    (line,) = budget.of_all([{"id": "T1"}], runs)
    assert line["closest"]["run"]["id"] == "sound"
    assert line["tally"] == [("fail", 1), ("pass", 1)]
    (line,) = budget.of_all([{"id": "T1"}], runs[1:])
    assert line["closest"]["run"]["id"] == "bad"


def test_rows_among_the_details_are_a_table(recording: Make) -> None:
    rows = [{"true, mm/s": 800.5, "error, mm/s": -1.25}, {"true, mm/s": 810.0, "error, mm/s": 2.0}]
    m = Measurement(
        "sync.a", 1.0, "ns", Limits(high=2.0), "T1", "", details={"peak": rows, "n": 2, "list": [1]}
    )
    page = Page(html.render(build([(recording(), [m])])))
    heads = [
        attrs for tag, attrs in page.elements if tag == "table" and attrs.get("class") == "figures"
    ]
    assert len(heads) == 1
    for text in ("true, mm/s", "800.5", "\u22121.25", "Peak"):
        assert text in page.words
