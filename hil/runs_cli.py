# SPDX-License-Identifier: Apache-2.0
"""``hil build``, ``record``, ``replay``, ``report``, ``calibrate``, ``noise`` and ``pil``.

Each is thin: parse, call one function, show the result.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.bench import BENCH_FILE
from hil.progress import bar as _progress

if TYPE_CHECKING:
    from hil.build import BabbleSim, Manifest
    from hil.recording import Recording
    from hil.report import Document


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

InjectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--inject",
        metavar="KIND[:STREAM][=VALUE][@FROM..TO]",
        help="Make a fault, to see the checks catch it: docs/faults.md; may be repeated.",
    ),
]

HistoryOption = Annotated[
    Path | None,
    typer.Option(help="Keep the run in this history, e.g. build/history.sqlite: hil history."),
]


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


def record(
    scenario: Annotated[Path, typer.Argument(help="Scenario file, TOML.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the new recording; must not exist.")
    ],
    *,
    board: Annotated[Board, typer.Option(help="Where to run.")] = Board.SIM,
    workspace: WorkspaceOption = None,
    images: Annotated[
        Path | None,
        typer.Option(help="On the bench: images built before, in DIR/leader and DIR/follower."),
    ] = None,
    lock_wait: Annotated[
        float, typer.Option(min=0.0, help="On the bench: wait so long for another run's end, s.")
    ] = 0.0,
    speed: Annotated[
        float,
        typer.Option(
            min=0.0, max=1000.0, help="Simulated: at most X times real time; 0: no limit."
        ),
    ] = 0.0,
    inject: InjectOption = None,
    history: HistoryOption = None,
) -> None:
    """Run a scenario live and keep everything it produced as a recording.

    Exit code 1 when a check failed, 10 when the rig did.

    Example: [bold]hil record fixtures/scenarios/clean-7ms5.toml -o my-run[/bold]

    Example: [bold]hil record --inject drop:follower=1e-4@5..20 SCENARIO -o my-run[/bold]
    """
    from hil import library, run  # noqa: PLC0415
    from hil.errors import RigError  # noqa: PLC0415
    from hil.faults import parse_all, refuse_unless_possible  # noqa: PLC0415

    injected = parse_all(inject or ())
    refuse_unless_possible(injected, board.value)
    path = library.target(output.parent, output.name)
    try:
        with _progress(f"recording {scenario.stem}") as progress:
            bench = run.BenchOptions(images=images, lock_wait_s=lock_wait)
            recording = run.live(
                *(board.value, scenario, workspace, path, progress),
                bench=bench,
                inject=injected,
                speed=speed,
            )
    except BaseException as error:
        if not path.exists():
            path.parent.rmdir()
        if isinstance(error, RigError):
            typer.echo(f"hil: {error}", err=True)
            raise typer.Exit(_exit_code("rig_failure")) from error
        raise
    library.write_readme(recording, path)
    typer.echo(f"recorded {path}")
    _judge_and_show([(path, recording)], history, live=True)


def replay(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders or .mcap files.")],
    param: Annotated[
        list[str] | None,
        typer.Option("--param", help="Instead: the estimator with NAME=VALUE; may be repeated."),
    ] = None,
    inject: InjectOption = None,
) -> None:
    """Judge recordings and print every measurement.

    With --param: run the estimator over them again with other parameters, and print what changes.

    Exit code 1 when a check failed, 10 when a recording is not whole.

    Example: [bold]hil replay fixtures/recordings/clean-7ms5[/bold]

    Example: [bold]hil replay --param zupt_dwell=60 fixtures/recordings/clean-7ms5[/bold]

    Example: [bold]hil replay --inject drop=1e-4 fixtures/recordings/clean-7ms5[/bold]
    """
    from hil.faults import apply, parse_all  # noqa: PLC0415

    injected = parse_all(inject or ())
    if param and injected:
        raise typer.BadParameter("--param and --inject do not go together")
    if param:
        from hil.tuning.cli import replay_with  # noqa: PLC0415

        replay_with(recordings, param)
        return
    _judge_and_show([(path, apply.inject(one, injected)) for path, one in _load(recordings)])


def report(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders or .mcap files.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
    *,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Put two side by side: recordings, report.json files, or their folders.",
        ),
    ] = False,
    summary: Annotated[
        Path | None,
        typer.Option(
            envvar="GITHUB_STEP_SUMMARY", help="Append a Markdown summary of the job to this file."
        ),
    ] = None,
    league: Annotated[
        Path | None,
        typer.Option(help="Show this league of other trackers too: league.json of hil compare."),
    ] = None,
    history: HistoryOption = None,
) -> None:
    """Write report.json, junit.xml, badge.json and one self-contained index.html.

    A recording that was made to fail counts as sound when its named checks fail.
    Exit code 0 when all is sound, 1 when a check of the product failed, 10 when the rig failed, 11
    when nothing was run.

    With --compare: compare.html and a table, what changed first; exit code 1 when a check of the
    second is worse than the first's and does not pass.

    Example: [bold]hil report fixtures/recordings/* -o build/report[/bold]

    Example: [bold]hil report --compare runs/before runs/today -o build/compare[/bold]
    """

    from hil import report as views  # noqa: PLC0415
    from hil.report import summary as job  # noqa: PLC0415

    if compare:
        _compare(recordings, output)
        return
    document = _judged(recordings)
    if league is not None:
        from hil.compare import show  # noqa: PLC0415

        rows, _ = show.read_json(league)
        document["league"] = show.as_tables(rows)
    views.write(document, output)
    views.terminal.render(document, views.terminal.console())
    typer.echo(f"report: {output / 'index.html'}")
    if summary is not None:
        job.append(document, summary)
    _keep(document, history)
    raise typer.Exit(_exit_code(document["outcome"]))


def _judged(recordings: list[Path]) -> Document:
    from hil import report as views  # noqa: PLC0415
    from hil.judging import judge_loaded  # noqa: PLC0415

    judged = []
    with _progress("judging") as progress:
        loaded = list(_load(recordings))
        found = judge_loaded(loaded)
        for n, ((path, recording), one) in enumerate(zip(loaded, found, strict=True), 1):
            progress(n / len(loaded), str(path))
            judged.append(views.Result(recording, *one))
        return views.build(judged)


def _compare(paths: list[Path], output: Path) -> None:
    from hil.report import compare, compare_page, reading, terminal  # noqa: PLC0415

    if len(paths) != 2:
        raise typer.BadParameter("--compare takes two: hil report --compare A B -o DIR")
    first, second = (
        reading.load(path) if reading.is_report(path) else _judged([path]) for path in paths
    )
    found = compare.compare(first, second, (str(paths[0]), str(paths[1])))
    page = compare_page.write(found, output)
    compare.render(found, terminal.console())
    typer.echo(f"comparison: {page}")
    raise typer.Exit(1 if found.worse else 0)


def _keep(document: Document, history: Path | None) -> None:
    if history is None:
        return
    from hil.history.store import open_history  # noqa: PLC0415

    with open_history(history, create=True) as kept:
        kept.add(document)


def _exit_code(outcome: str) -> int:
    from hil.report import EXIT_CODES  # noqa: PLC0415

    return EXIT_CODES[outcome]


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
    from hil.calibration.tool.screen import Screen  # noqa: PLC0415

    screen = Screen(Console(), yes)
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
            reached = stack.enter_context(units.on_bench(role.value, BENCH_FILE))
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


def noise(
    recording: Annotated[Path, typer.Argument(help="Recording of units that lie still.")],
    role: Annotated[Role | None, typer.Option(help="Only this unit (default: both).")] = None,
) -> None:
    """Show a sensor's white noise and bias instability, by the Allan deviation of a long rest.

    Example: [bold]hil noise fixtures/recordings/cal-boot --role leader[/bold]
    """
    from rich.console import Console  # noqa: PLC0415

    from hil.calibration.noise import rest_noise  # noqa: PLC0415
    from hil.calibration.noise_table import table  # noqa: PLC0415

    console = Console()
    ((_, loaded),) = _load([recording])
    for one in [role] if role else list(Role):
        console.print(table(one.value, rest_noise(loaded, one.value)))


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


def _judge_and_show(
    loaded: list[tuple[Path, Recording]], history: Path | None = None, *, live: bool = False
) -> None:

    from hil import checks  # noqa: PLC0415
    from hil import report as views  # noqa: PLC0415

    document = views.build(
        views.Result(recording, checks.evaluate(recording), live=live) for _, recording in loaded
    )
    views.terminal.render(document, views.terminal.console())
    _keep(document, history)
    raise typer.Exit(
        _exit_code(views.gravest_outcome(entry["outcome"] for entry in document["recordings"]))
    )
