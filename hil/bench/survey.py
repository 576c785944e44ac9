# SPDX-License-Identifier: Apache-2.0
"""What is plugged in: probes, serial ports, analysers."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from hil.bench.inventory import Board, normal_serial
from hil.bench.probes import usb
from hil.bench.probes.usb import UsbProbe
from hil.process import capture

if TYPE_CHECKING:
    from hil.bench.analyser.find import SigrokDevice
    from hil.bench.ports import PortInfo

SCAN_LIMIT_S: Final = 6.0
SCANNED: Final = ("fx2lafw", "saleae-logic16", "dreamsourcelab-dslogic", "kingst-la2016")
"""Drivers of USB logic analysers; a scan of all of sigrok's would also poke at serial ports."""


@dataclass(frozen=True)
class Survey:
    """What was found.

    Attributes:
        probes: debug probes on USB.
        ports: serial ports.
        analysers: logic analysers that sigrok can drive.
    """

    probes: tuple[UsbProbe, ...] = ()
    ports: tuple[PortInfo, ...] = ()
    analysers: tuple[SigrokDevice, ...] = ()

    def first_vcom(self, serial: str) -> int:
        """The lowest USB interface number of a probe's serial ports; 0 when it has none."""
        ports = (p for p in self.ports if normal_serial(p.serial_number or "") == serial)
        return min((port.interface for port in ports), default=0)

    def port(self, board: Board) -> PortInfo | None:
        """The serial port that a board's firmware speaks on."""
        for port in self.ports:
            same = normal_serial(port.serial_number or "") == board.probe
            if same and port.interface == board.vcom:
                return port
        return None


def look() -> Survey:
    """Look for everything; takes a second where sigrok has to scan."""
    from hil.bench.ports import find_ports  # noqa: PLC0415 (hardware library)

    with ThreadPoolExecutor(len(SCANNED)) as pool:
        scans = pool.map(_scan, SCANNED)
        analysers = tuple(device for devices in scans for device in devices)
        return Survey(tuple(usb.find_probes()), tuple(find_ports()), analysers)


def _scan(driver: str) -> list[SigrokDevice]:
    """The devices of one driver; none when sigrok-cli is not installed or knows no such driver."""
    from hil.bench.analyser.find import parse_scan, scan_argv  # noqa: PLC0415 (start-up time)

    return parse_scan(capture(scan_argv(driver), timeout_s=SCAN_LIMIT_S).splitlines())
