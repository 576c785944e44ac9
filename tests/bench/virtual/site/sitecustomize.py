# SPDX-License-Identifier: Apache-2.0
"""What a virtual bench plugs into USB: Python reads this file at start-up, found on PYTHONPATH.

Only the two places where the kernel would be asked are replaced: sysfs, by a folder of the same
form, and the list of serial ports. All else runs as it is.
"""

import json
import os
import types
from pathlib import Path

FOLDER = os.environ.get("HIL_VIRTUAL_BENCH")


def comports() -> list[types.SimpleNamespace]:
    listed = json.loads((Path(FOLDER or "") / "ports.json").read_text())
    return [types.SimpleNamespace(**port) for port in listed]


def plug_in() -> None:
    import serial.tools.list_ports  # noqa: PLC0415

    from hil.bench.probes import usb  # noqa: PLC0415

    serial.tools.list_ports.comports = comports
    folder = Path(FOLDER or "")
    usb.find_probes.__defaults__ = (folder / "sys", folder / "dev")


if FOLDER:
    plug_in()
