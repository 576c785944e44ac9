# SPDX-License-Identifier: Apache-2.0
"""The ``hil`` command. Each command is thin: parse, call one function, show the result."""

from __future__ import annotations

import enum
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hil.backends import Progress
    from hil.recording import Recording

app = typer.Typer(
    name="hil",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Hardware-in-the-loop rig for the two-node barbell velocity tracker: build the firmware, "
    "run it, record it, judge it.",
    epilog="Example: [bold]hil replay fixtures/recordings/clean-7ms5[/bold]",
)


class Role(enum.StrEnum):
    LEADER = "leader"
    FOLLOWER = "follower"


class Target(enum.StrEnum):
    DK = "nrf52840dk"
    SIM = "sim"


class Board(enum.StrEnum):
    SIM = "sim"
    BENCH = "bench"


WorkspaceOption = Annotated[
    Path | None,
    typer.Option(
        "--workspace",
        help="Zephyr workspace (default: ZEPHYR_BASE, the enclosing west workspace, "
        "~/zephyrproject).",
    ),
]


@app.command()
def build(
    role: Annotated[Role | None, typer.Option(help="Only this role (default: both).")] = None,
    target: Annotated[Target | None, typer.Option(help="Only this target (default: both).")] = None,
    workspace: WorkspaceOption = None,
    where: Annotated[
        bool, typer.Option("--where", help="Only print the workspace that would be used.")
    ] = False,
) -> None:
    """Build the firmware images with west and print their manifests.

    Example: [bold]hil build --role leader --target sim[/bold]
    """
    from rich.console import Console  # noqa: PLC0415 (start-up time of --help)

    from hil import build as orchestrator  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415

    if where:
        typer.echo(orchestrator.find_workspace(workspace).path)
        return
    console = Console()
    for one_target in [target] if target else list(Target):
        for one_role in [role] if role else list(Role):
            with _progress(f"{one_role} for {one_target}") as progress:
                manifest = orchestrator.build(
                    one_role.value, one_target.value, workspace=workspace, progress=progress
                )
            if manifest.unchanged:
                console.print(f"{one_role} for {one_target}: nothing changed since it was built")
            terminal.render_manifest(manifest.to_mapping(), console)


@app.command()
def record(
    scenario: Annotated[Path, typer.Argument(help="Scenario file, TOML.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the new recording; must not exist.")
    ],
    board: Annotated[Board, typer.Option(help="Where to run.")] = Board.SIM,
    workspace: WorkspaceOption = None,
) -> None:
    """Run a scenario live and keep everything it produced as a recording.

    Example: [bold]hil record fixtures/scenarios/clean-7ms5.toml -o my-run[/bold]
    """
    from hil import library, run  # noqa: PLC0415

    path = library.target(output.parent, output.name)
    try:
        with _progress(f"recording {scenario.stem}") as progress:
            recording = run.live(board.value, scenario, workspace, path, progress)
    except BaseException:
        if not path.exists():
            path.parent.rmdir()
        raise
    library.write_readme(recording, path)
    typer.echo(f"recorded {path}")
    _judge_and_show([(path, recording)])


@app.command()
def replay(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders or .mcap files.")],
) -> None:
    """Judge recordings and print every measurement; exit 1 when a check fails.

    Example: [bold]hil replay fixtures/recordings/clean-7ms5[/bold]
    """
    _judge_and_show([(path, recording) for path, recording in _load(recordings)])


@app.command()
def report(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders or .mcap files.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
) -> None:
    """Write report.json, junit.xml and one self-contained index.html; exit 1 on a failed check.

    A recording that was made to fail counts as sound when its named checks fail.

    Example: [bold]hil report fixtures/recordings/* -o build/report[/bold]
    """

    from hil import checks  # noqa: PLC0415
    from hil import report as views  # noqa: PLC0415

    judged = []
    with _progress("judging") as progress:
        loaded = list(_load(recordings))
        for n, (path, recording) in enumerate(loaded):
            progress(n / len(loaded), str(path))
            judged.append(
                views.Result(recording, checks.evaluate(recording), checks.series(recording))
            )
        document = views.build(judged)
        views.write(document, output)
    views.terminal.render(document, views.terminal.console())
    typer.echo(f"report: {output / 'index.html'}")
    if not views.sound(document):
        raise typer.Exit(1)


@app.command()
def pil(
    inputs: Annotated[
        list[str] | None,
        typer.Argument(help="Recordings, or names of simulated lifts (default: bench deadlift)."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of chips, noise and motion.")] = 3,
    batch: Annotated[
        int, typer.Option(min=1, max=16, help="Follower samples that arrive at once.")
    ] = 4,
) -> None:
    """Run the estimator on an emulated Cortex-M4F: equal bits, instructions, load, stack.

    Exit 1 when a check fails.

    Example: [bold]hil pil snatch fixtures/recordings/imu-rest[/bold]
    """
    from hil import pil as processor  # noqa: PLC0415
    from hil.pil import show  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415

    names = inputs or ["bench", "deadlift"]
    sound = True
    with _progress("building for the Cortex-M4F") as progress:
        image = processor.build(progress=progress)
    for name in names:
        with _progress(name) as progress:
            if Path(name).exists():
                samples, params = processor.recorded(Path(name))
            else:
                samples, params = processor.simulated(name, seed, batch_samples=batch), None
            found = processor.assess(image, samples, params, progress=progress)
        judged = processor.measurements(found)
        show.render(name, found, judged, terminal.console())
        sound = sound and all(one.verdict.ok for one in judged)
    if not sound:
        raise typer.Exit(1)


def _load(paths: list[Path]) -> Iterator[tuple[Path, Recording]]:
    from hil import library  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415

    for path in paths:
        file = library.resolve(path)
        yield file, load(file)


def _judge_and_show(loaded: list[tuple[Path, Recording]]) -> None:

    from hil import checks  # noqa: PLC0415
    from hil import report as views  # noqa: PLC0415

    document = views.build([(recording, checks.evaluate(recording)) for _, recording in loaded])
    views.terminal.render(document, views.terminal.console())
    if not views.passed(document):
        raise typer.Exit(1)


@contextmanager
def _progress(title: str) -> Iterator[Progress]:
    """A progress bar on a terminal, a line per step elsewhere nothing but the result."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[what]}", style="dim"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(title, total=1.0, what="")

        def update(share: float, what: str) -> None:
            bar.update(task, completed=share, what=what)

        yield update


def main() -> None:
    """Entry point: errors raised on purpose become one clear message and exit code 2."""
    from hil.errors import HilError  # noqa: PLC0415

    try:
        app()
    except HilError as error:
        typer.echo(f"hil: {error}", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        typer.echo("hil: interrupted", err=True)
        sys.exit(130)
