# SPDX-License-Identifier: Apache-2.0
"""The league as tables: terminal, Markdown, JSON; and where ours is not among the first two."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from hil.compare.methods import METHODS, OURS
from hil.compare.score import Row, as_mapping, league
from hil.errors import HilError

VERSION: Final = 1
UNKNOWN: Final = "–"


@dataclass(frozen=True)
class Column:
    """One column: heading, unit, and its text for a row.

    Attributes:
        velocity: a figure of velocity; less is better.
    """

    heading: str
    unit: str
    text: Callable[[Row], str]
    value: Callable[[Row], float | None]
    velocity: bool = False


def _number(name: str, factor: float = 1.0) -> tuple[Callable[[Row], str], Any]:
    def value(row: Row) -> float | None:
        x = getattr(row, name)
        return None if x is None else factor * x

    def text(row: Row) -> str:
        x = value(row)
        return UNKNOWN if x is None else _digits(x)

    return text, value


def _digits(x: float) -> str:
    """Three digits, and no more than two decimals."""
    if abs(x) >= 99.95:
        return f"{x:,.0f}"
    return f"{x:.1f}" if abs(x) >= 9.995 else f"{x:.2f}"


def _of(count: str, total: str) -> Callable[[Row], str]:
    def text(row: Row) -> str:
        n, m = getattr(row, count), getattr(row, total)
        return UNKNOWN if n is None or m is None else f"{n} of {m}"

    return text


def _count(row: Row) -> str:
    return UNKNOWN if row.invented is None else str(row.invented)


COLUMNS: Final = (
    Column("attitude", "deg", *_number("attitude_deg")),
    Column("velocity", "mm/s", *_number("velocity_mps", 1e3), velocity=True),
    Column("high-passed", "mm/s", *_number("washed_mps", 1e3), velocity=True),
    Column("rep mean", "mm/s", *_number("mean_mps", 1e3), velocity=True),
    Column("rep peak", "mm/s", *_number("peak_mps", 1e3), velocity=True),
    Column("missed", "reps", _of("missed", "reps"), lambda row: row.missed),
    Column("invented", "reps", _count, lambda row: row.invented),
    Column("drift", "m/min", *_number("drift_m_per_min")),
    Column("false ZUPT", "s", *_number("false_zupt_s")),
    Column("missed ZUPT", "rests", _of("missed_rests", "rests"), lambda row: row.missed_rests),
)
COST: Final = Column("cost", "us/sample", *_number("cost_us"))


def columns(rows: Sequence[Row]) -> list[Column]:
    """Those for which any of the rows has a value."""
    return [c for c in COLUMNS if any(c.value(row) is not None for row in rows)]


def place(rows: Sequence[Row], column: Column) -> int | None:
    """From 1: where ours stands among the others in a column; None where it has no value.

    A tracker that missed repetitions has an error of the others only; it ranks all the same, which
    favours it. Ours with one sensor is no other.
    """
    values = {row.method: column.value(row) for row in rows}
    ours = values.get(OURS)
    if ours is None:
        return None
    rest = [v for name, v in values.items() if v is not None and not name.startswith(OURS)]
    return 1 + sum(v < ours for v in rest)


def behind(tables: Mapping[str, Sequence[Row]]) -> list[str]:
    """One sentence for each velocity column in which ours is third or worse."""
    found = []
    for case, rows in tables.items():
        for column in COLUMNS:
            at = place(rows, column) if column.velocity else None
            if at is not None and at > 2:
                values = {r.method: column.value(r) for r in rows}
                ours = values[OURS] or 0.0
                better = ", ".join(
                    f"{name} {_digits(v)}"
                    for name, v in values.items()
                    if v is not None and v < ours and not name.startswith(OURS)
                )
                found.append(
                    f"{case}, {column.heading}: ours is {_ordinal(at)} with {_digits(ours)} "
                    f"{column.unit} ({better})"
                )
    return found


def _ordinal(n: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(n, f"{n}th")


def render(tables: Mapping[str, Sequence[Row]], console: Console) -> None:
    """Print one table for each case."""
    for case, rows in tables.items():
        title = case
        if all(row.velocity_mps is None for row in rows):
            title += ": no truth is known of it, so there is nothing to rank by but the cost"
        shown = Table(title=title, title_justify="left")
        shown.add_column("tracker")
        used = [*columns(rows), COST]
        for column in used:
            shown.add_column(f"{column.heading}\n{column.unit}", justify="right")
        for row in rows:
            style = "bold" if row.method == OURS else None
            shown.add_row(row.method, *(c.text(row) for c in used), style=style)
        console.print(shown)


def markdown(rows: Sequence[Row]) -> str:
    """One case as a table, without the cost, which is a machine's."""
    ((head, *lines),) = [[t["head"], *t["rows"]] for t in as_tables(rows)]
    names = [[f"**{name}**" if name == OURS else name, *cells] for name, *cells in lines]
    rule = "|---" * len(head) + "|"
    return "\n".join(
        ["| " + " | ".join(head) + " |", rule, *(f"| {' | '.join(x)} |" for x in names)]
    )


def as_tables(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The league as the report document holds it: texts, without the cost."""
    return [
        {
            "case": case,
            "head": ["tracker", *(f"{c.heading}, {c.unit}" for c in columns(members))],
            "rows": [[r.method, *(c.text(r) for c in columns(members))] for r in members],
        }
        for case, members in league(rows).items()
    ]


def summary(tables: Mapping[str, Sequence[Row]]) -> str:
    """One line a case: RMSE of velocity of each tracker, mm/s, and the place of ours."""
    names = [name for name in METHODS if any(r.method == name for t in tables.values() for r in t)]
    lines = [
        "| | " + " | ".join(f"**{n}**" if n == OURS else n for n in names) + " | place of ours |",
        "|---" * (len(names) + 2) + "|",
    ]
    velocity = next(c for c in COLUMNS if c.heading == "velocity")
    for case, rows in tables.items():
        by_name = {row.method: row for row in rows}
        cells = [velocity.text(by_name[n]) if n in by_name else UNKNOWN for n in names]
        lines.append(f"| {case} | " + " | ".join(cells) + f" | {place(rows, velocity)} |")
    return "\n".join(lines)


def cost(rows: Sequence[Row]) -> dict[str, float]:
    """Median processor time a sample of each tracker, us."""
    found = {}
    for name in METHODS:
        have = sorted(r.cost_us for r in rows if r.method == name and r.cost_us is not None)
        if have:
            found[name] = have[len(have) // 2]
    return found


def as_json(rows: Sequence[Row], machine: str) -> str:
    """Every row, one a line: small, and a change shows where it is."""
    lines = ",\n".join("  " + json.dumps(as_mapping(row)) for row in rows)
    head = json.dumps({"version": VERSION, "machine": machine})[1:-1]
    return "{" + head + ', "rows": [\n' + lines + "\n]}\n"


def read_json(path: Path) -> tuple[list[Row], str]:
    """Rows, and the machine that they were made on.

    Raises:
        HilError: the file cannot be read, or is no league.
    """
    mend = "make one: hil compare --motion all --json FILE"
    try:
        document = json.loads(path.read_bytes())
        if document["version"] != VERSION:
            raise HilError(f"{path}: a league of version {document['version']}", mend)
        return [Row(**row) for row in document["rows"]], str(document["machine"])
    except OSError as error:
        raise HilError(f"{path}: cannot be read: {error.strerror}", mend) from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise HilError(f"{path}: no league table: {error}", mend) from error
