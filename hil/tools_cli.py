# SPDX-License-Identifier: Apache-2.0
"""``hil reps`` and ``hil truth``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def reps(
    recording: Annotated[Path, typer.Argument(help="Recording folder or .mcap file.")],
    partial_share: Annotated[
        float,
        typer.Option(
            "--partial", min=0.05, max=0.95, help="Below this share of the set's range: partial."
        ),
    ] = 0.6,
    csv: Annotated[Path | None, typer.Option("--csv", help="Write CSV to this file.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="Write JSON to this file.")] = None,
) -> None:
    """Show the repetitions of a recording, with velocities, times, range and tilt.

    Example: [bold]hil reps fixtures/recordings/clean-7ms5[/bold]
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.atomic import write_whole  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415
    from hil.reps import show  # noqa: PLC0415
    from hil.reps.find import repetitions  # noqa: PLC0415
    from hil.reps.trace import of_recording  # noqa: PLC0415

    file = library.resolve(recording)
    found = [repetitions(trace, partial_share) for trace in of_recording(load(file))]
    found = [one for one in found if one.repetitions]
    if csv:
        write_whole(csv, show.as_csv(found).encode("ascii"))
    if json:
        write_whole(json, show.as_json(found).encode("ascii"))
    console = terminal.console()
    if found:
        console.print(show.table(str(recording), found))
    else:
        console.print(f"{recording}: no repetition")


def truth(
    recording: Annotated[Path, typer.Argument(help="Recording folder or .mcap file.")],
    reference: Annotated[Path, typer.Argument(help="CSV of a string pot, a video, an encoder.")],
    *,
    time_column: Annotated[
        str | None, typer.Option(help="Name of the column, or its number from 1.")
    ] = None,
    value_column: Annotated[str | None, typer.Option(help="The same, of the values.")] = None,
    time_unit: Annotated[str | None, typer.Option(help="s, ms, us or ns.")] = None,
    unit: Annotated[
        str | None, typer.Option(help="m, cm, mm for heights; m/s, cm/s, mm/s for velocities.")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="Repetitions to this file.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="All figures to this file.")] = None,
    picture: Annotated[
        Path | None, typer.Option("--plot", help="Velocities and errors to this .svg or .html.")
    ] = None,
) -> None:
    """Align an outside reference with the estimate and show the errors of the estimate.

    Columns and units are found out where their names or sizes leave no doubt.

    Example: [bold]hil truth my-run encoder.csv --unit mm[/bold]
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.atomic import write_whole  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415
    from hil.reps import of_recording  # noqa: PLC0415
    from hil.truth import files, plot, score, show  # noqa: PLC0415
    from hil.truth import reference as references  # noqa: PLC0415

    known = references.read(
        reference, references.Columns(time_column, value_column, time_unit, unit)
    )
    found = score.compare(of_recording(load(library.resolve(recording))), known)
    if csv:
        write_whole(csv, files.as_csv(found).encode("ascii"))
    if json:
        write_whole(json, files.as_json(found).encode("ascii"))
    if picture:
        write_whole(picture, plot.drawn(picture, str(recording), found))
    show.render(known, found, terminal.console())
