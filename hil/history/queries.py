# SPDX-License-Identifier: Apache-2.0
"""What a history is asked: the runs, the trend of a measurement, which checks are flaky."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from hil.history.changes import Change, find
from hil.history.store import History
from hil.measure import Verdict


@dataclass(frozen=True)
class Run:
    """One run, as it was judged last; ``outcomes`` are those of all its judgements, by time."""

    created_utc: str
    name: str
    source: str
    scenario: str
    build: str
    outcome: str
    outcomes: tuple[str, ...]


@dataclass(frozen=True)
class Point:
    """One measurement of one run, as it was judged last.

    Attributes:
        value: in ``unit``; None where nothing was measured or the value is no number.
        uncertainty: half width in ``unit``; None when it is no number.
        repeats: equal for runs of the same images and scenario on the same source, or empty.
    """

    run: int
    created_utc: str
    judged_utc: str
    judgement: int
    source: str
    scenario: str
    build: str
    repeats: str
    id: str
    name: str
    value: float | None
    uncertainty: float | None
    low: float | None
    high: float | None
    marginal: float | None
    unit: str
    verdict: Verdict
    expected_fail: bool
    budget: str

    @classmethod
    def of(cls, **columns: Any) -> Point:
        """Of the columns of a row.

        Raises:
            ValueError: a verdict that there is not.
        """
        verdict, ordered = Verdict(columns.pop("verdict")), bool(columns.pop("expected_fail"))
        return cls(**columns, verdict=verdict, expected_fail=ordered)


@dataclass(frozen=True)
class Trend:
    """One measurement over all runs of one scenario on one source, and where it changed."""

    name: str
    source: str
    scenario: str
    points: tuple[Point, ...]
    changes: tuple[Change, ...]
    measured: tuple[int, ...]
    """Indices into ``points`` of those with a value; ``changes`` count these."""


@dataclass(frozen=True)
class Flake:
    """How steady one check is.

    Attributes:
        groups: groups of at least two runs with equal images, scenario and source.
        differing: groups in which the verdicts differ.
        verdicts: verdict -> how often, in those groups.
    """

    name: str
    groups: int
    differing: int
    verdicts: Mapping[str, int]

    @property
    def rate(self) -> float:
        return self.differing / self.groups


_POINTS = """
    SELECT run.id AS run, run.created_utc, judgement.judged_utc, judgement.id AS judgement,
           run.source, run.scenario, run.build, run.repeats, measurement.id, measurement.name,
           value, uncertainty, low, high, marginal, unit, measurement.verdict, expected_fail, budget
    FROM measurement
    JOIN judgement ON judgement.id = measurement.judgement
    JOIN run ON run.id = judgement.run
"""
_ORDER = " ORDER BY run.created_utc, run.id, judgement.judged_utc, judgement.id, measurement.id"

_LAST = """
    WITH said AS (
        SELECT measurement.name, run.repeats, run.id AS run, measurement.verdict,
               rank() OVER (
                   PARTITION BY run.id, measurement.name
                   ORDER BY judged_utc DESC, judgement.id DESC
               ) AS age
        FROM run
        JOIN judgement ON judgement.run = run.id
        JOIN measurement ON measurement.judgement = judgement.id
        WHERE run.repeats <> ''
    )
"""
_VERDICTS = (
    _LAST  # noqa: S608 (constants)
    + """
    SELECT name, repeats, verdict, count(*) AS times FROM said
    WHERE age = 1 GROUP BY name, repeats, verdict
"""
)
_REPEATED = (
    _LAST  # noqa: S608 (constants)
    + """
    SELECT name, repeats FROM said
    WHERE age = 1 GROUP BY name, repeats HAVING count(DISTINCT run) > 1
"""
)


def runs(history: History) -> list[Run]:
    """All runs, the latest first."""
    rows: list[dict[str, Any]] = history.rows(
        """
        SELECT run.id, created_utc, name, source, scenario, build, outcome
        FROM run JOIN judgement ON judgement.run = run.id
        ORDER BY created_utc DESC, run.id DESC, judged_utc, judgement.id
        """,
        dict,
    )
    grouped: dict[int, list[dict[str, Any]]] = {}
    for row in rows:
        grouped.setdefault(row.pop("id"), []).append(row)
    return [
        Run(**same[-1], outcomes=tuple(row["outcome"] for row in same)) for same in grouped.values()
    ]


def names(history: History) -> list[str]:
    """Names of all measurements, sorted."""
    found: list[dict[str, Any]] = history.rows(
        "SELECT DISTINCT name FROM measurement ORDER BY name", dict
    )
    return [str(row["name"]) for row in found]


def points(history: History, name: str | None = None) -> list[Point]:
    """The measurements called ``name``, or all, by time of the run; each as judged last."""
    where, values = ("WHERE measurement.name = ?", (name,)) if name is not None else ("", ())
    return list(_latest(history.rows(_POINTS + where + _ORDER, Point.of, *values)))


def trends(
    history: History, name: str, *, scenario: str | None = None, source: str | None = None
) -> list[Trend]:
    """The trend of a measurement, one for each scenario and source that it was measured in."""
    grouped: dict[tuple[str, str], list[Point]] = {}
    for point in points(history, name):
        if scenario in (None, point.scenario) and source in (None, point.source):
            grouped.setdefault((point.scenario, point.source), []).append(point)
    found = []
    for (of_scenario, of_source), same in sorted(grouped.items()):
        measured = tuple(n for n, p in enumerate(same) if _finite(p.value))
        values = np.array([same[n].value for n in measured], dtype=float)
        unsure = np.array(
            [u if _finite(u := same[n].uncertainty) else 0.0 for n in measured], dtype=float
        )
        changes = tuple(find(values, unsure))
        found.append(Trend(name, of_source, of_scenario, tuple(same), changes, measured))
    return found


def flakes(history: History) -> list[Flake]:
    """Every check that was repeated, the least steady first."""
    rows: list[dict[str, Any]] = history.rows(_VERDICTS, dict)
    repeated: list[dict[str, Any]] = history.rows(_REPEATED, dict)
    said: dict[tuple[str, str], dict[str, int]] = {}
    for row in rows:
        said.setdefault((row["name"], row["repeats"]), {})[row["verdict"]] = row["times"]
    grouped: dict[str, list[dict[str, int]]] = {}
    for row in repeated:
        grouped.setdefault(row["name"], []).append(said[row["name"], row["repeats"]])
    found = [
        Flake(
            name,
            len(groups),
            sum(len(group) > 1 for group in groups),
            {str(v): n for v in Verdict if (n := sum(group.get(v, 0) for group in groups))},
        )
        for name, groups in grouped.items()
    ]
    return sorted(found, key=lambda flake: (-flake.rate, flake.name))


def table(history: History) -> tuple[list[str], list[list[Any]]]:
    """(column names, rows): every measurement of every run, as judged last."""
    columns = [field.name for field in fields(Point)]
    return columns, [[getattr(point, c) for c in columns] for point in points(history)]


def _latest(found: Iterable[Point]) -> Iterator[Point]:
    """Of each run and name, those of the last judgement; ``found`` is ordered by run and time."""
    kept: dict[tuple[int, str], list[Point]] = {}
    for point in found:
        same = kept.setdefault((point.run, point.name), [])
        if same and same[0].judgement != point.judgement:
            same.clear()
        same.append(point)
    for same in kept.values():
        yield from same


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)
