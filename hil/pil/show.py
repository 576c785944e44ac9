# SPDX-License-Identifier: Apache-2.0
"""An assessment for people."""

from __future__ import annotations

from typing import Final

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hil.measure import Measurement, Verdict
from hil.pil.assess import STALE, Assessment, load
from hil.pil.kinds import by_kind

_SIGNS: Final = {Verdict.PASS: "✓ ", Verdict.FAIL: "✗ ", Verdict.UNSET: "– "}
_STYLES: Final = {Verdict.PASS: "green", Verdict.FAIL: "bold red"}


def render(name: str, found: Assessment, judged: list[Measurement], console: Console) -> None:
    """Print one set: steps by kind, the cycle model, and the verdicts."""
    console.print(Text(f"{name} on an emulated Cortex-M4F", "bold"))
    console.print(_kinds(found))
    console.print(_loads(found))
    console.print(
        f"stack below the caller: {found.run.step_stack_bytes} B used, "
        f"{found.stack_bound_bytes} B at most; estimator: {found.run.estimator_bytes} B of RAM",
        highlight=False,
    )
    first = found.comparison.first
    if first is None:
        console.print(
            f"bit-exact: yes, {found.comparison.steps} steps against the host core in float",
            highlight=False,
        )
    else:
        console.print(Text(f"bit-exact: no, first at {first}", "bold red"))
    if found.stale_core:
        console.print(STALE)
    console.print(_verdicts(judged))


def _table(*columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="dim", padding=(0, 1, 0, 0))
    for n, column in enumerate(columns):
        table.add_column(column, justify="right" if n else "left", no_wrap=True)
    return table


def _kinds(found: Assessment) -> Table:
    table = _table("Steps by kind", "Steps", "Instructions, mean", "Max")
    for kind in by_kind(found.run):
        shown = (f"{kind.mean:,.0f}", f"{kind.max:,}") if kind.steps else ("–", "–")
        table.add_row(kind.name, f"{kind.steps:,}", *shown)
    return table


def _loads(found: Assessment) -> Table:
    """Share of 64 MHz at 416 Hz, under each of the cycle model's three circumstances."""
    table = _table("Cycle model", "Cycles an instruction", "Load at 416 Hz", "At rest")
    rest = found.mean_instructions_at_rest
    for name, factor in (
        ("flash cache hits", found.model.cached),
        ("flash cache off", found.model.uncached),
        ("cache off, nothing overlaps", found.model.serial),
    ):
        table.add_row(
            name,
            f"{factor:.2f}",
            f"{load(found.mean_instructions, factor):.1%}",
            "–" if rest is None else f"{load(rest, factor):.1%}",
        )
    return table


def _verdicts(judged: list[Measurement]) -> Table:
    table = _table("Check", "Measured", "Limit", "Verdict")
    for one in judged:
        value = "–" if one.value is None else f"{one.value:,.6g} {one.unit}"
        sign = _SIGNS.get(one.verdict, "! ") + one.verdict.value
        table.add_row(
            one.name, value, str(one.limits), Text(sign, _STYLES.get(one.verdict, "yellow"))
        )
    return table
