# SPDX-License-Identifier: Apache-2.0
"""``hil compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def compare(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Recording folders or .mcap files.")
    ] = None,
    *,
    motion: Annotated[
        list[str] | None,
        typer.Option(help="Simulated motions: a lift, sprint, or all; may be repeated."),
    ] = None,
    broad: Annotated[
        bool, typer.Option("--broad", help="The trials 14, 15 and 24 of BROAD.")
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(envvar="HIL_DATA", help="Folder that holds broad/*.hdf5."),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Sets of each motion.")] = 3,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for league.json and league.svg.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, max=64, help="Processes (default: all processors).")
    ] = None,
) -> None:
    """Run ours and other published trackers over the same samples: a league table.

    Attitude, velocity, repetitions, drift, false and missed zero-velocity updates, cost. Where no
    truth is known of a recording, only the cost is there.

    Example: [bold]hil compare fixtures/recordings/clean-7ms5[/bold]

    Example: [bold]hil compare --motion all --broad --data ../shared/data -o build/compare[/bold]
    """
    from hil.atomic import write_whole  # noqa: PLC0415 (start-up time of --help)
    from hil.compare import machine, plot, show  # noqa: PLC0415
    from hil.compare.cases import TRIALS, Spec, motion_specs  # noqa: PLC0415
    from hil.compare.run import run_all  # noqa: PLC0415
    from hil.compare.score import league  # noqa: PLC0415
    from hil.errors import HilError  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415

    specs = [Spec("recording", str(path)) for path in recordings or []]
    specs += [spec for name in motion or [] for spec in motion_specs(name, seeds)]
    if broad and data is None:
        raise HilError("--broad needs the folder of the data", "give --data DIR, or set HIL_DATA")
    specs += [Spec("broad", trial, 0, str(data)) for trial in TRIALS if broad]
    if not specs:
        raise HilError(
            "nothing to compare on",
            "name a recording: hil compare fixtures/recordings/clean-7ms5\n"
            "or a motion: hil compare --motion bench",
        )
    with bar("comparing") as progress:
        rows = run_all(specs, jobs, progress)
    tables = league(rows)
    show.render(tables, terminal.console())
    if output:
        write_whole(output / "league.json", show.as_json(rows, machine.name()).encode("utf-8"))
        write_whole(output / "league.svg", plot.svg(tables).encode("utf-8"))
        typer.echo(f"league: {output / 'league.json'}, {output / 'league.svg'}")
