# SPDX-License-Identifier: Apache-2.0
"""The udev rules that let a user who is not root reach probes, their serial ports and analysers."""

from __future__ import annotations

from pathlib import Path
from typing import Final

NAME: Final = "60-hil-bench.rules"
RULES: Final = """\
# Boards and analysers of the hil bench, for whoever is logged in and for group plugdev.
# SEGGER J-Link on the DK; ModemManager must not talk to its serial ports.
SUBSYSTEM=="usb", ATTR{idVendor}=="1366", MODE="0660", GROUP="plugdev", TAG+="uaccess"
SUBSYSTEM=="usb", ATTR{idVendor}=="1366", ENV{ID_MM_DEVICE_IGNORE}="1"
SUBSYSTEM=="tty", ATTRS{idVendor}=="1366", MODE="0660", GROUP="dialout", TAG+="uaccess"
# CMSIS-DAP probes.
SUBSYSTEM=="usb", ATTR{product}=="*CMSIS-DAP*", MODE="0660", GROUP="plugdev", TAG+="uaccess"
# Analysers that sigrok drives with fx2lafw: clones of the Saleae Logic, bare FX2, sigrok's own.
SUBSYSTEM=="usb", ATTR{idVendor}=="0925", ATTR{idProduct}=="3881", MODE="0660", GROUP="plugdev", \
TAG+="uaccess"
SUBSYSTEM=="usb", ATTR{idVendor}=="04b4", ATTR{idProduct}=="8613", MODE="0660", GROUP="plugdev", \
TAG+="uaccess"
SUBSYSTEM=="usb", ATTR{idVendor}=="1d50", ATTR{idProduct}=="608c", MODE="0660", GROUP="plugdev", \
TAG+="uaccess"
# Saleae's own analysers.
SUBSYSTEM=="usb", ATTR{idVendor}=="21a9", MODE="0660", GROUP="plugdev", TAG+="uaccess"
"""


def install_commands(path: Path) -> list[str]:
    """What a person types to put the rules in force."""
    return [
        f"sudo cp {path} /etc/udev/rules.d/{NAME}",
        "sudo udevadm control --reload-rules && sudo udevadm trigger",
        "sudo usermod -aG plugdev,dialout $USER   (then log out and in)",
    ]
