# SPDX-License-Identifier: Apache-2.0
"""The ``hil`` command. Each command is thin: parse, call one function, show the result."""

from __future__ import annotations

import enum
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.bench import cli as bench_cli

if TYPE_CHECKING:
    from hil.backends import Progress
    from hil.build import BabbleSim, Manifest
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
def calibrate(
    *,
    role: Annotated[Role, typer.Option(help="Which unit.")],
    port: Annotated[
        str | None, typer.Option(help="Its serial port (default: as boards/bench.toml says).")
    ] = None,
    board: Annotated[Board, typer.Option(help="Where the unit is.")] = Board.BENCH,
    poses: Annotated[
        int,
        typer.Option(min=6, max=24, help="Six faces and more; from 9 on skewed axes are fitted."),
    ] = 6,
    rest_s: Annotated[
        float, typer.Option("--rest", min=5.0, max=3600.0, help="Rest for the gyroscope, s.")
    ] = 60.0,
    gravity_mps2: Annotated[
        float, typer.Option("--gravity", min=9.76, max=9.84, help="Where you are, m/s^2.")
    ] = 9.80665,
    source: Annotated[
        Path | None, typer.Option("--from", help="Write this record instead of measuring.")
    ] = None,
    to_defaults: Annotated[
        Path | None,
        typer.Option(help="Write a Kconfig fragment to this file, not to the unit."),
    ] = None,
    dry_run: Annotated[bool, typer.Option(help="Measure and show; write nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Write without asking.")] = False,
    folder: Annotated[Path, typer.Option(help="Where records are kept.")] = Path("calibrations"),
    seed: Annotated[int, typer.Option(help="Which chip the simulated unit has.")] = 1,
    speed: Annotated[
        float, typer.Option(min=0.0, help="Pace of the simulated unit; 0: as fast as it goes.")
    ] = 5.0,
    workspace: WorkspaceOption = None,
) -> None:
    """Calibrate a unit's sensor: lay it on six faces, leave it for a minute.

    It takes 3 min. Each face is taken by itself, once the unit lies still.
    Then the result is shown, and a question asked. Only after that something
    is written: a record in --folder, and the unit's flash, which is read back;
    the unit is reset and its boot check looked at. Ctrl-C is safe at any time.

    With --from and --to-defaults together no unit is needed.

    Example: [bold]hil calibrate --role leader --board sim --dry-run[/bold]
    """
    from rich.console import Console  # noqa: PLC0415

    from hil import units  # noqa: PLC0415
    from hil.calibration.record import load  # noqa: PLC0415
    from hil.calibration.tool import command, guide  # noqa: PLC0415

    screen = command.screen_on(Console(), yes)
    if source is not None and to_defaults is not None:
        command.write_defaults(load(source), to_defaults, screen, dry_run=dry_run)
        return
    with ExitStack() as stack:
        if port is not None:
            reached = stack.enter_context(units.at_port(port))
        elif board is Board.SIM:
            image, babblesim = _image_for_sim(role, workspace)
            reached = stack.enter_context(units.simulated(image, babblesim, seed=seed, speed=speed))
            screen.say(reached.note, "cyan")
        else:
            reached = stack.enter_context(units.on_bench(role.value, bench_cli.DEFAULT_FILE))
        command.calibrate(
            reached.port,
            role.value,
            guide.Plan(poses, rest_s, gravity_mps2),
            screen,
            helper=reached.helper,
            source=source,
            to_defaults=to_defaults,
            folder=folder,
            dry_run=dry_run,
        )


def _image_for_sim(role: Role, workspace: Path | None) -> tuple[Manifest, BabbleSim]:
    from hil import build as orchestrator  # noqa: PLC0415

    with _progress(f"building {role} for sim") as progress:
        image = orchestrator.build(role.value, "sim", workspace=workspace, progress=progress)
    return image, orchestrator.find_babblesim(orchestrator.find_workspace(workspace))


@app.command()
def noise(
    recording: Annotated[Path, typer.Argument(help="Recording of units that lie still.")],
    role: Annotated[Role | None, typer.Option(help="Only this unit (default: both).")] = None,
) -> None:
    """Show a sensor's white noise and bias instability, by the Allan deviation of a long rest.

    Example: [bold]hil noise fixtures/recordings/cal-boot --role leader[/bold]
    """
    from rich.console import Console  # noqa: PLC0415

    from hil.imu.noise import rest_noise  # noqa: PLC0415
    from hil.imu.noise_table import table  # noqa: PLC0415

    console = Console()
    ((_, loaded),) = _load([recording])
    for one in [role] if role else list(Role):
        console.print(table(one.value, rest_noise(loaded, one.value)))


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


app.add_typer(bench_cli.app)
app.command()(bench_cli.doctor)


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
