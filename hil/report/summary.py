# SPDX-License-Identifier: Apache-2.0
"""The report document as Markdown, for the summary page of a GitHub job.

GitHub renders what is appended to the file that ``$GITHUB_STEP_SUMMARY`` names, up to 1 MiB a
step. Text from a recording may hold anything: it is shown, never rendered.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hil.errors import HilError
from hil.report import text as texts
from hil.report import words

SIGNS: Final[Mapping[str, str]] = {
    "pass": "✅",
    "marginal": "⚠️",
    "fail": "❌",
    "inconclusive": "❓",
    "unset": "➖",
}
MAX_ROWS: Final = 200
"""Bad checks shown: with long texts still far from what GitHub takes."""

_MAX_TEXT: Final = 300
_BREAKS: Final = re.compile("[ \t\r\n\v\f\x85\u2028\u2029]+")
_SPECIAL: Final = re.compile(r"[\\`*_{}\[\]()<>#+!|~&@:-]")


def render(document: Mapping[str, Any]) -> str:
    """Headline, bad checks with value, limit and budget line, then the runs."""
    verdict, sentence = words.headline(document)
    parts = [f"## {SIGNS[verdict]} {escaped(sentence)}"]
    bad = [
        (entry, m)
        for entry in document["recordings"]
        for m in entry["measurements"]
        if m["verdict"] in ("fail", "inconclusive")
    ]
    if bad:
        heads = ("", "Check", "Run", "Measured", "Limit", "Budget line")
        parts.append(_table(heads, (_bad(entry, m) for entry, m in bad[:MAX_ROWS])))
    if len(bad) > MAX_ROWS:
        parts.append(f"{len(bad) - MAX_ROWS} more are in report.json.")
    if document["recordings"]:
        parts.append(
            _table(("", "Run", "Result", "Source", "Checks"), map(_run, document["recordings"]))
        )
    return "\n\n".join(parts) + "\n\n"


def append(document: Mapping[str, Any], path: Path) -> None:
    """Append the summary to ``path``.

    Raises:
        HilError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as stream:
            stream.write(render(document))
    except OSError as error:
        raise HilError(
            f"{path}: the job summary cannot be written: {error.strerror or error}",
            "name a file that you may write to: hil report … --summary FILE",
        ) from error


def escaped(value: str) -> str:
    """``value`` so that Markdown shows it letter for letter on one line."""
    flat = _BREAKS.sub(" ", value).strip()
    short = flat if len(flat) <= _MAX_TEXT else flat[: _MAX_TEXT - 1] + "…"
    return _SPECIAL.sub(lambda found: f"&#{ord(found.group())};", short)


def _bad(entry: Mapping[str, Any], measurement: Mapping[str, Any]) -> Sequence[str]:
    shown = texts.quantity(measurement)
    note = " (made to fail)" if measurement["expected_fail"] else ""
    return (
        SIGNS[measurement["verdict"]],
        measurement["name"] + note,
        entry["name"],
        shown.measured,
        shown.allowed,
        measurement["budget"],
    )


def _run(entry: Mapping[str, Any]) -> Sequence[str]:
    counts = {v: sum(m["verdict"] == v for m in entry["measurements"]) for v in words.VERDICTS}
    found = ", ".join(f"{n} {words.VERDICTS[v].lower()}" for v, n in counts.items() if n)
    reason = entry["outcome_reason"] if entry["outcome"] != "pass" else ""
    return (
        SIGNS[words.run_verdict(entry)],
        entry["name"],
        words.run_title(entry) + (f": {reason}" if reason else ""),
        entry["source_label"],
        found or "–",
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [
        "| " + " | ".join(heads) + " |",
        "|" + "---|" * len(heads),
        *("| " + " | ".join(escaped(cell) for cell in row) + " |" for row in rows),
    ]
    return "\n".join(lines)
