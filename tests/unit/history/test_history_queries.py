# SPDX-License-Identifier: Apache-2.0
"""What a history answers, with answers worked out by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.history import queries
from hil.history.store import History, open_history

Make = Callable[..., dict[str, Any]]
NAME = "sync.error_p99_ns"


@pytest.fixture
def history(tmp_path: Path) -> Iterator[History]:
    with open_history(tmp_path / "history.sqlite", create=True) as opened:
        yield opened


def test_runs_are_listed_by_the_time_of_recording(
    history: History, entry: Make, document: Make
) -> None:
    zoned = entry(2)
    zoned["provenance"]["created_utc"] = "2026-01-03T23:00:00+14:30"  # 08:30 UTC
    history.add(document(entry(3), entry(1), zoned))
    assert [r.name for r in queries.runs(history)] == ["run-3", "run-2", "run-1"]
    assert [r.created_utc[:16] for r in queries.runs(history)][1] == "2026-01-03T08:30"


def test_the_trend_of_each_scenario_and_source_stands_alone(
    history: History, entry: Make, document: Make
) -> None:
    history.add(
        document(
            entry(1, 1.0),
            entry(2, 2.0, scenario="lossy"),
            entry(3, 3.0, source="bench"),
            entry(4, 4.0),
            entry(5, 5.0, name="other"),
        )
    )
    found = {
        (t.scenario, t.source): [p.value for p in t.points] for t in queries.trends(history, NAME)
    }
    assert found == {
        ("clean", "sim"): [1.0, 4.0],
        ("lossy", "sim"): [2.0],
        ("clean", "bench"): [3.0],
    }
    (one,) = queries.trends(history, NAME, scenario="clean", source="bench")
    assert [p.value for p in one.points] == [3.0]
    assert queries.trends(history, "absent") == []
    assert queries.names(history) == ["other", NAME]


def test_a_step_is_marked_at_the_run_that_brought_it(
    history: History, entry: Make, document: Make
) -> None:
    values = [60.0 + n % 3 for n in range(12)] + [None] + [90.0 + n % 3 for n in range(12)]
    history.add(document(*(entry(n, v) for n, v in enumerate(values))))
    (trend,) = queries.trends(history, NAME)
    (change,) = trend.changes
    assert (change.kind, change.before, change.after) == ("step", 61.0, 91.0)
    # Run 12 was not measured, and is no run of the trend.
    assert trend.points[trend.measured[change.start]].created_utc.startswith("2026-01-14")
    (dull,) = (
        t.changes for t in queries.trends(history, NAME, scenario="clean") if t.source == "sim"
    )
    assert dull == trend.changes


def test_the_uncertainty_of_the_runs_reaches_the_trend(
    history: History, entry: Make, document: Make
) -> None:
    values = [60.0 + n % 3 for n in range(12)] + [65.0 + n % 3 for n in range(12)]
    history.add(document(*(entry(n, v, uncertainty=4.0) for n, v in enumerate(values))))
    (trend,) = queries.trends(history, NAME)
    assert trend.changes == ()  # 5 is less than sqrt(4^2 + 4^2) = 5.66


def test_the_flake_rate_is_a_share_of_groups(history: History, entry: Make, document: Make) -> None:
    history.add(
        document(
            entry(1, 92.0, build="aaaa"),
            entry(2, 999.0, build="aaaa"),
            entry(3, 92.0, build="bbbb"),
            entry(4, 92.0, build="bbbb"),
            # Alone, or alike in all but one thing: no repetition of anything.
            entry(5, 999.0, build="cccc"),
            entry(6, 999.0, build="bbbb", scenario="lossy"),
            entry(7, 999.0, build="bbbb", source="bench"),
            entry(8, 1.0, build="aaaa", name="steady"),
            entry(9, 2.0, build="aaaa", name="steady"),
        )
    )
    assert queries.flakes(history) == [
        queries.Flake(NAME, 2, 1, {"pass": 3, "fail": 1}),
        queries.Flake("steady", 1, 0, {"pass": 2}),
    ]
    assert [f.rate for f in queries.flakes(history)] == [0.5, 0.0]


def test_one_run_judged_twice_is_no_flake(history: History, entry: Make, document: Make) -> None:
    history.add(document(entry(1, 200.0)))
    history.add(document(entry(1, 200.0, high=300.0), when="2026-12-01T00:00:00+00:00"))
    assert queries.flakes(history) == []


def test_a_retry_within_one_report_is_a_flake_and_hides_nothing(
    history: History, entry: Make, document: Make
) -> None:
    retried, sound = entry(1, 999.0), entry(2, 92.0)
    retried["measurements"].append({**sound["measurements"][0], "id": f"{NAME}-2"})
    history.add(document(retried, sound))
    (flake,) = queries.flakes(history)
    assert (flake.groups, flake.differing, dict(flake.verdicts)) == (1, 1, {"pass": 2, "fail": 1})
    (trend,) = queries.trends(history, NAME)
    assert [p.verdict.value for p in trend.points] == ["fail", "pass", "pass"]


def test_runs_of_unknown_images_are_no_group(history: History, entry: Make, document: Make) -> None:
    for number, value in ((1, 92.0), (2, 999.0)):
        unknown = entry(number, value)
        unknown["provenance"]["images"] = {}
        history.add(document(unknown))
    assert queries.flakes(history) == []
