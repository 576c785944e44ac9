# SPDX-License-Identifier: Apache-2.0
"""The bench file ``boards/bench.toml``: which probe is which role, which wire goes where.

The keys are described in ``docs/bench.md``; ``boards/bench.example.toml`` is a whole one.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NoReturn

from hil.bench import pins
from hil.bench.errors import InventoryError
from hil.errors import printable, shorten
from hil.wire.messages import ROLES

FORMAT: Final = 1
SIZE_LIMIT_B: Final = 64 * 1024
RUNNERS: Final = ("nrfutil", "nrfjprog", "jlink", "openocd", "pyocd")
"""Programs that drive a probe, in the order in which they are tried."""

MEND_NO_FILE: Final = (
    "connect both boards by USB and write one: hil bench init\n"
    "or copy boards/bench.example.toml and fill in the serial numbers of your probes"
)
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_SERIAL: Final = re.compile(r"[0-9A-Za-z]{1,64}")


@dataclass(frozen=True)
class Board:
    """One board.

    Attributes:
        role: ``leader`` or ``follower``.
        probe: serial number of its debug probe, without leading zeros.
        vcom: USB interface number of the virtual port that the firmware speaks on.
        device_id: FICR DEVICEID of its chip; None when the file does not say.
    """

    role: str
    probe: str
    vcom: int = 0
    device_id: int | None = None


@dataclass(frozen=True)
class Signal:
    """One pin of one board, written ``leader.pulse``."""

    role: str
    signal: str

    @property
    def pin(self) -> pins.Pin:
        return pins.PINS[self.signal]

    def __str__(self) -> str:
        return f"{self.role}.{self.signal}"


@dataclass(frozen=True)
class Wire:
    """A wire between the two boards, from an output to an input."""

    start: Signal
    end: Signal


@dataclass(frozen=True)
class Analyser:
    """The logic analyser.

    Attributes:
        kind: ``sigrok`` or ``saleae``.
        samplerate_hz: rate to sample at.
        driver: sigrok's driver, with ``:conn=...`` where two of a kind are connected.
        channels: the analyser's own name of a channel -> what it is wired to.
    """

    kind: str
    samplerate_hz: int
    driver: str = ""
    channels: Mapping[str, Signal] = field(default_factory=dict)


@dataclass(frozen=True)
class Place:
    """A place that a labgrid coordinator lends out: its name and the client program."""

    name: str
    client: str = "labgrid-client"


@dataclass(frozen=True)
class Inventory:
    """One bench.

    Attributes:
        path: the file that says so.
        boards: role -> board; both roles.
        wires: wires between the boards; none where an analyser does the timing.
        analyser: None when there is none.
        runner: one of :data:`RUNNERS`; empty to take the first that is ready.
        place: None when the bench belongs to this machine alone.
    """

    path: Path
    boards: Mapping[str, Board]
    wires: tuple[Wire, ...] = ()
    analyser: Analyser | None = None
    runner: str = ""
    place: Place | None = None


def normal_serial(text: str | int) -> str:
    """A probe's serial number as every tool can be told it: USB pads J-Link's with zeros."""
    written = str(text).strip()
    return (written.lstrip("0") or "0") if written.isdigit() else written


def load(path: Path) -> Inventory:
    """Read and check a bench file.

    Raises:
        InventoryError: it is missing or wrong; the message names file, line and key.
    """
    try:
        if path.stat().st_size > SIZE_LIMIT_B:
            raise InventoryError(
                f"{path}: larger than {SIZE_LIMIT_B // 1024} KiB; this is no bench file",
                MEND_NO_FILE,
            )
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InventoryError(f"there is no bench file {path}", MEND_NO_FILE) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InventoryError(f"{path} cannot be read: {error}", MEND_NO_FILE) from error
    return parse(text, path)


def parse(text: str, path: Path) -> Inventory:
    """As :func:`load`, of a file's text.

    Raises:
        InventoryError: as :func:`load`.
    """
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise InventoryError(
            f"{path} is not TOML that can be read: nested too deep",
            "compare with boards/bench.example.toml",
        ) from None
    except ValueError as error:
        # ValueError: also of numbers with thousands of digits.
        raise InventoryError(
            printable(f"{path} is not TOML: {shorten(str(error))}"),
            "compare with boards/bench.example.toml",
        ) from error
    return _Reader(text, path).inventory(data)


class _Reader:
    """Checks the data of one file; knows its text, to say on which line a key stands."""

    def __init__(self, text: str, path: Path) -> None:
        self.lines = text.splitlines()
        self.path = path

    def inventory(self, data: Mapping[str, Any]) -> Inventory:
        self.keys(data, "", ("format", "boards", "wires", "analyser", "probes", "labgrid"))
        self.integer(data, "", "format", range(FORMAT, FORMAT + 1))
        boards = self.boards(self.table(data, "", "boards"))
        return Inventory(
            path=self.path,
            boards=boards,
            wires=self.wires(data.get("wires", [])),
            analyser=self.analyser(data) if "analyser" in data else None,
            runner=self.runner(data),
            place=self.place(data) if "labgrid" in data else None,
        )

    def boards(self, data: Mapping[str, Any]) -> dict[str, Board]:
        self.keys(data, "boards", tuple(ROLES), required=tuple(ROLES))
        boards = {role: self.board(role, self.table(data, "boards", role)) for role in ROLES}
        leader, follower = (boards[role] for role in ROLES)
        if leader.probe == follower.probe:
            self.fail(
                "boards.follower",
                "probe",
                f"probe {leader.probe} is named for both roles",
                "each board has a probe of its own; `hil doctor` lists those that are connected",
            )
        if leader.device_id is not None and leader.device_id == follower.device_id:
            self.fail(
                "boards.follower",
                "device_id",
                f"chip 0x{leader.device_id:016x} is named for both roles",
                "take both device_id lines out; `hil doctor` shows what each board says",
            )
        return boards

    def board(self, role: str, data: Mapping[str, Any]) -> Board:
        where = f"boards.{role}"
        self.keys(data, where, ("probe", "vcom", "device_id"), required=("probe",))
        probe = data["probe"]
        if isinstance(probe, bool) or not isinstance(probe, int | str):
            self.fail(where, "probe", "a serial number is needed", 'for instance probe = "683..."')
        if isinstance(probe, int) and not 0 <= probe < 10**64:
            self.fail(where, "probe", "no probe has such a number", "it is on the DK's sticker")
        if not _SERIAL.fullmatch(str(probe)):
            self.fail(
                where,
                "probe",
                f"'{probe}' is no serial number of a probe",
                "the number is printed on the sticker of the DK and shown by `hil doctor`",
            )
        device_id = None
        if "device_id" in data:
            written = self.string(data, where, "device_id")
            if not re.fullmatch(r"0x[0-9a-fA-F]{16}", written):
                self.fail(
                    where,
                    "device_id",
                    f"'{written}' is no FICR DEVICEID",
                    "it is written as 0x and 16 hex digits; `hil doctor` shows it",
                )
            device_id = int(written, 16)
        return Board(
            role, normal_serial(probe), self.integer(data, where, "vcom", range(16), 0), device_id
        )

    def wires(self, data: Any) -> tuple[Wire, ...]:
        if not isinstance(data, list) or not all(isinstance(row, dict) for row in data):
            self.fail("", "wires", "a list of tables is needed", "each one begins with [[wires]]")
        wires: list[Wire] = []
        for row in data:
            self.keys(row, "wires", ("from", "to"), required=("from", "to"))
            start = self.signal(self.string(row, "wires", "from"), "wires", "from")
            end = self.signal(self.string(row, "wires", "to"), "wires", "to")
            if not start.pin.is_output or end.signal != "pulse_in" or start.role == end.role:
                self.fail(
                    "wires",
                    "to",
                    f"a wire from {start} to {end} tells nothing",
                    'from = "leader.pulse" goes to = "follower.pulse_in", and the other way round',
                    text=row["to"],
                )
            if any(wire.end == end for wire in wires):
                self.fail(
                    "wires", "to", f"two wires drive {end}", "take one of them out", text=row["to"]
                )
            wires.append(Wire(start, end))
        return tuple(wires)

    def analyser(self, root: Mapping[str, Any]) -> Analyser:
        data = self.table(root, "", "analyser")
        self.keys(
            data,
            "analyser",
            ("kind", "driver", "samplerate_hz", "channels"),
            required=("kind", "samplerate_hz", "channels"),
        )
        kind = self.choice(data, "analyser", "kind", ("sigrok", "saleae"))
        driver = self.string(data, "analyser", "driver", "")
        if kind == "sigrok" and not driver:
            self.fail(
                "analyser",
                "driver",
                "sigrok needs the name of a driver",
                'most cheap analysers: driver = "fx2lafw"; `sigrok-cli --scan` finds yours',
            )
        channels: dict[str, Signal] = {}
        used: dict[Signal, str] = {}
        for name, what in self.table(data, "analyser", "channels").items():
            where = "analyser.channels"
            if not _NAME.fullmatch(name):
                self.fail(where, name, f"'{name}' is no name of a channel", "for instance D0")
            if not isinstance(what, str):
                self.fail(where, name, "a signal is needed", 'for instance D0 = "leader.pulse"')
            signal = self.signal(what, where, name)
            if signal in used:
                self.fail(
                    where,
                    name,
                    f"{signal} is on channel {used[signal]} already",
                    "one channel to a signal; take one of the two lines out",
                )
            used[signal] = name
            channels[name] = signal
        rate = self.integer(data, "analyser", "samplerate_hz", range(1_000, 1_000_000_001))
        return Analyser(kind, rate, driver, channels)

    def runner(self, root: Mapping[str, Any]) -> str:
        if "probes" not in root:
            return ""
        data = self.table(root, "", "probes")
        self.keys(data, "probes", ("runner",))
        return self.choice(data, "probes", "runner", RUNNERS) if "runner" in data else ""

    def place(self, root: Mapping[str, Any]) -> Place:
        data = self.table(root, "", "labgrid")
        self.keys(data, "labgrid", ("place", "client"), required=("place",))
        name = self.string(data, "labgrid", "place")
        if not _NAME.fullmatch(name):
            self.fail(
                "labgrid", "place", f"'{name}' is no name of a place", "labgrid-client places"
            )
        return Place(name, self.string(data, "labgrid", "client", "labgrid-client"))

    def signal(self, text: str, where: str, key: str) -> Signal:
        role, _, name = text.partition(".")
        if role not in ROLES:
            self.fail(
                where,
                key,
                f"'{text}' names no board",
                f"write {' or '.join(ROLES)}, a dot and a signal: leader.pulse"
                + _suggest(role, ROLES),
                text=text,
            )
        pin = pins.find(name)
        if pin is None:
            names = [*pins.PINS, *(p.pin for p in pins.PINS.values())]
            shown = ", ".join(f"{p.signal} ({p.pin})" for p in pins.PINS.values())
            self.fail(
                where,
                key,
                f"'{name}' is no pin of the map in boards/README.md",
                f"there are {shown}" + _suggest(name, names),
                text=text,
            )
        return Signal(role, pin.signal)

    def keys(
        self,
        data: Mapping[str, Any],
        where: str,
        known: tuple[str, ...],
        required: tuple[str, ...] = (),
    ) -> None:
        for key in data:
            if key not in known:
                self.fail(
                    where,
                    key,
                    f"unknown key '{key}'",
                    f"known here: {', '.join(known)}" + _suggest(key, known),
                )
        for key in required:
            if key not in data:
                self.fail(
                    where, "", f"'{key}' is missing", f"add it under [{where}]; see docs/bench.md"
                )

    def table(self, data: Mapping[str, Any], where: str, key: str) -> Mapping[str, Any]:
        value = data.get(key)
        if not isinstance(value, dict):
            name = f"{where}.{key}" if where else key
            self.fail(where, key, f"the table [{name}] is missing", "see docs/bench.md")
        return value

    def string(
        self, data: Mapping[str, Any], where: str, key: str, default: str | None = None
    ) -> str:
        value = data.get(key, default)
        if not isinstance(value, str) or "\0" in value or len(value) > 1024:
            self.fail(where, key, "a text is needed", f'for instance {key} = "..."')
        return value

    def choice(
        self, data: Mapping[str, Any], where: str, key: str, allowed: tuple[str, ...]
    ) -> str:
        value = self.string(data, where, key)
        if value not in allowed:
            self.fail(
                where,
                key,
                f"'{value}' is not known",
                f"one of {', '.join(allowed)}" + _suggest(value, allowed),
            )
        return value

    def integer(
        self,
        data: Mapping[str, Any],
        where: str,
        key: str,
        allowed: range,
        default: int | None = None,
    ) -> int:
        value = data.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value not in allowed:
            low, high = allowed[0], allowed[-1]
            text = f"{low}" if low == high else f"a whole number from {low} to {high}"
            self.fail(where, key, "missing or out of range", f"write {key} = {text}")
        return value

    def fail(self, where: str, key: str, what: str, mend: str, *, text: str = "") -> NoReturn:
        name = ".".join(part for part in (where, key) if part)
        number = self.line_of(where, key, text)
        at = f"{self.path}:{number}" if number else str(self.path)
        said = ": ".join(shorten(part) for part in (name, what) if part)
        raise InventoryError(printable(f"{at}: {said}"), mend)

    def line_of(self, where: str, key: str, text: str) -> int:
        """Number of the line that ``key`` of table ``where`` stands on, or of the table's head.

        ``tomllib`` does not tell lines, so the text is searched; 0 when nothing is found.
        """
        head, table = 0, ""
        heads: dict[str, int] = {}
        for number, line in enumerate(self.lines, 1):
            if line.lstrip().startswith("["):
                table = re.sub(r"[\s\"'\[]", "", line.partition("]")[0])
                heads.setdefault(table, number)
            elif found := re.match(r"""\s*["']?([^"'=\s]+)["']?\s*=""", line):
                full = f"{table}.{found[1]}" if table else found[1]
                wanted = f"{where}.{key}" if where else key
                if full == wanted and text in line:
                    return number
                if wanted.startswith(f"{full}.") or full == where:
                    head = head or number
        return heads.get(f"{where}.{key}" if where else key, 0) or heads.get(where, 0) or head


def _suggest(written: str, known: Collection[str]) -> str:
    close = difflib.get_close_matches(written.lower(), [k.lower() for k in known], 1)
    if not close:
        return ""
    return f"\ndid you mean '{next(k for k in known if k.lower() == close[0])}'?"
