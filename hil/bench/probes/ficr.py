# SPDX-License-Identifier: Apache-2.0
"""What the chip says of itself: FICR, the factory information registers.

nRF52840 PS v1.7, section 4.4: DEVICEID at 0x10000060, INFO from 0x10000100.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from hil.bench.probes.model import Probe

DEVICEID_ADDRESS: Final = 0x10000060
INFO_ADDRESS: Final = 0x10000100
PART_NRF52840: Final = 0x52840


@dataclass(frozen=True)
class ChipInfo:
    """A chip.

    Attributes:
        device_id: 64 bits, as the firmware says them in HELLO: DEVICEID[1] above DEVICEID[0].
        part: e.g. 0x52840.
        variant: package, revision and build code, e.g. ``AAD0``.
        ram_kib: RAM.
        flash_kib: flash.
    """

    device_id: int
    part: int
    variant: str
    ram_kib: int
    flash_kib: int

    @property
    def name(self) -> str:
        return f"nRF{self.part:x} {self.variant}".strip()


def read_chip(probe: Probe) -> ChipInfo:
    """Read a chip's identity; it must not be protected.

    Raises:
        ProbeLostError: it cannot be read.
    """
    (device_id,) = struct.unpack("<Q", probe.read_memory(DEVICEID_ADDRESS, 8))
    part, variant, _package, ram, flash = struct.unpack("<5I", probe.read_memory(INFO_ADDRESS, 20))
    letters = struct.pack(">I", variant)
    text = letters.decode("ascii") if letters.isalnum() else ""
    return ChipInfo(device_id, part, text, ram, flash)
