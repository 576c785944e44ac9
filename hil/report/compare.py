# SPDX-License-Identifier: Apache-2.0
"""Two reports side by side: what changed first.

Runs are paired by name; a report of one run each is paired whatever the names are. A value has
changed when it differs by more than the root sum of squares of the two uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hil.report import text as texts
from hil.report import words
from hil.report.terminal import STYLES

_GRAVITY: Final = ("pass", "unset", "marginal", "inconclusive", "fail")
_BAD: Final = ("fail", "inconclusive")
_MAX_SHOWN: Final = 200
KINDS: Final[Mapping[str, str]] = {
    "verdict": "Verdict changed",
    "value": "Value changed",
    "limits": "Limits changed",
    "only": "Measured in one of the two",
    "same": "Unchanged",
}
"""What happened to a check, the most telling first."""


@dataclass(frozen=True)
class Row:
    """One check in both runs; ``first`` or ``second`` is None where it is missing."""

    id: str
    kind: str
    first: Mapping[str, Any] | None
    second: Mapping[str, Any] | None

    @property
    def worse(self) -> bool:
        """The second run's verdict is bad and graver than the first's."""
        after = self.second["verdict"] if self.second else "unset"
        before = self.first["verdict"] if self.first else "pass"
        return after in _BAD and _GRAVITY.index(after) > _GRAVITY.index(before)

    @property
    def change(self) -> str:
        """Second minus first with the combined uncertainty, in the unit of the limits."""
        if self.first is None or self.second is None:
            return ""
        a, b = _number(self.first["value"]), _number(self.second["value"])
        if a is None or b is None or self.first["unit"] != self.second["unit"] or a == b:
            return ""
        limits = self.second["limits"]
        bounds = [v for v in (limits["low"], limits["high"]) if v not in (None, 0, 0.0)]
        scale = texts.scale(self.second["unit"], bounds or [a, b])
        unsure = combined_uncertainty(self.first, self.second) / scale.factor
        shown = texts.number((b - a) / scale.factor)
        sign = "+" if b > a else ""
        tail = f" ± {texts.number(unsure, 2)}" if unsure else ""
        return f"{sign}{shown}{tail} {scale.unit}".rstrip()


@dataclass(frozen=True)
class Fact:
    """One thing about the runs that differs: where, and what it was and is."""

    key: str
    first: str
    second: str


@dataclass(frozen=True)
class Pair:
    """Two runs; ``first`` or ``second`` is None for a run that only one report has."""

    name: str
    first: Mapping[str, Any] | None
    second: Mapping[str, Any] | None
    rows: tuple[Row, ...]
    facts: tuple[Fact, ...]

    def of_kind(self, kind: str) -> list[Row]:
        return [row for row in self.rows if row.kind == kind]


@dataclass(frozen=True)
class Comparison:
    """Two reports; ``names`` are what the reader called them."""

    names: tuple[str, str]
    made_utc: tuple[str, str]
    pairs: tuple[Pair, ...]
    rig: tuple[Fact, ...]

    @property
    def worse(self) -> list[tuple[Pair, Row]]:
        return [(pair, row) for pair in self.pairs for row in pair.rows if row.worse]

    @property
    def headline(self) -> tuple[str, str]:
        """(verdict that colours it, one sentence)."""
        rows = [row for pair in self.pairs for row in pair.rows]
        if not rows:
            return "unset", "There is no check to compare."
        counts = {kind: sum(row.kind == kind for row in rows) for kind in KINDS}
        parts = []
        if self.worse:
            n = len(self.worse)
            verb = "does" if n == 1 else "do"
            parts.append(f"{words.count(n, 'check')} got worse and {verb} not pass")
        others = counts["verdict"] - sum(row.kind == "verdict" for _, row in self.worse)
        if others:
            parts.append(
                f"{words.count(others, 'other verdict')} changed"
                if parts
                else f"{words.count(others, 'verdict')} changed"
            )
        if counts["value"]:
            parts.append(f"{words.count(counts['value'], 'value')} changed, verdict the same")
        if counts["limits"]:
            parts.append(f"{words.count(counts['limits'], 'limit')} changed")
        if counts["only"]:
            parts.append(f"{words.count(counts['only'], 'check')} in one of the two only")
        sentence = "; ".join(parts) or f"{words.count(len(rows), 'check')} compared, none changed"
        colour = "fail" if self.worse else "marginal" if parts else "pass"
        return colour, sentence + "."


def compare(
    first: Mapping[str, Any], second: Mapping[str, Any], names: tuple[str, str]
) -> Comparison:
    """Compare two documents as :func:`hil.report.build` and :func:`hil.report.reading.load` give.

    Args:
        first: before.
        second: after.
        names: what to call them.
    """
    pairs = tuple(
        Pair(
            name,
            a,
            b,
            tuple(_rows(a, b)),
            tuple(_facts(_described(a), _described(b))) if a and b else (),
        )
        for name, a, b in _paired(first["recordings"], second["recordings"])
    )
    rigs = [{"rig": {**d["rig"], "hil": d["tool"]["version"]}} for d in (first, second)]
    return Comparison(
        names,
        (first["generated_utc"], second["generated_utc"]),
        pairs,
        tuple(_facts(rigs[0], rigs[1])),
    )


def combined_uncertainty(first: Mapping[str, Any], second: Mapping[str, Any]) -> float:
    """Half width of the interval that the difference of two measurements lies in."""
    return math.hypot(_number(first["uncertainty"]) or 0.0, _number(second["uncertainty"]) or 0.0)


def _paired(first: Sequence[Any], second: Sequence[Any]) -> Iterator[tuple[str, Any, Any]]:
    if len(first) == len(second) == 1:
        names = dict.fromkeys((first[0]["name"], second[0]["name"]))
        yield " → ".join(names), first[0], second[0]
        return
    left, right = ({entry["id"]: entry for entry in entries} for entries in (first, second))
    for name in dict.fromkeys([*left, *right]):
        yield name, left.get(name), right.get(name)


def _rows(first: Mapping[str, Any] | None, second: Mapping[str, Any] | None) -> list[Row]:
    """The checks of a pair: by kind of change, the gravest and the largest first."""
    left, right = (
        {m["id"]: m for m in (entry["measurements"] if entry else ())} for entry in (first, second)
    )
    found = [
        Row(key, _kind(left.get(key), right.get(key)), left.get(key), right.get(key))
        for key in dict.fromkeys([*left, *right])
    ]
    order = list(KINDS)

    def rank(row: Row) -> tuple[bool, int, int, float]:
        after = row.second["verdict"] if row.second else "unset"
        return not row.worse, order.index(row.kind), -_GRAVITY.index(after), -_share(row)

    return sorted(found, key=rank)


def _kind(first: Mapping[str, Any] | None, second: Mapping[str, Any] | None) -> str:
    if first is None or second is None:
        return "only"
    if first["verdict"] != second["verdict"]:
        return "verdict"
    if first["unit"] != second["unit"] or first["limits"] != second["limits"]:
        return "limits"
    return "value" if _moved(first, second) else "same"


def _moved(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    a, b = _number(first["value"]), _number(second["value"])
    if a is None or b is None or not (math.isfinite(a) and math.isfinite(b)):
        return bool(first["value"] != second["value"])
    return abs(b - a) > combined_uncertainty(first, second)


def _share(row: Row) -> float:
    """Change as a share of the larger value; 0 for rows that are not sorted by it."""
    if row.kind not in ("verdict", "value") or row.first is None or row.second is None:
        return 0.0
    a, b = _number(row.first["value"]), _number(row.second["value"])
    if a is None or b is None or not (math.isfinite(a) and math.isfinite(b)):
        return math.inf
    return abs(b - a) / max(abs(a), abs(b), math.ulp(0.0))


def _number(value: float | str | None) -> float | None:
    return None if value is None else float(value)


def _described(entry: Mapping[str, Any]) -> dict[str, Any]:
    """What a run was made of: everything but its results."""
    provenance = entry["provenance"] or {}
    kept = ("scenario", "images", "devices", "schema_hash", "tools", "host", "created_utc", "notes")
    return {
        "source": entry["source"],
        "recording": (entry["file"] or {}).get("sha256"),
        **{key: provenance.get(key) for key in kept},
        "contents": entry["contents"],
    }


def _facts(first: Any, second: Any, key: str = "") -> Iterator[Fact]:
    """The leaves in which two plain values differ, under dotted keys."""
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        for name in dict.fromkeys([*first, *second]):
            inner = f"{key}.{name}" if key else str(name)
            yield from _facts(first.get(name), second.get(name), inner)
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for n, (a, b) in enumerate(zip(first, second, strict=True)):
            yield from _facts(a, b, f"{key}[{n}]")
    elif first != second:
        yield Fact(key, _shown(first), _shown(second))


def _shown(value: Any) -> str:
    said = texts.scalar(value) or "empty"
    return said if len(said) <= _MAX_SHOWN else said[: _MAX_SHOWN - 1] + "…"


def render(found: Comparison, console: Console) -> None:
    """Print what changed; how much did not is a number."""
    for pair in found.pairs:
        console.print(Text(pair.name, "bold"))
        changed = [row for row in pair.rows if row.kind != "same"]
        if changed:
            console.print(_table(changed, found.names))
        if pair.facts:
            console.print(_fact_table(pair.facts, found.names))
        same = len(pair.rows) - len(changed)
        console.print(Text(f"  {words.count(same, 'check')} unchanged\n", "dim"))
    if found.rig:
        console.print(_fact_table(found.rig, found.names))
    verdict, sentence = found.headline
    console.print(Text(f"{words.SYMBOLS[verdict]} {sentence}", STYLES[verdict]))


def _table(rows: Sequence[Row], names: tuple[str, str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="dim", padding=(0, 1, 0, 0))
    table.add_column("")
    table.add_column("Check", overflow="fold", min_width=20)
    for head in (*names, "Change", "Limit", "Budget"):
        table.add_column(Text(head))
    for row in rows:
        one = row.second or row.first
        assert one is not None
        table.add_row(
            Text("worse" if row.worse else row.kind, "bold red" if row.worse else "dim"),
            Text(row.id, "bold" if row.worse else ""),
            *(_cell(m) for m in (row.first, row.second)),
            Text(row.change),
            Text(_allowed(row)),
            Text(one["budget"]),
        )
    return table


def _allowed(row: Row) -> str:
    said = [texts.quantity(m).allowed for m in (row.first, row.second) if m is not None]
    return " → ".join(dict.fromkeys(said))


def _cell(m: Mapping[str, Any] | None) -> Text:
    if m is None:
        return Text("–", "dim")
    verdict = m["verdict"]
    shown = "–" if m["value"] is None else texts.quantity(m).measured
    return Text(f"{words.SYMBOLS[verdict]} {shown}", STYLES[verdict])


def _fact_table(facts: Sequence[Fact], names: tuple[str, str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="dim", padding=(0, 1, 0, 0))
    for head in ("Differs", *names):
        table.add_column(Text(head), overflow="fold")
    for fact in facts:
        table.add_row(Text(fact.key), Text(fact.first), Text(fact.second))
    return table
