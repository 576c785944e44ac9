# SPDX-License-Identifier: Apache-2.0
"""SEGGER's J-Link Commander, ``JLinkExe``, with a command file.

Commands and options: SEGGER knowledge base, "J-Link Commander". The commander may offer to erase a
protected chip when it connects to the core, so the protection is read without connecting: through
the debug port alone (ARM ADIv5; CTRL-AP is access port 1, nRF52840 PS v1.7, section 4.8).
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hil.bench.errors import ProbeLostError
from hil.bench.inventory import normal_serial
from hil.bench.probes import tool
from hil.bench.probes.model import Protection, Readiness, ResetKind
from hil.process import Finished, scratch

PROGRAM: Final = "JLinkExe"
MEND_INSTALL: Final = "install SEGGER's J-Link software (segger.com/downloads/jlink)"
_CONNECT: Final = ("-Device", "nRF52840_xxAA", "-If", "SWD", "-Speed", "4000", "-AutoConnect", "1")
_WIRES: Final = ("-If", "SWD", "-Speed", "4000")
_PROTECTION: Final = (
    "SWDSelect",
    "SWDWriteDP 1 0x50000000",  # CTRL/STAT: power up debug and system
    "SWDWriteDP 2 0x01000000",  # SELECT: access port 1, bank 0
    "SWDReadAP 3",  # offset 0x0C, APPROTECTSTATUS; the value comes with the next read
    "SWDReadDP 3",  # RDBUFF
)
_READ_BUFFER: Final = re.compile(r"Read DP register 3 = (0x[0-9A-Fa-f]{1,8})")
_LISTED: Final = re.compile(r"J-Link\[\d+\]: .*Serial number: (\d+)")
_FAILED: Final = ("Cannot connect", "Could not", "Failed to", "****** Error", "FAILED")


class JlinkRunner:
    """See :class:`hil.bench.probes.model.Runner`."""

    name = "jlink"

    def readiness(self) -> Readiness:
        if not tool.installed(PROGRAM):
            return Readiness(False, "", "JLinkExe is not installed", MEND_INSTALL)
        try:
            version = _version()
        except ProbeLostError as error:
            return Readiness(False, "", error.message.splitlines()[0], MEND_INSTALL)
        if not version:
            return Readiness(False, "", "JLinkExe does not say which version it is", MEND_INSTALL)
        return Readiness(True, version)

    def serials(self) -> list[str]:
        finished = _commander((), ["ShowEmuList"], tool.QUICK_S, check=False)
        return sorted({normal_serial(n) for n in _LISTED.findall(finished.text)})

    def open(self, serial: str) -> JlinkProbe:
        return JlinkProbe(serial)


class JlinkProbe:
    """See :class:`hil.bench.probes.model.Probe`."""

    runner = "jlink"

    def __init__(self, serial: str) -> None:
        self.serial = serial

    def version(self) -> str:
        return _version()

    def protection(self) -> Protection:
        finished = self._run(_WIRES, _PROTECTION, tool.QUICK_S)
        status = _READ_BUFFER.search(finished.text)
        if status is None:
            raise ProbeLostError(
                f"JLinkExe did not say whether {self.serial} is protected", tool.MEND_LOST
            )
        return Protection.OFF if int(status[1], 16) & 1 else Protection.ON

    def read_memory(self, address: int, size: int) -> bytes:
        with scratch("probe") as folder:
            path = folder / "memory.bin"
            self._run(_CONNECT, [f'SaveBin "{path}", 0x{address:08x}, 0x{size:x}'], tool.READ_S)
            return tool.dump(path, size, "JLinkExe")

    def program(self, image: Path) -> None:
        with scratch("probe") as folder:
            # A name of our own: the command file has no way to quote every path.
            copy = shutil.copyfile(image, folder / "image.hex")
            self._run(_CONNECT, ["r", "h", f'LoadFile "{copy}"'], tool.WRITE_S)

    def erase(self) -> None:
        self._run(_CONNECT, ["r", "h", "erase"], tool.WRITE_S)

    def reset(self, kind: ResetKind = "system") -> None:
        kinds = {"system": "RSetType 0", "pin": "RSetType 2"}
        self._run(_CONNECT, [kinds[kind], "r", "g"], tool.QUICK_S)

    def recover(self) -> None:
        """ERASEALL through CTRL-AP, then UICR.APPROTECT = HwDisabled as the NVMC writes it."""
        self._run(
            _WIRES,
            [
                *_PROTECTION[:3],
                "SWDWriteAP 1 0x00000001",  # ERASEALL
                "Sleep 1000",
                "SWDWriteAP 0 0x00000001",  # RESET
                "SWDWriteAP 0 0x00000000",
                "SWDWriteAP 1 0x00000000",
            ],
            tool.WRITE_S,
        )
        self._run(
            _CONNECT,
            ["h", "w4 0x4001E504 1", "w4 0x10001208 0x0000005A", "w4 0x4001E504 0"],
            tool.QUICK_S,
        )

    def _run(self, options: Sequence[str], commands: Sequence[str], timeout_s: float) -> Finished:
        finished = _commander(("-USB", self.serial, *options), commands, timeout_s)
        # The commander's exit status is 0 for most failures; its words are not.
        if any(word in line for line in finished.lines for word in _FAILED):
            raise ProbeLostError(
                f"JLinkExe failed at probe {self.serial}; its last words:\n"
                + "\n".join(f"    {line}" for line in finished.lines[-12:] if line.strip()),
                tool.MEND_LOST,
            )
        return finished


def _commander(
    options: Sequence[str], commands: Sequence[str], timeout_s: float, *, check: bool = True
) -> Finished:
    with scratch("probe") as folder:
        script = folder / "commands.jlink"
        script.write_text("\n".join((*commands, "Exit", "")), encoding="utf-8")
        fixed = (PROGRAM, "-NoGui", "1", "-ExitOnError", "1")
        argv = (*fixed, *options, "-CommandFile", str(script))
        return tool.ask(argv, name=PROGRAM, timeout_s=timeout_s, check=check)


def _version() -> str:
    """From its greeting; without a probe it then fails, which says nothing about the program."""
    finished = _commander((), [], tool.READY_S, check=False)
    found = re.search(r"J-Link Commander V\S+", finished.text)
    return found[0] if found else ""
