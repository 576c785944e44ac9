# SPDX-License-Identifier: Apache-2.0
"""OpenOCD: needs no vendor's library, and drives CMSIS-DAP probes as well as J-Links.

Commands: OpenOCD User's Guide, "General Commands", "Flash Commands"; ``target/nrf52.cfg`` brings
``nrf52_recover``.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Final

from hil.bench.errors import ProbeLostError
from hil.bench.probes import tool, usb
from hil.bench.probes.model import Protection, Readiness, ResetKind
from hil.process import Finished, scratch

PROGRAM: Final = "openocd"
MEND_INSTALL: Final = "apt-get install openocd"
# Two boards at a time: the servers of the second one would find their ports taken.
_QUIET: Final = ("gdb_port disabled", "tcl_port disabled", "telnet_port disabled")
_STATUS: Final = re.compile(r"approtectstatus (0x[0-9a-fA-F]+|\d+)")
_RESETS: Final = {"system": (), "pin": ("reset_config srst_only",)}


class OpenocdRunner:
    """See :class:`hil.bench.probes.model.Runner`."""

    name = "openocd"

    def readiness(self) -> Readiness:
        if not tool.installed(PROGRAM):
            return Readiness(False, "", "openocd is not installed", MEND_INSTALL)
        version = tool.first_line([PROGRAM, "--version"])
        if not version.startswith("Open On-Chip Debugger"):
            return Readiness(False, "", f"openocd does not start: {version}", MEND_INSTALL)
        return Readiness(True, version)

    def serials(self) -> list[str]:
        """From USB: OpenOCD cannot list probes."""
        return [probe.serial for probe in usb.find_probes()]

    def open(self, serial: str) -> OpenocdProbe:
        return OpenocdProbe(serial)


class OpenocdProbe:
    """See :class:`hil.bench.probes.model.Probe`."""

    runner = "openocd"

    def __init__(self, serial: str) -> None:
        self.serial = serial

    def version(self) -> str:
        return tool.first_line([PROGRAM, "--version"])

    def protection(self) -> Protection:
        finished = self._run(
            ["init", 'echo "approtectstatus [nrf52.dap apreg 1 0x0c]"'], tool.QUICK_S
        )
        status = _STATUS.search(finished.text)
        if status is None:
            raise ProbeLostError(
                f"openocd did not say whether {self.serial} is protected", tool.MEND_LOST
            )
        return Protection.OFF if int(status[1], 0) & 1 else Protection.ON

    def read_memory(self, address: int, size: int) -> bytes:
        with scratch("probe") as folder:
            path = folder / "memory.bin"
            self._run(["init", f"dump_image {path} 0x{address:08x} {size}"], tool.READ_S)
            return tool.dump(path, size, PROGRAM)

    def program(self, image: Path) -> None:
        with scratch("probe") as folder:
            # A name of our own: Tcl has no way to quote every path.
            copy = shutil.copyfile(image, folder / "image.hex")
            self._run(
                ["init", "reset halt", f"flash write_image erase {copy} 0 ihex"], tool.WRITE_S
            )

    def erase(self) -> None:
        self._run(["init", "reset halt", "nrf5 mass_erase"], tool.WRITE_S)

    def reset(self, kind: ResetKind = "system") -> None:
        self._run([*_RESETS[kind], "init", "reset run"], tool.QUICK_S)

    def recover(self) -> None:
        """ERASEALL through CTRL-AP, then UICR.APPROTECT = HwDisabled as the NVMC writes it."""
        self._run(
            [
                *("init", "nrf52_recover", "halt"),
                *("mww 0x4001e504 1", "mww 0x10001208 0x0000005a", "mww 0x4001e504 0"),
            ],
            tool.WRITE_S,
        )

    def _run(self, commands: list[str], timeout_s: float) -> Finished:
        adapter = "jlink" if self.serial.isdigit() else "cmsis-dap"
        argv = [PROGRAM, "-f", f"interface/{adapter}.cfg"]
        for command in ("transport select swd", f"adapter serial {self.serial}"):
            argv += ["-c", command]
        argv += ["-f", "target/nrf52.cfg"]
        for command in (*_QUIET, *commands, "shutdown"):
            argv += ["-c", command]
        return tool.ask(argv, name=PROGRAM, timeout_s=timeout_s)
