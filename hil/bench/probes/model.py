# SPDX-License-Identifier: Apache-2.0
"""What every debug probe can do, whichever program drives it."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

ResetKind = Literal["system", "pin"]
"""``system``: SYSRESETREQ of the core; ``pin``: the nRESET line."""


class Protection(enum.Enum):
    """CTRL-AP APPROTECTSTATUS (nRF52840 PS v1.7, section 4.8.2.1)."""

    OFF = "off"
    ON = "on"


class Probe(Protocol):
    """One probe and the chip behind it.

    The order matters to the chip: :meth:`protection` talks to the control access port only and is
    safe on a protected chip; all else may fail there, and with some programs erases it.

    Every method raises :class:`hil.bench.errors.ProbeLostError` with the program's own last words.
    """

    runner: str
    serial: str

    def version(self) -> str:
        """Of the program that drives the probe."""

    def protection(self) -> Protection:
        """Whether the debugger is shut out; changes nothing."""

    def read_memory(self, address: int, size: int) -> bytes:
        """``size`` bytes at ``address``; the core is left as it is, running or halted."""

    def program(self, image: Path) -> None:
        """Write a hex file, erasing just the pages that it touches.

        The core is left halted: nothing of what was written runs before :meth:`reset`.
        """

    def erase(self) -> None:
        """Erase all flash and UICR, calibration included.

        With UICR.APPROTECT erased, a chip of revision 3 is closed after its next reset;
        :meth:`recover` erases as much and keeps it open.
        """

    def reset(self, kind: ResetKind = "system") -> None:
        """Start the firmware anew."""

    def recover(self) -> None:
        """Erase the chip through CTRL-AP, which ends its protection, and keep it open."""


@dataclass(frozen=True)
class Readiness:
    """Whether a runner can be used here.

    Attributes:
        ready: it can.
        version: what it says of itself; empty when it is not there.
        problem: why it cannot.
        mend: what to do about that.
    """

    ready: bool
    version: str = ""
    problem: str = ""
    mend: str = ""


class Runner(Protocol):
    """One program that drives probes."""

    name: str

    def readiness(self) -> Readiness:
        """Whether it can be used on this machine; never raises."""

    def serials(self) -> list[str]:
        """Serial numbers of the connected probes, without leading zeros.

        Raises:
            ProbeLostError: the program failed.
        """

    def open(self, serial: str) -> Probe:
        """The probe with this serial number."""
