# SPDX-License-Identifier: Apache-2.0
"""``hil log``."""

from __future__ import annotations

import enum
import re
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.bench import BENCH_FILE

if TYPE_CHECKING:
    from hil.log.parts import Rotation
    from hil.log.source import Source
    from hil.recording import Recording


class Role(enum.StrEnum):
    LEADER = "leader"
    FOLLOWER = "follower"


def log(
    *,
    role: Annotated[Role | None, typer.Option(help="Only this board (default: both).")] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(
            "--port",
            help="Instead of the bench file: NAME=DEVICE or NAME=DEVICE@BAUD; may be repeated.",
        ),
    ] = None,
    bench: Annotated[Path, typer.Option("--bench-file", help="The bench file.")] = BENCH_FILE,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Recording to write (default: log-DATE-TIME.mcap)."),
    ] = None,
    rotate: Annotated[
        str | None, typer.Option(help="A new file after so long: 30s, 10min, 2h.")
    ] = None,
    rotate_size: Annotated[
        str | None, typer.Option(help="A new file when one is so large: 500kB, 100MB, 1GB.")
    ] = None,
    duration: Annotated[
        str | None, typer.Option(help="End after so long: 30s, 10min, 2h (default: Ctrl-C).")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(help="Write the CSV lines as tables: FILE-leader-shadow.csv, …")
    ] = None,
    parquet: Annotated[Path | None, typer.Option(help="The same as Parquet.")] = None,
    source: Annotated[
        list[Path] | None,
        typer.Option("--from", help="Tables of recordings that are there; nothing is logged."),
    ] = None,
) -> None:
    """Log what the boards say on their serial ports, frames and text, until Ctrl-C.

    Every byte goes into a recording that stays readable whatever happens. A port that is
    unplugged is waited for. The shadow log and other CSV lines become tables at the end.

    Example: [bold]hil log -o runs/today.mcap --csv runs/today.csv[/bold]

    Example: [bold]hil log --port leader=/dev/ttyACM0 --rotate 10min[/bold]
    """
    from hil import library  # noqa: PLC0415 (start-up time of --help)
    from hil.bench import lock  # noqa: PLC0415
    from hil.log.capture import capture  # noqa: PLC0415
    from hil.log.parts import plain_name  # noqa: PLC0415
    from hil.log.source import named, of_bench  # noqa: PLC0415
    from hil.log.until import told_to_stop  # noqa: PLC0415
    from hil.wire.messages import ROLES  # noqa: PLC0415

    if source:
        if csv is None and parquet is None:
            raise typer.BadParameter("--from takes --csv FILE or --parquet FILE, or both")
        _write_tables([library.resolve(path) for path in source], csv, parquet)
        return
    if port and role:
        raise typer.BadParameter("--role is for the bench file; --port names its own")
    rotation, duration_s = _rotation(rotate, rotate_size), _seconds("--duration", duration)
    path = plain_name(output) if output else _default_name()
    _check_parquet(parquet)
    sources: list[Source] = (
        named(port) if port else of_bench(bench, [role.value] if role else list(ROLES))
    )
    from rich.console import Console  # noqa: PLC0415

    from hil.log import show  # noqa: PLC0415

    with (
        # Named ports need not be the bench's.
        nullcontext() if port else lock.hold(bench),
        told_to_stop() as stop,
        show.live(Console(stderr=True), "logging") as update,
    ):
        found = capture(sources, path, rotation, stop=stop, show=update, duration_s=duration_s)
    show.summary(found, Console())
    _write_tables(found.parts.paths, csv, parquet)


def _rotation(every: str | None, size: str | None) -> Rotation:
    from hil.log.parts import Rotation  # noqa: PLC0415

    after_s = _seconds("--rotate", every)
    after_ns = None if after_s is None else round(after_s * 1e9)
    return Rotation(after_ns, _bytes("--rotate-size", size))


def _seconds(option: str, text: str | None) -> float | None:
    sizes = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
    return _quantity(option, text, sizes, "30s, 10min, 2h")


def _bytes(option: str, text: str | None) -> int | None:
    sizes = {"kB": 1e3, "MB": 1e6, "GB": 1e9}
    value = _quantity(option, text, sizes, "500kB, 100MB, 1GB")
    return None if value is None else round(value)


def _quantity(option: str, text: str | None, units: dict[str, float], example: str) -> float | None:
    if text is None:
        return None
    match = re.fullmatch(r"([0-9]{1,9}(?:\.[0-9]{1,6})?)\s*([A-Za-z]*)", text.strip())
    if match is None or match[2] not in units or float(match[1]) <= 0.0:
        raise typer.BadParameter(f"{text!r}: write for instance {example}", param_hint=option)
    return float(match[1]) * units[match[2]]


def _default_name() -> Path:
    from datetime import datetime  # noqa: PLC0415

    return Path(datetime.now().strftime("log-%Y%m%d-%H%M%S.mcap"))


def _check_parquet(parquet: Path | None) -> None:
    """Before an hour is logged for nothing."""
    if parquet is not None:
        from hil.extras import module  # noqa: PLC0415

        module("pyarrow.parquet")


def _write_tables(paths: list[Path], csv: Path | None, parquet: Path | None) -> None:
    if csv is None and parquet is None:
        return
    from hil.log import tables  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415

    parts: list[Recording] = []
    with bar("writing tables") as progress:
        for path in paths:
            progress(0.5 * len(parts) / len(paths), path.name)
            parts.append(load(path))
        progress(0.5, "writing")
        said = tables.write(parts, csv, parquet)
    for path, part in zip(paths, parts, strict=True):
        if not part.integrity.complete:
            typer.echo(f"note: {path} is not whole: {'; '.join(part.integrity.problems[:3])}")
    typer.echo("\n".join(said))
