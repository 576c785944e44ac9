# SPDX-License-Identifier: Apache-2.0
"""``hil history ...``: thin commands over the functions of this package."""

from __future__ import annotations

import enum
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated

import typer

from hil.history import DEFAULT_FILE

app = typer.Typer(
    name="history",
    help="Every run ever judged: list them, show how a measurement went, find flaky checks.",
    epilog="Example: [bold]hil history show sync.error_p99_ns --scenario clean-7ms5[/bold]",
)


class Format(enum.StrEnum):
    CSV = "csv"
    JSON = "json"


FileOption = Annotated[Path, typer.Option("--db", help="The history's database.")]
SourceOption = Annotated[
    str | None, typer.Option(help="Only this source: sim, bench, synthetic or import.")
]


@app.callback(invoke_without_command=True)
def list_runs(
    context: typer.Context,
    file: FileOption = DEFAULT_FILE,
    last: Annotated[int, typer.Option(min=1, help="How many runs, the latest first.")] = 40,
) -> None:
    """List the runs: when, source, scenario, build, outcome.

    Example: [bold]hil history --last 10[/bold]
    """
    from hil.history import queries, show, store  # noqa: PLC0415 (start-up time)
    from hil.report import terminal  # noqa: PLC0415

    if context.invoked_subcommand is not None:
        return
    with store.open_history(file) as history:
        found = queries.runs(history)
    show.runs(found[:last], terminal.console())
    if len(found) > last:
        typer.echo(f"{len(found) - last} older runs: hil history --last {len(found)}")


@app.command()
def add(
    reports: Annotated[list[Path], typer.Argument(help="report.json files, or their folders.")],
    file: FileOption = DEFAULT_FILE,
) -> None:
    """Keep the runs of reports. A run that is there already is not kept twice.

    Example: [bold]hil history add build/*/report.json[/bold]
    """
    from rich.console import Console  # noqa: PLC0415 (start-up time)
    from rich.progress import track  # noqa: PLC0415

    from hil.history import store  # noqa: PLC0415
    from hil.report import reading  # noqa: PLC0415

    added = store.Added()
    console = Console(stderr=True)
    with store.open_history(file, create=True) as history:
        for path in track(
            reports, "adding", console=console, transient=True, disable=not console.is_terminal
        ):
            added += history.add(reading.load(path))
    typer.echo(
        f"{file}: {added.new} new, {added.judged_anew} judged anew, {added.known} known already"
    )


@app.command()
def show(
    measurement: Annotated[str, typer.Argument(help="Its name, e.g. sync.error_p99_ns.")],
    scenario: Annotated[str | None, typer.Option(help="Only this scenario.")] = None,
    source: SourceOption = None,
    file: FileOption = DEFAULT_FILE,
) -> None:
    """Show how a measurement went from run to run, and where its level changed.

    A step, ▶, is a run from which on the level is another; a drift, ↗, goes on over many runs.
    Noise alone is called a change in 1 of 100 histories; 12 runs are the fewest that can tell.

    Example: [bold]hil history show sync.error_p99_ns --scenario clean-7ms5[/bold]
    """
    from difflib import get_close_matches  # noqa: PLC0415 (start-up time)

    from hil.history import queries, store  # noqa: PLC0415
    from hil.history import show as views  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415

    with store.open_history(file) as history:
        with _busy("looking for changes"):
            found = queries.trends(history, measurement, scenario=scenario, source=source)
        if not found:
            near = get_close_matches(measurement, queries.names(history), 3, 0.5)
            raise store.HistoryError(
                f"{file}: no run that is asked for has a measurement called {measurement}",
                "\n".join(f"hil history show {name}" for name in near)
                or "list the runs: hil history",
            )
    console = terminal.console()
    for trend in found:
        views.trend(trend, console)


@app.command()
def flaky(
    every: Annotated[bool, typer.Option("--all", help="Also the checks that are steady.")] = False,
    file: FileOption = DEFAULT_FILE,
) -> None:
    """Show how often a check's verdict differs between runs of the same images and scenario.

    The rate is a share of groups: runs with equal images, scenario and source are one group.

    Example: [bold]hil history flaky --all[/bold]
    """
    from hil.history import queries, store  # noqa: PLC0415 (start-up time)
    from hil.history import show as views  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415

    with store.open_history(file) as history, _busy("counting verdicts"):
        found = queries.flakes(history)
    views.flakes(found, terminal.console(), every=every)


@app.command()
def export(
    form: Annotated[Format, typer.Option("--format", help="Of the output.")] = Format.CSV,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File (default: standard output).")
    ] = None,
    file: FileOption = DEFAULT_FILE,
) -> None:
    """Write every measurement of every run as CSV or JSON.

    Example: [bold]hil history export --format json -o history.json[/bold]
    """
    from hil.history import queries, store, tabular  # noqa: PLC0415 (start-up time)

    with store.open_history(file) as history, _busy("reading"):
        columns, rows = queries.table(history)
    text = (tabular.as_csv if form is Format.CSV else tabular.as_json)(columns, rows)
    if output is None:
        sys.stdout.write(text)
    else:
        tabular.write(output, text)
        typer.echo(f"{output}: {len(rows)} measurements", err=True)


def _busy(what: str) -> AbstractContextManager[object]:
    """On a terminal, a sign that something goes on: of a large history it takes seconds."""
    from rich.console import Console  # noqa: PLC0415 (start-up time)

    return Console(stderr=True).status(what)
