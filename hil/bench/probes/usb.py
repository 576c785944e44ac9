# SPDX-License-Identifier: Apache-2.0
"""Debug probes as Linux sees them on USB: no probe's program is needed to know what is plugged in.

Attributes of ``/sys/bus/usb/devices``: Linux documentation, ABI/stable/sysfs-bus-usb.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hil.bench.inventory import normal_serial

SYSFS: Final = Path("/sys/bus/usb/devices")
DEVICES: Final = Path("/dev/bus/usb")
SEGGER_VID: Final = "1366"


@dataclass(frozen=True)
class UsbProbe:
    """A probe on USB.

    Attributes:
        serial: without leading zeros.
        product: as the device calls itself.
        device: its file, which a probe's program must be able to write.
    """

    serial: str
    product: str
    device: Path

    @property
    def writable(self) -> bool:
        return os.access(self.device, os.R_OK | os.W_OK)


def find_probes(sysfs: Path = SYSFS, devices: Path = DEVICES) -> list[UsbProbe]:
    """Every J-Link and every CMSIS-DAP probe that is plugged in, by serial number."""
    found = []
    for folder in sorted(sysfs.glob("*")):
        product = _attribute(folder, "product")
        is_probe = _attribute(folder, "idVendor") == SEGGER_VID or "CMSIS-DAP" in product
        serial = _attribute(folder, "serial")
        if is_probe and serial:
            bus, number = _attribute(folder, "busnum"), _attribute(folder, "devnum")
            device = devices / bus.zfill(3) / number.zfill(3)
            found.append(UsbProbe(normal_serial(serial), product, device))
    return sorted(found, key=lambda probe: probe.serial)


def _attribute(folder: Path, name: str) -> str:
    try:
        return (folder / name).read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
