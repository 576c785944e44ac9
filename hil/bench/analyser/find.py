# SPDX-License-Identifier: Apache-2.0
"""Which analysers are there, as sigrok lists them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from hil.errors import RigError
from hil.process import run

PROGRAM = "sigrok-cli"
SCAN_LIMIT_S = 30.0
INSTALL = "apt-get install sigrok-cli sigrok-firmware-fx2lafw"

LINE = re.compile(
    r"(?P<driver>[\w-]+)(?::conn=(?P<conn>\S+))? - (?P<description>.*?)"
    r" with \d+ channels?: (?P<channels>.+)"
)


@dataclass(frozen=True)
class SigrokDevice:
    """One analyser of sigrok's.

    Attributes:
        driver: such as ``fx2lafw``.
        conn: where it is connected, ``bus.address`` for USB; empty when sigrok does not say.
        description: vendor, model and serial number, as sigrok writes them.
        channels: names in the order of the device, which is the order of the bits.
    """

    driver: str
    conn: str
    description: str
    channels: tuple[str, ...]

    @property
    def spec(self) -> str:
        """What ``--driver`` takes."""
        return f"{self.driver}:conn={self.conn}" if self.conn else self.driver


def scan_argv(driver: str) -> list[str]:
    return [PROGRAM, "--driver", driver, "--scan"]


def parse_scan(lines: Iterable[str]) -> list[SigrokDevice]:
    """The devices in what ``sigrok-cli --scan`` prints; other lines are passed over."""
    found = []
    for line in lines:
        match = LINE.fullmatch(line.strip())
        if match:
            channels = tuple(match["channels"].split())
            found.append(
                SigrokDevice(match["driver"], match["conn"] or "", match["description"], channels)
            )
    return found


def find_sigrok(driver: str = "fx2lafw", *, conn: str = "") -> SigrokDevice:
    """The one analyser of ``driver``; loads its firmware when it has none.

    Args:
        driver: may hold options of the driver, as ``--driver`` takes them.
        conn: which, when there are several.

    Raises:
        RigError: none or several, or sigrok-cli is not there.
    """
    found = run(
        scan_argv(driver), name="the scan for analysers", timeout_s=SCAN_LIMIT_S, mend=INSTALL
    )
    devices = parse_scan(found.lines)
    chosen = [device for device in devices if not conn or device.conn == conn]
    if len(chosen) == 1:
        return chosen[0]
    listed = "; ".join(f"{d.spec} ({d.description})" for d in devices) or "none"
    if not chosen:
        raise RigError(
            f"no analyser of driver '{driver}'"
            + (f" at {conn}" if conn else "")
            + f"; found: {listed}",
            "plug it in; lsusb shows it\n"
            "give your user the right: udev rules 60-libsigrok.rules, group plugdev\n"
            "apt-get install sigrok-firmware-fx2lafw, for analysers of the FX2 kind",
        )
    raise RigError(
        f"{len(chosen)} analysers of driver '{driver}': {listed}", "say which one with conn="
    )
