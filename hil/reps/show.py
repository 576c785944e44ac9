# SPDX-License-Identifier: Apache-2.0
"""Repetitions as a table for the terminal, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from rich.table import Table

from hil.reps.find import RepetitionSet

COLUMNS = (
    ("set", "", 0),
    ("repetition", "", 0),
    ("kind", "", 0),
    ("start", "", 0),
    ("t_start_s_leader", "s", 3),
    ("t_end_s_leader", "s", 3),
    ("mean_mps", "m/s", 3),
    ("peak_mps", "m/s", 3),
    ("time_to_peak_s", "s", 3),
    ("eccentric_s", "s", 3),
    ("pause_s", "s", 3),
    ("range_m", "m", 3),
    ("tilt_deg", "deg", 2),
    ("phases", "", 0),
)
"""Name, unit, decimals."""


def rows(found: Sequence[RepetitionSet]) -> Iterator[dict[str, Any]]:
    """One mapping per repetition, by the names of :data:`COLUMNS`; what is not known is None."""
    for number, one in enumerate(found, start=1):
        for k, r in enumerate(one.repetitions, start=1):
            values = {
                "set": number,
                "repetition": k,
                "kind": r.kind,
                "start": r.start,
                "t_start_s_leader": r.t_start_s,
                "t_end_s_leader": r.t_end_s,
                **vars(r.figures),
                "phases": len(r.phases),
            }
            yield {
                name: _rounded(values[name], decimals) if decimals else values[name]
                for name, _, decimals in COLUMNS
            }


def as_csv(found: Sequence[RepetitionSet]) -> str:
    """One line per repetition below one of names."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [name for name, _, _ in COLUMNS], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows(found))
    return text.getvalue()


def as_json(found: Sequence[RepetitionSet]) -> str:
    """Sets with their counts and velocity loss, and all repetitions."""
    sets = [
        {
            "full": len(one.full),
            "partial": len(one.partial),
            "velocity_loss_percent": _rounded(one.velocity_loss_percent, 1),
        }
        for one in found
    ]
    return json.dumps({"sets": sets, "repetitions": list(rows(found))}, indent=1) + "\n"


def table(title: str, found: Sequence[RepetitionSet]) -> Table:
    """All repetitions; what sums up a set stands below."""
    shown = Table(
        title=title, title_justify="left", caption_justify="left", caption="\n".join(summary(found))
    )
    for heading, unit in (
        *(("set", ""), ("rep", ""), ("kind", ""), ("start", "")),
        *(("mean", "m/s"), ("peak", "m/s"), ("to peak", "s"), ("eccentric", "s")),
        *(("pause", "s"), ("range", "m"), ("tilt", "deg")),
    ):
        text = heading in ("kind", "start")
        shown.add_column(f"{heading}\n{unit}".strip(), justify="left" if text else "right")
    for row in rows(found):
        shown.add_row(
            *(
                _shown(row[name], decimals)
                for name, _, decimals in COLUMNS
                if name not in ("t_start_s_leader", "t_end_s_leader", "phases")
            ),
            style="dim" if row["kind"] == "partial" else None,
        )
    return shown


def summary(found: Sequence[RepetitionSet]) -> list[str]:
    """One line per set: counts and velocity loss."""
    lines = []
    for number, one in enumerate(found, start=1):
        loss = one.velocity_loss_percent
        lines.append(
            f"set {number}: {len(one.full)} repetitions, {len(one.partial)} partial"
            + ("" if math.isnan(loss) else f", velocity loss {loss:.1f} %")
        )
    return lines


def _shown(value: Any, decimals: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{decimals}f}" if decimals else str(value)


def _rounded(value: float, decimals: int) -> float | None:
    return round(value, decimals) if math.isfinite(value) else None
