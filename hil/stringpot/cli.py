# SPDX-License-Identifier: Apache-2.0
"""``hil stringpot calibrate | log | convert``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from hil.bench.port import SerialPort
    from hil.stringpot.calibration import Calibration, Point
    from hil.stringpot.samples import Samples

BAUD = 921_600
"""1,000 lines of up to 17 bytes a second do not fit 115,200 baud."""
MEASURE_S = 1.0

app = typer.Typer(
    name="stringpot",
    no_args_is_help=True,
    help="A string potentiometer on an ESP32 as an outside reference: calibrate, log, convert.",
    epilog="Example: [bold]hil stringpot log --port /dev/ttyUSB0 -o pot.mcap[/bold]",
)

PortOption = Annotated[str, typer.Option(help="The ESP32's serial port.")]
BaudOption = Annotated[int, typer.Option(min=9600, max=4_000_000, help="Its baud rate.")]


@app.command()
def calibrate(
    *,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Where the calibration is written.")
    ] = Path("stringpot.toml"),
    port: Annotated[str | None, typer.Option(help="The ESP32's serial port.")] = None,
    baud: BaudOption = BAUD,
    lengths: Annotated[
        str | None, typer.Option(help="Known lengths to pull to, mm: 0,250,500,750,1000.")
    ] = None,
    point: Annotated[
        list[str] | None,
        typer.Option("--point", help="Measured before: RAW=MM; two or more, no port is needed."),
    ] = None,
) -> None:
    """Find out how many millimetres a count is, from two or more known lengths.

    Five or more over the whole travel also show whether the converter is linear.

    Example: [bold]hil stringpot calibrate --port /dev/ttyUSB0 --lengths 0,250,500,750,1000[/bold]
    """
    from rich.console import Console  # noqa: PLC0415 (start-up time of --help)

    from hil.stringpot import calibration  # noqa: PLC0415

    if bool(point) == bool(port and lengths):
        raise typer.BadParameter("--port with --lengths, or --point RAW=MM twice or more")
    console = Console()
    if point:
        points = [_point(text) for text in point]
    else:
        points = _measure(port or "", baud, [_mm(text) for text in (lengths or "").split(",")])
    found = calibration.fit(points)
    _show(found, console)
    calibration.save(found, output)
    typer.echo(f"calibration: {output}")


@app.command()
def log(
    *,
    port: PortOption,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Recording to write, .mcap.")
    ] = Path("stringpot.mcap"),
    baud: BaudOption = BAUD,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="End after so many seconds (default: Ctrl-C).")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(help="At the end, the samples as time_us,raw_adc as well.")
    ] = None,
) -> None:
    """Log time_us,raw_adc from the ESP32 into a recording, until Ctrl-C.

    It goes on when the port is unplugged and back, and stays readable whatever happens. Samples
    that are missing are counted by their times.

    Example: [bold]hil stringpot log --port /dev/ttyUSB0 -o pot.mcap --duration 60[/bold]
    """
    from rich.console import Console  # noqa: PLC0415 (start-up time of --help)

    from hil.log import show  # noqa: PLC0415
    from hil.log.capture import capture  # noqa: PLC0415
    from hil.log.parts import Rotation, plain_name  # noqa: PLC0415
    from hil.log.source import named  # noqa: PLC0415
    from hil.log.until import told_to_stop  # noqa: PLC0415
    from hil.stringpot import samples  # noqa: PLC0415
    from hil.stringpot.meter import PotMeter  # noqa: PLC0415

    sources = named([f"{samples.ROLE}={port}"], baud)
    title = "logging" if duration is None else f"logging {duration:g} s"
    with told_to_stop() as stop, show.live(Console(stderr=True), title) as update:
        found = capture(
            sources,
            plain_name(output),
            Rotation(),
            stop=stop,
            show=update,
            duration_s=duration,
            meter=PotMeter,
            notes="A string potentiometer on an ESP32, logged by hil stringpot log. The bench "
            "clock is the host's; time_us in the lines is the ESP32's own.",
        )
    show.summary(found, Console())
    if csv:
        _write_raw(found.parts.paths, csv)


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="Recording, or a CSV file of time_us,raw_adc.")],
    *,
    calibration: Annotated[
        Path, typer.Option("--calibration", help="Made by: hil stringpot calibrate.")
    ] = Path("stringpot.toml"),
    output: Annotated[
        Path, typer.Option("-o", "--output", help="CSV of time_s, position_mm, velocity_mps.")
    ] = Path("stringpot.csv"),
    cutoff: Annotated[
        float, typer.Option(min=0.5, max=200.0, help="Where the filter is 3 dB down, Hz.")
    ] = 12.0,
    order: Annotated[
        int, typer.Option(min=2, max=8, help="Of the filter, both passes together: 2, 4, 6, 8.")
    ] = 4,
    every: Annotated[int, typer.Option(min=1, max=100, help="Write each so-manieth row.")] = 1,
) -> None:
    """Filter the position without a shift in time, differentiate it, write what hil truth reads.

    Example: [bold]hil stringpot convert pot.mcap -o pot.csv && hil truth my-run pot.csv[/bold]
    """
    from hil.progress import bar  # noqa: PLC0415 (start-up time of --help)
    from hil.stringpot import calibration as calibrations  # noqa: PLC0415
    from hil.stringpot.motion import motion  # noqa: PLC0415

    known = calibrations.load(calibration)
    with bar(f"converting {source}") as progress:
        progress(0.0, "reading")
        read = _read(source)
        progress(0.4, "filtering")
        found = motion(read, known, cutoff, order)
        progress(0.7, "writing")
        _write_motion(found, output, every)
    typer.echo(
        f"read {len(read)} samples: {read.lost} lost, {read.bad_lines} bad lines, "
        f"{read.restarts} restarts ({found.other_runs} samples of shorter runs left out), "
        f"{found.spikes} spikes left out"
    )
    if found.outside:
        typer.echo(f"note: {found.outside} samples lie outside of the lengths that were calibrated")
    typer.echo(
        f"{output}: {len(found.t_s[::every])} rows in {found.segments} pieces, "
        f"{found.position_mm.min():.0f} to {found.position_mm.max():.0f} mm, "
        f"{found.velocity_mps.min():+.2f} to {found.velocity_mps.max():+.2f} m/s, low-pass of "
        f"order {order} at {cutoff:g} Hz"
    )


def _read(source: Path) -> Samples:
    from hil import library  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415
    from hil.stringpot import samples  # noqa: PLC0415

    if source.is_dir() or source.suffix == ".mcap":
        return samples.of_recording(load(library.resolve(source)))
    return samples.of_csv(source)


def _write_motion(found: Any, output: Path, every: int) -> None:
    columns = (found.t_s, found.position_mm, found.velocity_mps)
    rows = zip(*(column[::every].tolist() for column in columns), strict=True)
    lines = [f"{t:.6f},{x:.4f},{v:.6f}\n" for t, x, v in rows]
    _write(output, "time_s,position_mm,velocity_mps\n" + "".join(lines))


def _write_raw(paths: list[Path], csv: Path) -> None:
    lines = ["time_us,raw_adc\n"]
    for path in paths:
        read = _read(path)
        rows = zip((read.t_us % (1 << 32)).tolist(), read.raw.tolist(), strict=True)
        lines += [f"{t},{x}\n" for t, x in rows]
    _write(csv, "".join(lines))
    typer.echo(f"{csv}: {len(lines) - 1} samples")


def _write(path: Path, text: str) -> None:
    from hil.atomic import write_whole  # noqa: PLC0415
    from hil.stringpot.samples import StringPotError  # noqa: PLC0415

    try:
        write_whole(path, text.encode("ascii"))
    except OSError as error:
        raise StringPotError(
            f"{path}: cannot be written: {error.strerror}", "name another file"
        ) from error


def _measure(port: str, baud: int, lengths_mm: list[float]) -> list[Point]:
    from hil.log.source import named, opened  # noqa: PLC0415
    from hil.stringpot.calibration import point  # noqa: PLC0415
    from hil.stringpot.samples import ROLE, StringPotError  # noqa: PLC0415

    points = []
    with opened(named([f"{ROLE}={port}"], baud)) as ports:
        for length_mm in lengths_mm:
            while True:
                typer.prompt(
                    f"pull the string to {length_mm:g} mm, hold it, press Enter",
                    default="",
                    show_default=False,
                    prompt_suffix=" ",
                )
                try:
                    points.append(point(length_mm, _second(ports[ROLE])))
                    break
                except StringPotError as error:
                    typer.echo(f"{error.message}: once more ({error.mend})")
            typer.echo(f"  {points[-1].raw:.2f} counts ± {points[-1].sigma_raw:.2f}")
    return points


def _second(port: SerialPort) -> Samples:
    """What comes in one second from now."""
    from hil.stringpot.samples import parse  # noqa: PLC0415

    port.read(0.0)
    data, end_s = b"", time.monotonic() + MEASURE_S
    while (left_s := end_s - time.monotonic()) > 0.0:
        data += port.read_bytes(left_s)
    # The first line was cut when the queue was emptied, the last by the end.
    return parse(data.split(b"\n")[1:-1])


def _point(text: str) -> Point:
    from hil.stringpot.calibration import Point  # noqa: PLC0415

    raw, equals, length = text.partition("=")
    if not equals:
        raise typer.BadParameter(f"{text!r}: write RAW=MM, for instance 512=250")
    return Point(_mm(length), _mm(raw))


def _mm(text: str) -> float:
    import math  # noqa: PLC0415

    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or abs(value) > 1e8:
        raise typer.BadParameter(f"{text!r} is not a number")
    return value


def _show(found: Calibration, console: Console) -> None:
    from rich.table import Table  # noqa: PLC0415

    from hil.stringpot.calibration import warnings  # noqa: PLC0415

    table = Table(title="Calibration", title_justify="left")
    for heading in ("length, mm", "raw", "± raw", "residual, mm"):
        table.add_column(heading, justify="right")
    for p, residual in zip(found.points, found.residuals_mm.tolist(), strict=True):
        table.add_row(f"{p.length_mm:g}", f"{p.raw:.2f}", f"{p.sigma_raw:.2f}", f"{residual:+.2f}")
    console.print(table)
    console.print(
        f"length = {found.offset_mm:.3f} mm + {found.mm_per_count:.6f} mm per count * raw",
        highlight=False,
    )
    for text in warnings(found):
        console.print(f"warning: {text}", style="yellow", highlight=False, soft_wrap=True)
