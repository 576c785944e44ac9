# SPDX-License-Identifier: Apache-2.0
"""Where the bytes come from: a recording, serial ports, the simulated bench.

All three give the same events to the one loop in :class:`Feed`, which is the only way to the page.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from hil.errors import HilError, RigError
from hil.live.page import About, Page
from hil.wire.live import LiveStream
from hil.wire.messages import schema_hash

if TYPE_CHECKING:
    from hil.bench.port import SerialPort
    from hil.build import BabbleSim, Manifest
    from hil.recording import Recording
    from hil.scenario import Scenario

STEP_S: Final = 0.025
"""How often a source is asked: more often than a browser is sent a frame."""
AT_ONCE_NS: Final = 1_000_000_000
"""Piece of a recording that is replayed as fast as it goes."""
RETRY_S: Final = 0.5
JOIN_LIMIT_S: Final = 10.0
ENDS: Final = {
    "replay": "the recording has come to its end",
    "sim": "the scenario has come to its end",
    "bench": "the ports were closed",
}


@dataclass(frozen=True)
class Bytes:
    """What a serial port of ``role`` delivered."""

    role: str
    data: bytes


@dataclass(frozen=True)
class Port:
    """The port of ``role`` is now ``open`` or ``lost``, and why."""

    role: str
    state: str
    why: str = ""


class Source(Protocol):
    """Where bytes come from.

    Attributes:
        about: how the page labels it.
        schema: the protocol table of its streams when that is not the present one.
    """

    about: About
    schema: Mapping[str, Any] | None

    def events(self, leaving: threading.Event) -> Iterator[Bytes | Port]:
        """Everything that happens, until ``leaving`` is set or there is no more.

        Raises:
            HilError: it cannot go on.
        """


class Replay:
    """A recording, at ``speed`` times its own pace; 0 as fast as it goes."""

    def __init__(self, recording: Recording, speed: float) -> None:
        provenance = recording.provenance
        of = "the simulated bench" if provenance.source == "sim" else provenance.source
        pace = f"at {speed:g} times its pace" if speed else "as fast as it goes"
        pace = "at its own pace" if speed == 1 else pace
        self.about = About(
            "replay",
            "REPLAY",
            recording.name,
            f"A recording of {of}, {pace}.",
            tuple(role for role in ("leader", "follower") if role in recording.roles),
            simulated=provenance.source in ("sim", "synthetic"),
        )
        if "leader" not in recording.roles:
            raise RigError(
                f"{recording.name} has no stream of the leader",
                "the page shows what the leader says: replay a recording of both nodes",
            )
        same = provenance.schema_hash == f"{schema_hash():016x}"
        self.schema = None if same else provenance.schema
        self._recording = recording
        self._speed = speed

    def events(self, leaving: threading.Event) -> Iterator[Bytes | Port]:
        streams = {role: self._recording.serial[role] for role in self.about.roles}
        # A clock that went back must not hold up what comes after.
        due = {r: np.maximum.accumulate(s.block_t_ns_bench) for r, s in streams.items()}
        filled = [t for t in due.values() if t.size]
        first_ns = min((int(t[0]) for t in filled), default=0)
        last_ns = max((int(t[-1]) for t in filled), default=0)
        for role in streams:
            yield Port(role, "open")
        sent = dict.fromkeys(streams, 0)
        start_s, now_ns = time.monotonic(), first_ns
        while not leaving.is_set():
            for role, stream in streams.items():
                blocks = int(np.searchsorted(due[role], now_ns, side="right"))
                whole = blocks >= len(stream.block_offset)
                end = len(stream.data) if whole else int(stream.block_offset[blocks])
                if end > sent[role]:
                    yield Bytes(role, stream.data[sent[role] : end].tobytes())
                    sent[role] = end
            if now_ns >= last_ns:
                return
            if self._speed:
                leaving.wait(STEP_S)
                passed_ns = (time.monotonic() - start_s) * self._speed * 1e9
                now_ns = min(first_ns + int(passed_ns), last_ns)
            else:
                now_ns = min(now_ns + AT_ONCE_NS, last_ns)


class SerialPorts:
    """Serial ports; one that is lost is looked for until it is back.

    Args:
        locate: role -> gives the path of its port now, or raises why there is none.
    """

    schema: Mapping[str, Any] | None = None

    def __init__(self, locate: Mapping[str, Callable[[], str]], title: str) -> None:
        self.about = About("bench", "LIVE", title, "Two boards, as they speak.", tuple(locate))
        self._locate = locate

    def events(self, leaving: threading.Event) -> Iterator[Bytes | Port]:
        lines = [_Line(role, locate) for role, locate in self._locate.items()]
        with contextlib.ExitStack() as stack:
            for line in lines:
                stack.callback(line.close)
            while not leaving.is_set():
                for line in lines:
                    yield from line.look()
                leaving.wait(STEP_S)


class _Line:
    def __init__(self, role: str, locate: Callable[[], str]) -> None:
        self._role = role
        self._locate = locate
        self._port: SerialPort | None = None
        self._again_s = float("-inf")
        self._why = ""

    def look(self) -> Iterator[Bytes | Port]:
        if self._port is None:
            if time.monotonic() < self._again_s:
                return
            try:
                self._port = self._open()
            except HilError as error:
                yield from self._lost(error)
                return
            self._why = ""
            yield Port(self._role, "open")
        try:
            data = self._port.read_bytes(0.0)
        except RigError as error:
            self.close()
            yield from self._lost(error)
            return
        if data:
            yield Bytes(self._role, data)

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _open(self) -> SerialPort:
        from hil.bench.port import SerialPort  # noqa: PLC0415 (hardware)

        # Without a way to find it again it gives up at once, and is opened anew here.
        return SerialPort(self._locate())

    def _lost(self, error: HilError) -> Iterator[Port]:
        self._again_s = time.monotonic() + RETRY_S
        why = str(error).splitlines()[0]
        if why != self._why:
            self._why = why
            yield Port(self._role, "lost", why)


def bench_ports(bench_file: Path) -> SerialPorts:
    """The boards of a bench file, found by their debuggers' serial numbers whatever their path.

    Raises:
        InventoryError: no bench file, or a mistake in it.
    """
    from hil.bench import inventory, ports  # noqa: PLC0415

    bench = inventory.load(bench_file)

    def locate(role: str) -> Callable[[], str]:
        board = bench.boards[role]
        return lambda: ports.vcom(board.probe, board.vcom)

    return SerialPorts({role: locate(role) for role in bench.boards}, str(bench_file))


def named_ports(paths: Mapping[str, str]) -> SerialPorts:
    """Serial ports by their paths.

    Raises:
        RigError: none is the leader's.
    """
    if "leader" not in paths:
        raise RigError("the leader's port is not named", "hil live --port leader=/dev/ttyACM0")

    def locate(path: str) -> Callable[[], str]:
        return lambda: path

    title = ", ".join(f"{role} {path}" for role, path in paths.items())
    return SerialPorts({role: locate(path) for role, path in paths.items()}, title)


class Simulation:
    """The firmware on the simulated bench, at ``speed`` times real time at most; 0 is no limit."""

    schema: Mapping[str, Any] | None = None

    def __init__(
        self,
        babblesim: BabbleSim,
        images: Mapping[str, Manifest],
        scenario: Scenario,
        speed: float,
    ) -> None:
        self.about = About(
            "sim",
            "SIMULATION",
            scenario.name,
            "Real firmware on a simulated radio, with simulated sensors on a simulated bar.",
            simulated=True,
        )
        self._babblesim = babblesim
        self._images = images
        self._scenario = scenario
        self._speed = speed

    def events(self, leaving: threading.Event) -> Iterator[Bytes | Port]:
        from hil.backends.sim import calibrated, executable  # noqa: PLC0415 (build extra)
        from hil.simulator import Session  # noqa: PLC0415

        programs = {role: executable(image) for role, image in self._images.items()}
        with (
            calibrated(self._scenario, programs, self._babblesim) as flash,
            Session(
                self._babblesim, programs, self._scenario, flash=flash, speed=self._speed
            ) as session,
        ):

            def said() -> Iterator[Bytes]:
                for node in session.nodes:
                    data = b"".join(data for _, data in node.serial())
                    if data:
                        yield Bytes(node.role, data)

            for node in session.nodes:
                yield Port(node.role, "open")
            next_s = time.monotonic()
            while not leaving.is_set() and session.wait():
                if time.monotonic() >= next_s:
                    next_s = time.monotonic() + STEP_S
                    yield from said()
            yield from said()
            while not leaving.is_set() and not session.drained():
                yield from said()


class Feed:
    """The thread that moves what a source gives into the page; a context manager.

    Attributes:
        lock: held while the page changes; whoever reads the page holds it too.
    """

    def __init__(
        self, source: Source, page: Page, told: Callable[[str], None] = lambda text: None
    ) -> None:
        self.lock = threading.Lock()
        self._source = source
        self._page = page
        self._told = told
        self._leaving = threading.Event()
        self._streams = {role: LiveStream(source.schema) for role in source.about.roles}
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)

    def __enter__(self) -> Feed:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._leaving.set()
        self._thread.join(JOIN_LIMIT_S)

    def _run(self) -> None:
        ended = ENDS[self._source.about.kind]
        try:
            for event in self._source.events(self._leaving):
                self._move(event)
        except HilError as error:
            ended = str(error)
            self._told(f"hil: {error}")
        except Exception as error:
            ended = f"an error of this program: {type(error).__name__}: {error}"
            self._told(f"hil: {ended}")
            raise
        finally:
            with self.lock:
                self._page.ended = ended.splitlines()[0]

    def _move(self, event: Bytes | Port) -> None:
        if isinstance(event, Port):
            if event.state == "lost":
                # What comes after is not the end of a frame that began before.
                self._streams[event.role] = LiveStream(self._source.schema)
                self._told(f"{event.role}: {event.why}")
            elif self._source.about.kind == "bench":
                self._told(f"{event.role}: connected")
            with self.lock:
                self._page.port(event.role, event.state, event.why)
            return
        found = self._streams[event.role].feed(event.data)
        with self.lock:
            self._page.take(event.role, found, time.monotonic())
