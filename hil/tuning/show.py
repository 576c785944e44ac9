# SPDX-License-Identifier: Apache-2.0
"""What other parameters change, as tables for the terminal."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Table

from hil.motion.repetitions import Concentric
from hil.tuning.parameters import PARAMETERS, differences
from hil.tuning.rerun import Outcome, Rerun


def render(title: str, found: Rerun, console: Console) -> None:
    """Parameters, repetitions, stillness and errors: default, changed, difference."""
    console.print(_parameters(title, found))
    console.print(_repetitions(found))
    console.print(_figures(found))


def _table(title: str, *headings: str) -> Table:
    shown = Table(title=title, title_justify="left")
    for k, heading in enumerate(headings):
        shown.add_column(heading, justify="left" if k == 0 else "right")
    return shown


def _parameters(title: str, found: Rerun) -> Table:
    shown = _table(title, "parameter", "default", "changed", "unit")
    for name, (a, b) in differences(found.default.params, found.other.params).items():
        shown.add_row(name, _text(a), _text(b), PARAMETERS[name].unit)
    return shown


def _text(value: object) -> str:
    if isinstance(value, np.ndarray):
        return ",".join(f"{x:g}" for x in value.ravel())
    return f"{value:g}" if isinstance(value, float) else str(value)


def _repetitions(found: Rerun) -> Table:
    headings = ("begins, s", "mean, m/s", "changed", "mm/s", "peak, m/s", "changed", "mm/s")
    shown = _table("Repetitions", *headings)
    for a, b in found.paired():
        first = a or b
        assert first is not None
        cells = [f"{first.t_start_s:.2f}"]
        for name in ("mean_mps", "peak_mps"):
            cells += _compared(a, b, name)
        shown.add_row(*cells)
    return shown


def _compared(a: Concentric | None, b: Concentric | None, name: str) -> list[str]:
    values = [getattr(one, name) if one else float("nan") for one in (a, b)]
    cells = [f"{x:.3f}" if one else "none" for one, x in zip((a, b), values, strict=True)]
    return [*cells, f"{1e3 * (values[1] - values[0]):+.1f}" if a and b else "-"]


def _figures(found: Rerun) -> Table:
    shown = _table("In all", "", "default", "changed", "difference")
    rows = [_rows(one) for one in (found.default, found.other)]
    for name, (a, decimals) in rows[0].items():
        b = rows[1][name][0]
        shown.add_row(name, f"{a:.{decimals}f}", f"{b:.{decimals}f}", f"{b - a:+.{decimals}f}")
    return shown


def _rows(one: Outcome) -> dict[str, tuple[float, int]]:
    """Name -> (value, decimals)."""
    rows: dict[str, tuple[float, int]] = {
        "repetitions": (len(one.phases), 0),
        "zero-velocity spans": (len(one.zupt_spans_s), 0),
        "time in them, s": (one.zupt_s, 2),
    }
    if one.judged is not None:
        mean, peak = (1e3 * x for x in one.errors_mps)
        rows |= {
            "against truth: mean velocity RMSE, mm/s": (mean, 1),
            "against truth: peak velocity RMSE, mm/s": (peak, 1),
            "against truth: phases missed": (len(one.judged.missed), 0),
            "against truth: phases invented": (len(one.judged.invented), 0),
            "against truth: false zero-velocity steps": (one.judged.false_zupt, 0),
        }
    return rows
