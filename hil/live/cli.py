# SPDX-License-Identifier: Apache-2.0
"""``hil live``."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.bench import BENCH_FILE

if TYPE_CHECKING:
    from rich.console import Console

    from hil.live.server import Address, Server
    from hil.live.sources import Source

SCENARIO = Path("fixtures/scenarios/clean-7ms5.toml")


class Board(enum.StrEnum):
    SIM = "sim"
    BENCH = "bench"


def live(
    recording: Annotated[
        Path | None, typer.Argument(help="Recording folder or .mcap file to replay.")
    ] = None,
    *,
    board: Annotated[Board | None, typer.Option(help="Show a bench instead.")] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(help="Or serial ports: leader=/dev/ttyACM0; may be repeated."),
    ] = None,
    scenario: Annotated[
        Path, typer.Option(help="With --board sim: what is simulated, TOML.")
    ] = SCENARIO,
    speed: Annotated[
        float,
        typer.Option(min=0.0, max=1000.0, help="Pace of replay and simulation; 0: no limit."),
    ] = 1.0,
    host: Annotated[
        str, typer.Option(help="Address to serve on; 0.0.0.0 for the whole network.")
    ] = "127.0.0.1",
    http_port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to serve on; 0: any that is free.")
    ] = 8321,
    open_: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Open a browser here (default: if there is one)."),
    ] = None,
    workspace: Annotated[
        Path | None, typer.Option(help="With --board sim: Zephyr workspace to build in.")
    ] = None,
) -> None:
    """Show a set as it is lifted: count, velocity, both sensors and their health, in a browser.

    From a recording, from two boards, or from the simulated bench. Ctrl-C ends it.

    On this machine the page needs no password. With --host ADDRESS phones on the same network can
    show it: the address printed, also as a QR code, opens it in one browser; then the next address
    is printed for the next one.

    Example: [bold]hil live fixtures/recordings/clean-7ms5[/bold]

    Example: [bold]hil live --board bench --host 0.0.0.0[/bold]
    """
    import asyncio  # noqa: PLC0415 (start-up time of --help)

    from rich.console import Console  # noqa: PLC0415

    if sum((recording is not None, board is not None, bool(port))) != 1:
        raise typer.BadParameter("name one source: a recording, --board or --port")
    console = Console(soft_wrap=True, highlight=False)
    if recording is not None:
        source = _replay(recording, speed)
    elif board is Board.SIM:
        source = _simulation(scenario, workspace, speed)
    else:
        source = _ports(port)
    asyncio.run(_run(source, console, host, http_port, open_))


def _replay(path: Path, speed: float) -> Source:
    from hil import library  # noqa: PLC0415
    from hil.live.sources import Replay  # noqa: PLC0415
    from hil.recording import load  # noqa: PLC0415

    return Replay(load(library.resolve(path)), speed)


def _simulation(path: Path, workspace: Path | None, speed: float) -> Source:
    from hil import build, scenario  # noqa: PLC0415
    from hil.live.sources import Simulation  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415

    chosen = scenario.load(path)
    babblesim = build.find_babblesim(build.find_workspace(workspace))
    with bar(f"building for {chosen.name}") as update:
        images = build.build_images(chosen.kconfig, "sim", workspace, update)
    return Simulation(babblesim, images, chosen, speed)


def _ports(named: list[str] | None) -> Source:
    from hil.live.sources import bench_ports, named_ports  # noqa: PLC0415
    from hil.wire.messages import ROLES  # noqa: PLC0415

    if not named:
        return bench_ports(BENCH_FILE)
    paths = {}
    for text in named:
        role, _, path = text.partition("=")
        if role not in ROLES or not path or role in paths:
            raise typer.BadParameter(f"--port {text}: leader=PATH or follower=PATH, each once")
        paths[role] = path
    return named_ports(paths)


async def _run(
    source: Source, console: Console, host: str, http_port: int, open_: bool | None
) -> None:
    import asyncio  # noqa: PLC0415
    import signal  # noqa: PLC0415

    from hil.live.page import Page  # noqa: PLC0415
    from hil.live.server import Address, Server, access_for, reachable  # noqa: PLC0415
    from hil.live.sources import Feed  # noqa: PLC0415

    loop, leaving = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, leaving.set)
    page = Page(source.about)
    feed = Feed(source, page, told=lambda text: console.print(text, markup=False))
    told: list[Address] = []

    def tell() -> None:
        _tell(console, told[0], server)

    server = Server(page, feed, access_for(host), traded=tell)
    async with server.listening(host, http_port) as address:
        told.append(Address(reachable(host), address.port))
        console.print(f"{source.about.label}: {source.about.title}", markup=False, style="bold")
        tell()
        console.print("Ctrl-C ends it.", style="dim")
        with feed:
            if open_ or (open_ is None and server.access.open_to_all and _has_display()):
                _open(told[0], server)
            await leaving.wait()
    console.print("ended")


def _tell(console: Console, address: Address, server: Server) -> None:
    """The address to open; as a QR code too where a phone is to open it."""
    access = server.access
    if access.open_to_all:
        console.print(address.url, style="cyan", markup=False)
        return
    if not access.token:
        console.print("No more browsers are let in: end this and start it anew.", style="yellow")
        return
    import io  # noqa: PLC0415

    import segno  # noqa: PLC0415

    url = f"{address.url}?token={access.token}"
    console.print("For one browser; the next address comes when this one has been used:")
    console.print(url, style="cyan", markup=False)
    if console.is_terminal:
        text = io.StringIO()
        segno.make(url, micro=False).terminal(text, compact=True)
        console.file.write(text.getvalue())


def _open(address: Address, server: Server) -> None:
    import threading  # noqa: PLC0415
    import webbrowser  # noqa: PLC0415

    token = f"?token={server.access.token}" if server.access.token else ""
    # Some browsers are only done when they are closed.
    threading.Thread(target=webbrowser.open, args=[address.url + token], daemon=True).start()


def _has_display() -> bool:
    import os  # noqa: PLC0415
    import sys  # noqa: PLC0415

    graphic = sys.platform == "darwin" or "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    return graphic and sys.stdout.isatty()
