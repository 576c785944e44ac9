# SPDX-License-Identifier: Apache-2.0
"""The history on a terminal: runs, trends with their changes, flaky checks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hil.history.changes import ALPHA, MIN_RUNS, Change
from hil.history.queries import Flake, Point, Run, Trend
from hil.library import SOURCE_LABELS
from hil.report import text as texts
from hil.report import words
from hil.report.terminal import STYLES

_OUTCOME_STYLES: Final = {
    "pass": "green",
    "product_failure": "bold red",
    "rig_failure": "magenta",
    "inconclusive": "magenta",
    "not_run_live": "dim",
}
_PLOT_ROWS: Final = 9
_PLOT_COLUMNS: Final = 72


def runs(found: Sequence[Run], console: Console) -> None:
    """One line a run; a failure in an earlier judgement of the same run stays to be seen."""
    table = _table("When", "Run", "Source", "Scenario", "Build", "Outcome")
    for run in found:
        earlier = sorted(set(run.outcomes[:-1]) - {run.outcome})
        note = f" (before: {', '.join(map(_outcome, earlier))})" if earlier else ""
        table.add_row(
            texts.moment(run.created_utc),
            Text(run.name),
            Text(run.source),
            Text(run.scenario),
            Text(run.build.replace(" ", "\n")),
            Text(_outcome(run.outcome) + note, _OUTCOME_STYLES.get(run.outcome, "")),
        )
    console.print(table)
    bad = sum(run.outcome == "product_failure" for run in found)
    console.print(Text(f"{words.count(len(found), 'run')}, {words.count(bad, 'product failure')}."))


def trend(found: Trend, console: Console) -> None:
    """Plot, changes, and a line for each run."""
    label = SOURCE_LABELS.get(found.source, found.source)
    console.print(
        Text.assemble(
            (found.name, "bold"), f"  {found.scenario}  ", (f"{found.source}: {label}", "dim")
        )
    )
    measured = [found.points[n] for n in found.measured]
    if measured:
        for line in plot(measured, found.changes):
            console.print(line)
    for sentence in _changes(measured, found.changes):
        console.print(sentence)
    marks = {found.measured[c.start]: c for c in found.changes}
    table = _table("", "When", "Build", "Measured", "Limit", "Verdict", "Budget")
    for n, point in enumerate(found.points):
        shown = texts.quantity(_as_measurement(point))
        verdict = point.verdict.value
        mark = ("▶" if marks[n].kind == "step" else "↗") if n in marks else ""
        table.add_row(
            Text(mark, "bold cyan"),
            texts.moment(point.created_utc),
            Text(point.build.replace(" ", "\n")),
            Text("–" if point.value is None else shown.measured),
            Text(shown.allowed),
            Text(f"{words.SYMBOLS[verdict]} {words.VERDICTS[verdict]}", STYLES[verdict]),
            Text(point.budget),
        )
    console.print(table)


def plot(points: Sequence[Point], changes: Sequence[Change]) -> Iterator[Text]:
    """Values from left to right, the last runs when there are many; limits as dashes."""
    first = max(0, len(points) - _PLOT_COLUMNS)
    shown = points[first:]
    values = [float(p.value) for p in shown if p.value is not None]
    limits = [b for b in (shown[-1].low, shown[-1].high) if b is not None and math.isfinite(b)]
    bottom, top = min([*values, *limits]), max([*values, *limits])
    if top == bottom:
        bottom, top = bottom - 1.0, top + 1.0
    scale = texts.scale(shown[-1].unit, limits or values)

    def row(value: float) -> int:
        return round((value - bottom) / (top - bottom) * (_PLOT_ROWS - 1))

    starts = {c.start - first for c in changes if c.kind == "step"}
    levels = {row(b): b for b in limits} or {row(bottom): bottom, row(top): top}
    for height in reversed(range(_PLOT_ROWS)):
        label = texts.number(levels[height] / scale.factor) if height in levels else ""
        line = Text(f"{label:>10} {'┤' if label else '│'}", "dim")
        for n, (point, value) in enumerate(zip(shown, values, strict=True)):
            if row(value) == height:
                line.append("●", STYLES[point.verdict.value])
            elif n in starts:
                line.append("┆", "bold cyan")
            else:
                line.append("╌" if limits and height in levels else " ", "red")
        if height == _PLOT_ROWS - 1:
            line.append(f" {scale.unit}", "dim")
        yield line


def _changes(measured: Sequence[Point], changes: Sequence[Change]) -> Iterator[Text]:
    if not changes:
        said = (
            f"Too few runs to tell a change: {len(measured)} of {MIN_RUNS}."
            if len(measured) < MIN_RUNS
            else f"No change of level in {len(measured)} runs (false alarms: {ALPHA:.0%})."
        )
        yield Text(said, "dim")
    for change in changes:
        unit = measured[change.start].unit
        scale = texts.scale(unit, (change.before, change.after))
        before, after = (texts.number(v / scale.factor) for v in (change.before, change.after))
        when = texts.moment(measured[change.start].created_utc)
        word = "▶ Step" if change.kind == "step" else "↗ Drift"
        span = "at" if change.kind == "step" else "from"
        yield Text(
            f"{word} {span} {when}: {before} to {after} {scale.unit}, "
            f"build {measured[change.start].build or 'unknown'}",
            "bold cyan",
        )


def flakes(found: Sequence[Flake], console: Console, *, every: bool) -> None:
    """Flake rate of each check; the steady ones only when ``every``."""
    if not found:
        console.print(
            Text("Nothing was run twice with equal images, scenario and source: no rate to show.")
        )
        return
    shaky = [flake for flake in found if flake.differing]
    table = _table("Check", "Flake rate", "Groups", "Differ", "Verdicts")
    for flake in found if every else shaky:
        said = ", ".join(f"{n} {words.VERDICTS[v].lower()}" for v, n in flake.verdicts.items())
        table.add_row(
            Text(flake.name),
            Text(f"{flake.rate:.0%}", "bold red" if flake.differing else "green"),
            str(flake.groups),
            str(flake.differing),
            said,
        )
    if table.row_count:
        console.print(table)
    console.print(
        Text(
            f"{len(shaky)} of {words.count(len(found), 'check')} that were repeated "
            f"{'gives' if len(shaky) == 1 else 'give'} differing verdicts "
            "for equal images, scenario and source."
        )
    )


def _table(*heads: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="dim", padding=(0, 1, 0, 0))
    for head in heads:
        table.add_column(head)
    return table


def _outcome(outcome: str) -> str:
    return words.OUTCOMES.get(outcome, outcome)


def _as_measurement(point: Point) -> dict[str, Any]:
    limits = {"low": point.low, "high": point.high}
    return {
        "value": point.value,
        "unit": point.unit,
        "uncertainty": point.uncertainty or 0.0,
        "limits": limits,
    }
