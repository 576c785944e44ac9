# SPDX-License-Identifier: Apache-2.0
"""``hil bench ...`` and ``hil doctor``: thin commands over the functions of this package."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hil.bench import BENCH_FILE

if TYPE_CHECKING:
    from rich.console import Console

    from hil.bench.flash import BoardPair
    from hil.bench.inventory import Inventory
    from hil.bench.survey import Survey

WIDTH_WHEN_PIPED = 110

app = typer.Typer(
    name="bench",
    no_args_is_help=True,
    help="The real bench: two boards, their probes, ports and wires.",
    epilog="Example: [bold]hil bench init[/bold]",
)

FileOption = Annotated[Path, typer.Option("--file", help="The bench file.")]
WaitOption = Annotated[
    float, typer.Option("--lock-wait", min=0, help="Seconds to wait for another run to end.")
]


@app.command()
def init(
    file: FileOption = BENCH_FILE,
    leader: Annotated[str, typer.Option(help="Serial number of the leader's probe.")] = "",
    follower: Annotated[str, typer.Option(help="Serial number of the follower's probe.")] = "",
    force: Annotated[bool, typer.Option("--force", help="Write over an existing file.")] = False,
) -> None:
    """Find probes, ports and analysers, and write the bench file.

    Example: [bold]hil bench init --leader 683000001[/bold]
    """
    from hil.bench import inventory, setup, survey, wiring  # noqa: PLC0415 (start-up time)
    from hil.bench.errors import InventoryError  # noqa: PLC0415

    if file.exists() and not force:
        raise InventoryError(
            f"there is a bench file already: {file}",
            "look at it: hil bench show\nwrite it anew: hil bench init --force",
        )
    found = survey.look()
    probes = [probe.serial for probe in found.probes]
    chosen = setup.roles(probes, leader, follower) or _ask(probes)
    vcoms = (found.first_vcom(chosen[0]), found.first_vcom(chosen[1]))
    content = setup.text(chosen, vcoms, *_analyser(found))
    setup.write(file, content, force=force)
    written = inventory.load(file)
    _print(wiring.draw(written, ascii_only=_ascii_only()))
    typer.echo(f"\nwritten: {file}")
    for note in _notes(found, written):
        typer.echo(f"note: {note}")
    typer.echo("next: wire the boards as drawn, then: hil doctor")


@app.command()
def show(file: FileOption = BENCH_FILE) -> None:
    """Draw the wiring that the bench file describes."""
    from hil.bench import inventory, wiring  # noqa: PLC0415 (start-up time)

    _print(wiring.draw(inventory.load(file), ascii_only=_ascii_only()))


@app.command()
def unlock(file: FileOption = BENCH_FILE) -> None:
    """Say who is using the bench; a run that is dead holds nothing, however it died."""
    import time  # noqa: PLC0415

    from hil.bench import lock  # noqa: PLC0415 (start-up time)
    from hil.bench.errors import BenchBusyError  # noqa: PLC0415

    owner = lock.owner_of(file)
    if owner is not None:
        raise BenchBusyError(
            f"the bench {file} is in use by {owner.describe(time.time())}",
            f"wait for it, or end it on {owner.host}: kill {owner.pid}",
        )
    typer.echo(f"the bench {file} is free")


@app.command()
def flash(
    file: FileOption = BENCH_FILE,
    workspace: Annotated[Path | None, typer.Option(help="Zephyr workspace.")] = None,
    always: Annotated[
        bool, typer.Option("--always", help="Write also what the boards hold already.")
    ] = False,
    lock_wait: WaitOption = 0.0,
) -> None:
    """Build both images, write them, prove them by reading back, start the boards."""
    from hil import build  # noqa: PLC0415 (start-up time)
    from hil.wire.messages import ROLES  # noqa: PLC0415

    with _boards(file, lock_wait) as pair:
        images = build.build_images({role: {} for role in ROLES}, "nrf52840dk", workspace)
        done = pair.prepare(
            images, always=always, step=lambda role, what: typer.echo(f"{role}: {what}", err=True)
        )
        pair.reset()
    for role, board in done.items():
        how = "written and verified" if board.programmed else "already there, verified"
        typer.echo(
            f"{role}: {how}: {board.bytes_verified} bytes, build {board.build_id}, "
            f"{board.chip}, probe {board.probe} ({board.runner_version})"
        )


@app.command()
def reset(
    file: FileOption = BENCH_FILE,
    pin: Annotated[bool, typer.Option("--pin", help="Through the nRESET pin.")] = False,
    lock_wait: WaitOption = 0.0,
) -> None:
    """Start both boards' firmware anew."""
    with _boards(file, lock_wait) as pair:
        pair.reset("pin" if pin else "system")
    typer.echo("both boards were reset")


@app.command()
def recover(
    role: Annotated[str, typer.Argument(help="leader or follower.")],
    file: FileOption = BENCH_FILE,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    lock_wait: WaitOption = 0.0,
) -> None:
    """Erase a board's whole chip, calibration included, and end its access port protection."""
    from hil.wire.messages import ROLES  # noqa: PLC0415 (start-up time)

    if role not in ROLES:
        raise typer.BadParameter(f"'{role}' is neither leader nor follower", param_hint="ROLE")
    if not yes:
        typer.confirm(f"Erase everything on the {role}'s chip, calibration included?", abort=True)
    with _boards(file, lock_wait) as pair:
        pair.recover(role)
    typer.echo(f"the {role}'s chip is erased and open; next: hil bench flash")


def doctor(
    file: FileOption = BENCH_FILE,
    workspace: Annotated[Path | None, typer.Option(help="Zephyr workspace.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    write_udev: Annotated[
        Path | None,
        typer.Option("--write-udev", metavar="PATH", help="Only write the udev rules to a file."),
    ] = None,
) -> None:
    """Check this machine and the bench: tools, permissions, boards, ports, wires.

    Exit code 0 when nothing failed, else 10. Nothing is written to a board.
    """
    from hil.bench import doctor as questions  # noqa: PLC0415 (start-up time)
    from hil.bench import survey, udev  # noqa: PLC0415
    from hil.bench.wiring_check import check_wiring  # noqa: PLC0415

    if write_udev is not None:
        _write_udev(write_udev, udev.RULES)
        typer.echo(f"written: {write_udev}; now:")
        for line in udev.install_commands(write_udev):
            typer.echo(f"  {line}")
        return
    probing = questions.Probing(look=survey.look, hello=_hello, wiring=check_wiring)
    checks = questions.examine(file, probing, workspace)
    if as_json:
        typer.echo(questions.to_json(checks))
    else:
        questions.render(checks, _console())
    if questions.failed(checks):
        raise typer.Exit(questions.EXIT_FAILED)


@contextmanager
def _boards(file: Path, lock_wait_s: float) -> Iterator[BoardPair]:
    """The two boards of the bench, held for this process alone."""
    from hil.bench import inventory, lock, place  # noqa: PLC0415 (start-up time)
    from hil.bench.flash import BoardPair  # noqa: PLC0415

    bench = inventory.load(file)
    with (
        lock.hold(file, wait_s=lock_wait_s, waiting=lambda text: typer.echo(text, err=True)),
        place.acquired(bench.place),
    ):
        yield BoardPair(bench)


def _hello(path: str) -> dict[str, Any] | None:
    from hil.bench.listen import hear_hello  # noqa: PLC0415 (start-up time)
    from hil.bench.port import SerialPort  # noqa: PLC0415 (hardware library)

    with SerialPort(path) as port:
        return hear_hello(port.read_bytes)


def _ask(probes: list[str]) -> tuple[str, str]:
    """Ask which of two probes is the leader.

    Raises:
        InventoryError: nobody is there to answer.
    """
    from hil.bench.errors import InventoryError  # noqa: PLC0415 (start-up time)

    first, second = probes
    if not sys.stdin.isatty():
        raise InventoryError(
            f"two debug probes are connected, {first} and {second}; which one is the leader?",
            f"hil bench init --leader {first}\nhil bench init --leader {second}\n"
            "the serial number is on the sticker of each board",
        )
    typer.echo(f"Two debug probes are connected:\n  1  {first}\n  2  {second}")
    typer.echo("The serial number is on the sticker of each board.")
    while (answer := typer.prompt("Which one is the leader, 1 or 2", default="1")) not in (
        "1",
        "2",
    ):
        typer.echo("1 or 2, please.")
    return (first, second) if answer == "1" else (second, first)


def _analyser(found: Survey) -> tuple[str, Sequence[str]]:
    """Driver and channel names of the first analyser; no driver when there is none.

    Where it is on USB is only written when there are several: it changes with each replug.
    """
    if not found.analysers:
        return "", ()
    first = found.analysers[0]
    alone = sum(device.driver == first.driver for device in found.analysers) == 1
    return (first.driver if alone else first.spec), first.channels


def _notes(found: Survey, written: Inventory) -> list[str]:
    notes = []
    for role, board in written.boards.items():
        if found.port(board) is None:
            notes.append(f"probe {board.probe} ({role}) has no serial port; vcom = 0 is a guess")
    if not found.analysers:
        notes.append("no analyser was found; the drawing shows the wires that do without one")
    if len(found.analysers) > 1:
        names = ", ".join(device.spec for device in found.analysers)
        notes.append(f"several analysers: {names}; the first was taken")
    return notes


def _write_udev(path: Path, rules: str) -> None:
    from hil.bench.errors import InventoryError  # noqa: PLC0415 (start-up time)

    try:
        path.write_text(rules, encoding="utf-8")
    except OSError as error:
        raise InventoryError(
            f"{path} cannot be written: {error.strerror}", "name a folder of your own"
        ) from error


def _ascii_only() -> bool:
    try:
        "┌─▶·".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return True
    return False


def _console() -> Console:
    from rich.console import Console  # noqa: PLC0415 (start-up time)

    plain = Console()
    return plain if plain.is_terminal else Console(width=WIDTH_WHEN_PIPED)


def _print(lines: list[str]) -> None:
    for line in lines:
        typer.echo(line)
