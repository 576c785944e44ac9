# SPDX-License-Identifier: Apache-2.0
"""What a search over the estimator's noise found: for the terminal, as CSV, as one SVG."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from hil.report import sheet
from hil.tuning.ekf import Score, Sensitivity, Tuned
from hil.tuning.parameters import PARAMETERS
from hil.tuning.score import Figures

FIGURES: Final = (
    ("mean_rmse_mps", "mean velocity RMSE, mm/s", 1e3),
    ("peak_rmse_mps", "peak velocity RMSE, mm/s", 1e3),
    ("velocity_rmse_mps", "velocity RMSE, mm/s", 1e3),
    ("nees", "NEES (5)", 1.0),
    ("rest_rms_mps", "velocity at rests, mm/s", 1e3),
    ("rest_nis", "its NIS over 3", 1.0),
    ("trip_rms_m", "height at turns, mm", 1e3),
    ("trip_nis", "its NIS", 1.0),
)
"""Key, heading with unit, factor."""
FLAT_SHARE: Final = 0.1
"""A parameter may go where the cost stays within this share of the gain."""


def flat(one: Sensitivity, gain: float) -> tuple[float, float]:
    """Between which values of a parameter the cost stays near the best, as far as it was looked."""
    least = min(one.costs)
    near = [
        value
        for value, cost in zip(one.values, one.costs, strict=True)
        if cost <= least + FLAT_SHARE * gain
    ]
    return min(near), max(near)


def gain(scores: Sequence[Score]) -> float:
    """Mean cost of now less that of the best."""
    return math.fsum(s.cost_now - s.cost_best for s in scores) / len(scores) if scores else 0.0


def render(found: Tuned, console: Console) -> None:
    """Parameters, figures of both parts, and the proposal or what speaks against it."""
    console.print(_parameters(found))
    for title, scores in (("searched on", found.training), ("held out", found.held)):
        console.print(_part(f"{len(scores)} cases {title}", scores))
    blind = [s for s in (*found.training, *found.held) if not s.known]
    if blind:
        console.print(
            f"the truth of {len(blind)} cases is not known: they are judged by how the filter comes"
            " to rests and turning points; docs/tuning.md says what that cannot see"
        )
    if found.proposal is None:
        console.print(f"no proposal: {found.against}", highlight=False)
        return
    settings = " ".join(
        f"--param {s.axis.name}={s.best:g}" for s in found.parameters if s.best != s.now
    )
    console.print(
        f"proposal, after {found.trials} trials: better on what it was not searched on\n"
        f"hil replay {settings}",
        highlight=False,
    )


def _parameters(found: Tuned) -> Table:
    shown = Table(title="Parameters", title_justify="left")
    for heading in ("parameter", "now", "best", "unit", "flat from", "to", "cost if put back"):
        left = heading in ("parameter", "unit")
        shown.add_column(heading, justify="left" if left else "right")
    whole = gain(found.training)
    for one in found.parameters:
        low, high = flat(one, whole)
        shown.add_row(
            one.axis.name,
            f"{one.now:g}",
            f"{one.best:g}",
            PARAMETERS[one.axis.name].unit,
            f"{low:.3g}",
            f"{high:.3g}",
            f"{one.put_back:+.3g}",
        )
    return shown


def _part(title: str, scores: Sequence[Score]) -> Table:
    shown = Table(title=title, title_justify="left")
    for heading in ("", "now", "best"):
        shown.add_column(heading, justify="left" if not heading else "right")
    costs = [_mean([getattr(s, name) for s in scores]) for name in ("cost_now", "cost_best")]
    shown.add_row("cost", *(f"{cost:.4g}" for cost in costs))
    for key, heading, factor in FIGURES:
        pairs = [(s.now[key], s.best[key]) for s in scores if key in s.now and key in s.best]
        if pairs:
            shown.add_row(
                heading, *(f"{factor * _mean(column):.3g}" for column in zip(*pairs, strict=True))
            )
    return shown


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan


def parameters_csv(found: Tuned) -> str:
    """One line per parameter."""
    whole = gain(found.training)
    rows = [
        [
            one.axis.name,
            PARAMETERS[one.axis.name].unit,
            *(f"{x:.6g}" for x in (one.now, one.best, one.axis.low, one.axis.high)),
            *(f"{x:.6g}" for x in (*flat(one, whole), one.put_back)),
            int(found.proposal is not None),
        ]
        for one in found.parameters
    ]
    head = ["parameter", "unit", "now", "best", "low", "high", "flat_low", "flat_high"]
    return _csv([*head, "cost_if_put_back", "proposed"], rows)


def recordings_csv(found: Tuned) -> str:
    """One line per case: its part, costs and all figures now and with the best parameters."""
    parts = (("training", found.training), ("held out", found.held))
    keys = sorted({key for _, part in parts for s in part for f in (s.now, s.best) for key in f})
    rows = [
        [
            s.name,
            part,
            f"{s.cost_now:.6g}",
            f"{s.cost_best:.6g}",
            *(_cell(f, key) for key in keys for f in (s.now, s.best)),
        ]
        for part, scores in parts
        for s in scores
    ]
    head = ["case", "part", "cost_now", "cost_best"]
    return _csv([*head, *(f"{key}_{which}" for key in keys for which in ("now", "best"))], rows)


def _cell(figures: Figures, key: str) -> str:
    value = figures.get(key, math.nan)
    return f"{value:.6g}" if math.isfinite(value) else ""


def _csv(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def svg(found: Tuned) -> str:
    """The cost along each parameter alone, from now (0) downwards where it is better."""
    return sheet.svg([_figure(one) for one in found.parameters], columns=2)


def _figure(one: Sensitivity) -> tuple[str, dict[str, Any]]:
    return f"{one.axis.name}: {one.now:g} now, {one.best:g} best", {
        "kind": "timeline",
        "xLog": one.axis.log,
        "yLog": False,
        "xLabel": f"{one.axis.name}, {PARAMETERS[one.axis.name].unit or '1'}",
        "traces": [{"x": list(one.values), "y": list(one.costs)}],
        "limits": [{"value": 0.0, "label": "cost now", "side": "above"}],
    }
