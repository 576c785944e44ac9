# SPDX-License-Identifier: Apache-2.0
"""Which serial ports are there, told apart by USB serial number and interface, never by name.

``/dev/ttyACM0`` is whichever board came first. A DK's on-board debugger has two ports; they are
told apart by the number of their USB interface.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from hil.bench.inventory import Board
from hil.bench.port import SerialPort
from hil.errors import RigError

JLINK_VID = 0x1366
"""SEGGER, on-board debuggers included."""


@dataclass(frozen=True)
class PortInfo:
    """One serial port of a USB device.

    Attributes:
        path: device file.
        serial_number: of the USB device.
        interface: number of the USB interface, 0 of a device with one alone.
        vid, pid: USB vendor and product.
    """

    path: str
    serial_number: str
    interface: int
    vid: int
    pid: int

    def __str__(self) -> str:
        return (
            f"{self.path}: serial number {self.serial_number or '(none)'}, interface "
            f"{self.interface}, USB {self.vid:04x}:{self.pid:04x}"
        )


def find_ports() -> list[PortInfo]:
    """The serial ports of all USB devices, by path."""
    from serial.tools.list_ports import comports  # noqa: PLC0415

    return usb_ports(comports())


def usb_ports(listed: Iterable[Any]) -> list[PortInfo]:
    """The USB ports among what pyserial lists; others have no serial number to know them by.

    Args:
        listed: objects with ``device``, ``vid``, ``pid``, ``serial_number`` and ``location``, the
            last such as ``1-2.3:1.2`` of a device with several interfaces.
    """
    found = [
        PortInfo(
            path=str(port.device),
            serial_number=str(port.serial_number or ""),
            interface=_interface(str(port.location or "")),
            vid=int(port.vid),
            pid=int(port.pid or 0),
        )
        for port in listed
        if port.vid is not None
    ]
    return sorted(found, key=lambda port: port.path)


def vcom(serial_number: str, interface: int, ports: Iterable[PortInfo] | None = None) -> str:
    """Path of the port of a debugger.

    Args:
        serial_number: of the debugger; leading zeros do not matter.
        interface: number of the USB interface.
        ports: where to look; what is connected now by default.

    Raises:
        RigError: none, or more than one; the message lists what is there.
    """
    there = find_ports() if ports is None else list(ports)
    same = [port for port in there if _plain(port.serial_number) == _plain(serial_number)]
    chosen = [port for port in same if port.interface == interface]
    if len(chosen) == 1:
        return chosen[0].path
    listed = "\n".join(str(port) for port in there) or "no USB serial port at all"
    if chosen:
        raise RigError(
            f"{len(chosen)} ports are interface {interface} of serial number {serial_number}",
            f"unplug one of the devices with that number\nthere are:\n{listed}",
        )
    if same:
        raise RigError(
            f"the debugger {serial_number} has no serial port at interface {interface}",
            f"its interfaces: {', '.join(str(port.interface) for port in same)}\n"
            f"there are:\n{listed}",
        )
    raise RigError(
        f"no serial port of the debugger {serial_number}",
        "plug the board in and switch it on\n"
        f"enable its virtual COM port (JLinkConfigManager, or 'vcom enable')\nthere are:\n{listed}",
    )


def open_board(board: Board) -> SerialPort:
    """The serial port of a board, found again by the same board when it is unplugged.

    Raises:
        RigError: it is not there, not permitted, or in use.
    """

    def resolve() -> str:
        return vcom(board.probe, board.vcom)

    return SerialPort(resolve(), resolve=resolve)


def _interface(location: str) -> int:
    match = re.search(r":\d+\.(\d+)$", location)
    return int(match[1]) if match else 0


def _plain(serial_number: str) -> str:
    """As SEGGER's tools print it: USB pads the number with zeros."""
    return serial_number.strip().lstrip("0").upper()
