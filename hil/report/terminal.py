# SPDX-License-Identifier: Apache-2.0
"""The report document on a terminal: the same verdicts, each with a sign and a word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hil.report import text as texts
from hil.report import words

STYLES: Final[Mapping[str, str]] = {
    "pass": "green",
    "marginal": "yellow",
    "fail": "bold red",
    "inconclusive": "magenta",
    "unset": "dim",
}


WIDTH_WHEN_PIPED: Final = 110


def console() -> Console:
    """Standard output; wide enough for the table where it goes to a file or a pipe."""
    plain = Console()
    return plain if plain.is_terminal else Console(width=WIDTH_WHEN_PIPED)


def render(document: Mapping[str, Any], console: Console) -> None:
    """Print every run of a document made by :func:`hil.report.document.build`."""
    for entry in document["recordings"]:
        _run(entry, console)
    for entry in document["recordings"]:
        for measurement in entry["measurements"]:
            if measurement["verdict"] in ("fail", "inconclusive"):
                _print(console, _complaint(entry, measurement))
    verdict, sentence = words.headline(document)
    _print(console, Text(_sign(verdict) + sentence, STYLES[verdict]))


def _complaint(entry: Mapping[str, Any], measurement: Mapping[str, Any]) -> Text:
    """Run, check, value, limit and budget line of one bad verdict, on one line."""
    shown = texts.quantity(measurement)
    verdict = measurement["verdict"]
    return Text.assemble(
        (_sign(verdict), STYLES[verdict]),
        f"{entry['name']}: ",
        (measurement["name"], "bold"),
        f" is {shown.measured}, limit {shown.allowed}, error budget {measurement['budget']}",
        (" (made to fail)" if measurement["expected_fail"] else "", "dim"),
    )


def _run(entry: Mapping[str, Any], console: Console) -> None:
    verdict = words.run_verdict(entry)
    _print(
        console,
        Text.assemble(
            (_sign(verdict) + words.run_title(entry), STYLES[verdict]),
            "  ",
            (entry["name"], "bold"),
            (f"  {entry['source_label']}", "dim"),
        ),
    )
    if entry["outcome"] in ("rig_failure", "not_run_live"):
        _print(console, Text(f"  {entry['outcome_reason']}", STYLES[verdict]))
    if entry.get("injected"):
        _print(console, Text(f"  {entry['injected']}", "magenta"))
    for problem in (entry["integrity"] or {"problems": ()})["problems"]:
        if problem not in entry["outcome_reason"]:
            _print(console, Text(f"  recording: {problem}", "magenta"))
    if entry["measurements"]:
        console.print(_table(entry))
    console.print()


def _table(entry: Mapping[str, Any]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="dim", padding=(0, 1, 0, 0))
    table.add_column("Verdict", no_wrap=True)
    table.add_column("Check", no_wrap=True)
    table.add_column("Measured", justify="right", min_width=11)
    table.add_column("Limit", justify="right", min_width=11)
    table.add_column("Budget")
    for measurement in entry["measurements"]:
        verdict = measurement["verdict"]
        shown = texts.quantity(measurement)
        bad = verdict in ("fail", "inconclusive")
        note = Text("\nmade to fail", "dim") if measurement["expected_fail"] else Text()
        table.add_row(
            Text(_sign(verdict) + words.VERDICTS[verdict], STYLES[verdict]),
            Text(measurement["name"], "bold" if bad else "") + note,
            Text("–" if measurement["value"] is None else shown.measured, "bold" if bad else ""),
            Text(shown.allowed),
            Text(measurement["budget"]),
        )
    return table


def render_manifest(manifest: Mapping[str, Any], console: Console) -> None:
    """Print the manifest of one image: names and values, nested ones indented."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    _add_rows(table, manifest, "")
    console.print(table)
    console.print()


def _add_rows(table: Table, values: Mapping[str, Any], indent: str) -> None:
    for key, value in values.items():
        if isinstance(value, Mapping):
            table.add_row(Text(indent + str(key)), "")
            _add_rows(table, value, indent + "  ")
        else:
            table.add_row(Text(indent + str(key)), Text("–" if value is None else str(value)))


def _sign(verdict: str) -> str:
    return words.SYMBOLS[verdict] + " "


def _print(console: Console, text: Text) -> None:
    console.print(text, highlight=False, soft_wrap=False)
