# SPDX-License-Identifier: Apache-2.0
"""Which serial ports are logged: those of the bench file, or named ones."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from hil.bench import inventory, ports
from hil.bench.port import BAUD, SerialPort
from hil.errors import HilError

_NAMED: Final = re.compile(r"([a-z][a-z0-9_]{0,31})=(.+?)(?:@([1-9][0-9]{2,6}))?")


@dataclass(frozen=True)
class Source:
    """One port to be logged.

    Attributes:
        role: name of its stream.
        path: device file, now.
        resolve: gives the path of the same device later, or None while it is not there.
        what: what is known of it, for the provenance.
    """

    role: str
    path: str
    baud: int
    resolve: Callable[[], str | None]
    what: Mapping[str, Any]


def of_bench(bench_file: Path, roles: Sequence[str]) -> list[Source]:
    """The ports that a bench file names for these roles.

    Raises:
        HilError: no bench file, a mistake in it, or a board that is not there.
    """
    bench = inventory.load(bench_file)
    found = []
    for role in roles:
        board = bench.boards[role]

        resolve = partial(ports.vcom, board.probe, board.vcom)
        what = {"probe": board.probe, "vcom": board.vcom}
        found.append(Source(role, resolve(), BAUD, resolve, what))
    return found


def named(texts: Sequence[str], default_baud: int = BAUD) -> list[Source]:
    """Ports given as ``leader=/dev/ttyACM0`` or ``stringpot=/dev/ttyUSB0@921600``.

    Raises:
        HilError: written otherwise, or a role or a port twice.
    """
    found: list[Source] = []
    for text in texts:
        match = _NAMED.fullmatch(text)
        if match is None:
            raise HilError(
                f"{text!r} does not name a port", "--port leader=/dev/ttyACM0, or …@921600"
            )
        source = _at(match[1], match[2], int(match[3] or default_baud))
        for other in found:
            if other.role == source.role or other.path == source.path:
                raise HilError(f"{text}: {other.role}={other.path} was named before")
        found.append(source)
    return found


def _at(role: str, path: str, baud: int) -> Source:
    """A port by its path; one of a USB device with a serial number is followed by that."""
    real = str(Path(path).resolve())
    for port in ports.find_ports():
        if port.path in (path, real) and port.serial_number:
            key = (port.serial_number, port.interface)
            what = {"path": path, "usb_serial_number": key[0], "usb_interface": key[1]}
            return Source(role, path, baud, partial(ports.vcom, *key), what)
    return Source(role, path, baud, lambda: path if Path(path).exists() else None, {"path": path})


@contextmanager
def opened(sources: Sequence[Source]) -> Iterator[dict[str, SerialPort]]:
    """Role -> open port; a lost one is waited for as long as it takes.

    Raises:
        RigError: one is not there, not permitted, or in use.
    """
    with ExitStack() as stack:
        yield {
            s.role: stack.enter_context(
                SerialPort(s.path, s.baud, s.resolve, replug_limit_s=math.inf)
            )
            for s in sources
        }
