# SPDX-License-Identifier: Apache-2.0
"""``hil export`` and ``hil import``."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table


class Format(enum.StrEnum):
    CSV = "csv"
    NPZ = "npz"
    HDF5 = "hdf5"
    PARQUET = "parquet"
    MCAP = "mcap"


def export(
    recording: Annotated[Path, typer.Argument(help="Recording folder or .mcap file.")],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="File; of csv and parquet, a folder that is not there."
        ),
    ],
    form: Annotated[Format, typer.Option("--format", help="Of the output.")],
) -> None:
    """Write a recording for other programs: samples, estimates, sync, events, repetitions.

    Names of columns have units and clocks in them; where it all comes from goes with it. HDF5 is in
    the layout of the BROAD benchmark; MCAP is what Foxglove and Rerun open.

    Example: [bold]hil export fixtures/recordings/clean-7ms5 -o clean.mcap --format mcap[/bold]
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.exchange import contents, export  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415

    with bar(f"exporting {recording.name}") as progress:
        loaded = load(library.resolve(recording))
        progress(0.2, "making tables")
        found = contents.contents(loaded)
        progress(0.5, f"writing {form}")
        export.write(found, form.value, output)
    rows = ", ".join(f"{name} {len(table)}" for name, table in found.tables.items())
    typer.echo(f"{output}: {found.provenance['source_label']}; rows: {rows or 'none'}")


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(help="CSV, NPZ, HDF5 or Parquet: the leader's, then the follower's."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the new recording; must not exist.")
    ],
    *,
    gyro_unit: Annotated[
        str | None, typer.Option(help="radps or dps, where the names do not say it.")
    ] = None,
    accel_unit: Annotated[str | None, typer.Option(help="mps2, g or mg, the same.")] = None,
    time_unit: Annotated[str | None, typer.Option(help="s, ms, us or ns, the same.")] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate", min=5.0, max=20000.0, help="Of files without times, Hz."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(help="QUANTITY=NAME: t, gyro_x … accel_z; may be repeated."),
    ] = None,
) -> None:
    """Make a recording of IMU data: of an export, or of another rig's one or two sensors.

    Columns are found by their names, units by the names or the options; what is in doubt is
    asked for. Both sensors' times are on one clock. The recording is labelled as imported.

    Example: [bold]hil import left.csv right.csv -o runs/theirs --gyro-unit dps[/bold]
    """
    from hil.exchange import foreign, recorded  # noqa: PLC0415 (start-up time of --help)
    from hil.progress import bar  # noqa: PLC0415
    from hil.report import terminal  # noqa: PLC0415

    columns = {}
    for text in column or ():
        quantity, equals, name = text.partition("=")
        if not equals or quantity not in ("t", *foreign.QUANTITIES):
            raise typer.BadParameter(
                f"{text!r} is not QUANTITY=NAME with one of t, {', '.join(foreign.QUANTITIES)}",
                param_hint="--column",
            )
        columns[quantity] = name
    said = foreign.Said(time_unit, gyro_unit, accel_unit, rate_hz, columns)
    with bar(f"importing {files[0].name}") as progress:
        recording, facts = recorded.imported(files, said, output.name, progress)
        progress(0.8, "writing")
        path = recorded.save(recording, output)
    terminal.console().print(_read_as(facts))
    typer.echo(f"imported {path}")


def _read_as(facts: Mapping[str, Any]) -> Table:
    """What was read, for a person to check."""
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("Read as", style="dim")
    for role in facts["sensors"]:
        table.add_column(role, overflow="fold")
    for key in dict.fromkeys(key for one in facts["sensors"].values() for key in one):
        values = [one.get(key, "") for one in facts["sensors"].values()]
        shown = [f"{v:.6g}" if isinstance(v, float) else str(v) for v in values]
        table.add_row(key, *(Text(text) for text in shown))
    return table
