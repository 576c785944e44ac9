# SPDX-License-Identifier: Apache-2.0
"""``hil soak``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def soak(
    recording: Annotated[Path, typer.Argument(help="Recording of half an hour or more.")],
) -> None:
    """Show what each hour of a long recording was like, and whether anything drifts.

    A drift: the change over the run is beyond what is allowed, and its 95 % confidence interval
    excludes zero. Exit code 1 on a drift or a loss.

    Example: [bold]hil soak my-soak[/bold]
    """
    from rich.table import Table  # noqa: PLC0415 (start-up time of --help)

    from hil import library  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415
    from hil.soak.figures import figures, short  # noqa: PLC0415

    with bar(f"reading {recording.name}") as progress:
        loaded = load(library.resolve(recording))
        progress(0.5, "computing")
        found = figures(loaded)
    table = Table(title=f"{recording}: {found.duration_s / 3600:.2f} h")
    table.add_column("")
    hours = max((len(row.hours) for row in found.rows), default=0)
    for number in range(1, hours + 1):
        table.add_column(f"hour {number}", justify="right")
    for name in ("change over the run", "allowed", "verdict"):
        table.add_column(name, justify="right")
    for row in found.rows:
        change, verdict = "too little is known", "–"
        if row.trend is not None:
            change = row.trend.words
            verdict = "drifts" if row.trend.drifts else "flat"
        hourly = (short(value) for value in row.hours)
        allowed = short(row.track.allowed)
        table.add_row(f"{row.track.title}, {row.track.unit}", *hourly, change, allowed, verdict)
    console = terminal.console()
    console.print(table)
    lost = {name: count for name, count in found.losses.items() if count}
    console.print("lost: " + (", ".join(f"{n} {name}" for name, n in lost.items()) or "nothing"))
    if not found.sound:
        raise typer.Exit(1)
