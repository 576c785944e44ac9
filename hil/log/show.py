# SPDX-License-Identifier: Apache-2.0
"""A log on the terminal: what comes in while it does, and what was kept at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from hil.log.capture import Log
from hil.log.meter import NS_PER_S, Meter

MESSAGES_SHOWN: Final = 4


@contextmanager
def live(console: Console, title: str) -> Iterator[Callable[[Log], None]]:
    """Shows a log as it grows; without a terminal, only hints, each once."""
    if not console.is_terminal:
        said: set[str] = set()

        def hint(log: Log) -> None:
            for role, meter in log.meters.items():
                text = meter.hint(log.t_ns)
                if text and role not in said:
                    said.add(role)
                    console.print(f"{role}: {text}", highlight=False, soft_wrap=True)

        yield hint
        return
    with Live(console=console, auto_refresh=False, transient=True) as screen:
        yield lambda log: screen.update(_panel(log, title), refresh=True)


def _panel(log: Log, title: str) -> Group:
    size = log.parts.file_bytes() / 1e6
    head = (
        f"{title}: {log.t_ns / NS_PER_S:.0f} s, {size:.2f} MB in {log.parts.path.name}"
        + (f" (file {len(log.parts.paths)})" if len(log.parts.paths) > 1 else "")
        + "; Ctrl-C ends it"
    )
    table = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    table.add_column("Port")
    words = next(iter(log.meters.values()))
    for heading in (
        *("kB/s", "frames/s", "lines/s", "frames"),
        *(words.damaged_are, words.lost_are),
    ):
        table.add_column(heading, justify="right")
    notes: list[Text] = []
    for role, meter in log.meters.items():
        rates = meter.rates(log.t_ns)
        bad = "bold red" if meter.damaged or meter.lost else ""
        table.add_row(
            Text(role, "bold"),
            f"{rates.bytes / 1e3:.1f}",
            f"{rates.frames:.0f}",
            f"{rates.lines:.0f}",
            f"{meter.frames}",
            Text(f"{meter.damaged}", bad),
            Text(f"{meter.lost}", bad),
        )
        notes += _notes(log, role, meter)
    return Group(Text(head), table, *notes)


def _notes(log: Log, role: str, meter: Meter) -> Iterator[Text]:
    if meter.messages:
        common = meter.messages.most_common(MESSAGES_SHOWN)
        text = ", ".join(f"{count} {name}" for name, count in common)
        yield Text(f"{role}: {text}", "dim", no_wrap=True, overflow="ellipsis")
    if meter.last_line:
        yield Text(f"{role}: {meter.last_line}", "cyan", no_wrap=True, overflow="ellipsis")
    if role in log.away:
        yield Text(f"{role}: disconnected, waiting for it to come back", "bold yellow")
    elif hint := meter.hint(log.t_ns):
        yield Text(f"{role}: {hint}", "yellow")


def summary(log: Log, console: Console) -> None:
    """What was heard and where it is."""
    console.print(
        f"logged {log.t_ns / NS_PER_S:.1f} s: {log.ended}", highlight=False, soft_wrap=True
    )
    for role, meter in log.meters.items():
        gaps = log.gaps.get(role, [])
        away = f", {len(gaps)} times unplugged for {sum(gaps):.1f} s in all" if gaps else ""
        restarts = f", {meter.restarts} restarts" if meter.restarts else ""
        console.print(
            f"  {role}: {meter.bytes} bytes, {meter.frames} frames, {meter.lines} lines, "
            f"{meter.damaged} {meter.damaged_are}, {meter.lost} {meter.lost_are}{restarts}{away}",
            highlight=False,
            soft_wrap=True,
        )
        if hint := meter.hint(log.t_ns):
            console.print(f"  {role}: {escape(hint)}", style="yellow", soft_wrap=True)
    for path in log.parts.paths:
        console.print(
            f"  {path}: {path.stat().st_size} bytes" if path.exists() else f"  {path}: gone",
            highlight=False,
            soft_wrap=True,
        )
