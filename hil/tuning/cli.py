# SPDX-License-Identifier: Apache-2.0
"""``hil replay --param`` and ``hil tune zupt``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from hil.tuning.zupt import Tuning

app = typer.Typer(
    name="tune", no_args_is_help=True, help="Choose the estimator's parameters on recordings."
)


JobsOption = Annotated[int, typer.Option(min=1, max=64, help="Processes.")]
DaskOption = Annotated[
    str | None,
    typer.Option("--dask", help="Trusted Dask scheduler in their place, e.g. tcp://10.0.0.5:8786."),
]


@app.callback()
def main() -> None:
    """Choose the estimator's parameters on recordings."""


def replay_with(recordings: list[Path], settings: list[str]) -> None:
    """Run the estimator over recordings with other parameters and print what changes.

    Args:
        settings: NAME=VALUE each.
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.recording import load  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415
    from hil.tuning import show  # noqa: PLC0415
    from hil.tuning.rerun import rerun  # noqa: PLC0415

    for path in recordings:
        found = rerun(load(library.resolve(path)), settings)
        show.render(str(path), found, terminal.console())


@app.command()
def zupt(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders or .mcap files.")],
    *,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for zupt.csv and zupt.svg.")
    ] = None,
    cells: Annotated[int, typer.Option(min=2, max=200, help="Cells along each axis.")] = 40,
    factor: Annotated[
        float, typer.Option(min=1.5, max=1e4, help="Reach of the grid, up and down from now.")
    ] = 100.0,
    sets: Annotated[
        int, typer.Option("--try", min=0, max=200, help="Try the proposal on 2 x so many new sets.")
    ] = 10,
    folder: Annotated[
        Path | None, typer.Option("--keep", help="Keep counts here, and use those of before.")
    ] = None,
    jobs: JobsOption = 2,
    dask: DaskOption = None,
) -> None:
    """Propose both thresholds of the ZUPT detector: the middle of the widest stable range.

    Exit 1 when no thresholds are good, or the proposal fails on the new sets.

    Example: [bold]hil tune zupt fixtures/recordings/clean-7ms5 -o build/tune[/bold]
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.atomic import write_whole  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415
    from hil.tuning import grid, heatmap  # noqa: PLC0415
    from hil.tuning import zupt as tuner  # noqa: PLC0415

    wanted = grid.around(*tuner.thresholds_of(library.resolve(recordings[0])), cells, factor)
    found = tuner.tune(recordings, wanted, folder, jobs, dask)
    if output:
        write_whole(output / "zupt.csv", heatmap.as_csv(found).encode("ascii"))
        write_whole(output / "zupt.svg", heatmap.svg(found).encode("utf-8"))
    console = terminal.console()
    console.print(heatmap.terminal(found, heatmap.spans(found), "Zero-velocity spans"))
    if not _proposal(found, sets, jobs, console):
        raise typer.Exit(1)


def _proposal(found: Tuning, sets: int, jobs: int, console: Console) -> bool:
    """Print it and how it does on new sets; whether it is any good."""
    from hil.tuning import zupt as tuner  # noqa: PLC0415

    if found.plateau is None or found.proposal is None:
        console.print("no thresholds on this grid are free of false spans and missed rests")
        return False
    accel, gyro = found.proposal
    console.print(
        f"plateau: {int(found.plateau.cells.sum())} of {found.plateau.cells.size} cells\n"
        f"proposal: zupt_accel_var={accel:.2g} zupt_gyro_var={gyro:.2g}; the result stays the "
        f"same for factors up to {found.plateau.margin:.1f} on both, up or down\n"
        f"now: zupt_accel_var={found.now[0]:.2g} zupt_gyro_var={found.now[1]:.2g}",
        highlight=False,
    )
    if not any(t.false_spans is not None for t in found.tables):
        console.print("no truth is known of these recordings: false spans cannot be seen in them")
    if sets == 0:
        return True
    tried = tuner.trials(found.proposal, found.params, sets, jobs)
    for one in tried:
        if not one.passed:
            console.print(
                f"{one.name}, seed {one.seed}: {one.missed} of {one.rests} rests missed, "
                f"{one.false_zupt} false steps"
            )
    passed = sum(one.passed for one in tried)
    console.print(f"tried on {len(tried)} sets that it was not chosen on: {passed} passed")
    return passed == len(tried)


@app.command()
def ekf(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Recording folders or .mcap files.")
    ] = None,
    *,
    hold_out: Annotated[
        int | None,
        typer.Option(min=1, max=1000, help="Recordings to judge on (default: a quarter)."),
    ] = None,
    held: Annotated[
        list[Path] | None, typer.Option("--held", help="Judge on this one; may be repeated.")
    ] = None,
    sets: Annotated[
        int, typer.Option(min=0, max=1000, help="Simulated sets to take beside the recordings.")
    ] = 0,
    param: Annotated[
        list[str] | None,
        typer.Option(help="NAME=LOW:HIGH[:log], may be repeated (default: all noise, 10 x)."),
    ] = None,
    trials: Annotated[int, typer.Option(min=1, max=100_000, help="Choices to try.")] = 100,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="Of search and hold-out.")] = 0,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for tables (CSV) and ekf.svg.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--keep", help="Keep evaluations here, and go on from them.")
    ] = None,
    jobs: JobsOption = 2,
    dask: DaskOption = None,
) -> None:
    """Search the estimator's noise parameters; the proposal is better on what was held out.

    Exit 1 when nothing is proposed. What is made least stands in docs/tuning.md.

    Example: [bold]hil tune ekf my-runs/* --sets 12 --keep build/tune -o build/tune[/bold]
    """
    from hil.atomic import write_whole  # noqa: PLC0415 (start-up time of --help)
    from hil.progress import bar  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415
    from hil.tuning import ekf as tuner  # noqa: PLC0415
    from hil.tuning import ekf_show  # noqa: PLC0415
    from hil.tuning.parameters import ParameterError  # noqa: PLC0415

    if held and hold_out is not None:
        raise ParameterError("--hold-out and --held exclude each other", "give one of them")
    with bar("searching") as progress:
        found = tuner.tune(
            tuner.Wish(
                recordings or (),
                held or (),
                hold_out,
                sets,
                param or (),
                trials,
                seed,
                folder,
                jobs,
                dask,
            ),
            progress,
        )
    if output:
        write_whole(output / "ekf.csv", ekf_show.parameters_csv(found).encode("ascii"))
        write_whole(output / "ekf-recordings.csv", ekf_show.recordings_csv(found).encode())
        write_whole(output / "ekf.svg", ekf_show.svg(found).encode())
    ekf_show.render(found, terminal.console())
    if found.proposal is None:
        raise typer.Exit(1)
