# SPDX-License-Identifier: Apache-2.0
"""An nRF52840 with flash that behaves like flash, a probe to reach it, and faults to order."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

from hil.bench.errors import ProbeLostError
from hil.bench.probes.model import Probe, Protection, Readiness, ResetKind

PAGE_B = 4096
FLASH_B = 1 << 20


@dataclass
class FakeChip:
    """Memory as a debugger sees it.

    Attributes:
        device_words: FICR DEVICEID[0] and [1].
        part: FICR INFO.PART.
        protected: APPROTECT is on: the memory cannot be reached.
        stuck: (address, bits) that cannot be programmed, as in a worn cell.
        running: the core runs; programming halts it.
    """

    device_words: tuple[int, int] = (0x89ABCDEF, 0x01234567)
    part: int = 0x52840
    protected: bool = False
    stuck: dict[int, int] = field(default_factory=dict)
    running: bool = True
    flash: bytearray = field(default_factory=lambda: bytearray(b"\xff" * FLASH_B))

    def read(self, address: int, size: int) -> bytes:
        if address + size <= FLASH_B:
            return bytes(self.flash[address : address + size])
        ficr = bytearray(b"\xff" * 0x200)
        struct.pack_into("<II", ficr, 0x60, *self.device_words)
        variant = int.from_bytes(b"AAD0", "big")
        struct.pack_into("<5I", ficr, 0x100, self.part, variant, 0x2004, 256, 1024)
        return bytes(ficr[address - 0x10000000 :][:size])

    def write_page(self, address: int, data: bytes) -> None:
        """Erase a page and program it; programming can only clear bits."""
        page = bytearray(b"\xff" * PAGE_B)
        page[: len(data)] = data
        for at, bits in self.stuck.items():
            if address <= at < address + PAGE_B:
                page[at - address] |= bits
        self.flash[address : address + PAGE_B] = page


class FakeProbe:
    """A :class:`hil.bench.probes.model.Probe` on a :class:`FakeChip`.

    Args:
        lost_at: operation -> how many bytes or calls it does before the probe is gone.
    """

    runner = "fake"

    def __init__(self, serial: str, chip: FakeChip, lost_at: dict[str, int] | None = None) -> None:
        self.serial = serial
        self.chip = chip
        self.lost_at = lost_at or {}
        self.log: list[str] = []

    def version(self) -> str:
        return "fake 1.0"

    def protection(self) -> Protection:
        self.log.append("protection")
        return Protection.ON if self.chip.protected else Protection.OFF

    def read_memory(self, address: int, size: int) -> bytes:
        self.log.append(f"read 0x{address:08x}")
        self._reach("read")
        return self.chip.read(address, size)

    def program(self, image: Path) -> None:
        from intelhex import IntelHex  # noqa: PLC0415

        self.log.append("program")
        self._reach("connect")
        self.chip.running = False
        memory = IntelHex(str(image))
        for start, end in memory.segments():
            for page in range(start - start % PAGE_B, end, PAGE_B):
                if page >= self.lost_at.get("program", FLASH_B):
                    raise ProbeLostError("the USB device is gone", "plug it in")
                first, last = max(page, start), min(page + PAGE_B, end)
                data = memory.tobinstr(start=first, end=last - 1)
                self.chip.write_page(page, b"\xff" * (first - page) + data)

    def erase(self) -> None:
        self._reach("connect")
        self.chip.flash[:] = b"\xff" * FLASH_B

    def reset(self, kind: ResetKind = "system") -> None:
        self.log.append(f"reset {kind}")
        self._reach("connect")
        self.chip.running = True

    def recover(self) -> None:
        self.log.append("recover")
        self.chip.flash[:] = b"\xff" * FLASH_B
        self.chip.protected = False

    def _reach(self, operation: str) -> None:
        if self.chip.protected:
            raise ProbeLostError("access port protection is on", "recover")
        left = self.lost_at.get(operation)
        if left == 0:
            raise ProbeLostError("the USB device is gone", "plug it in")
        if left is not None:
            self.lost_at[operation] = left - 1


class FakeRunner:
    """A :class:`hil.bench.probes.model.Runner` of some fake probes."""

    def __init__(self, *probes: FakeProbe, name: str = "fake", problem: str = "") -> None:
        self.name = name
        self._probes = {probe.serial: probe for probe in probes}
        self._problem = problem

    def readiness(self) -> Readiness:
        return Readiness(not self._problem, "fake 1.0", self._problem, "mend it")

    def serials(self) -> list[str]:
        return sorted(self._probes)

    def open(self, serial: str) -> Probe:
        return self._probes[serial]
