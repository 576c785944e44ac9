# SPDX-License-Identifier: Apache-2.0
"""``hil plot``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def plot(
    recording: Annotated[Path, typer.Argument(help="Recording folder or .mcap file.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="FILE.svg, FILE.png or FILE.html.")
    ],
    what: Annotated[
        str, typer.Option(help="Of velocity, imu, state and zupt; several with commas.")
    ] = "velocity,imu,state,zupt",
) -> None:
    """Draw a recording: samples, velocity, all 16 states with ±1 σ, stillness, repetitions.

    Each figure says what kind of source it is from, and the build ids.

    Example: [bold]hil plot fixtures/recordings/clean-7ms5 -o clean.svg --what velocity[/bold]
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.plot import figure, write  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415

    wanted = [word.strip() for word in what.split(",") if word.strip()]
    unknown = [word for word in wanted if word not in figure.WHATS]
    if unknown or not wanted:
        raise typer.BadParameter(
            f"{', '.join(unknown) or 'nothing'}: choose of {', '.join(figure.WHATS)}",
            param_hint="--what",
        )
    write.check_ending(output)
    with bar(f"drawing {recording.name}") as progress:
        loaded = load(library.resolve(recording))
        progress(0.2, "reading")
        made = figure.figure(loaded, wanted)
        progress(0.6, "drawing")
        write.write(made, output)
    typer.echo(f"{output}: {made.label}, REPLAY of {made.name}")
