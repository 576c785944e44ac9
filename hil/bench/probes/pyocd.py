# SPDX-License-Identifier: Apache-2.0
"""pyOCD. Its defaults would undo what the rig relies on, so three are always switched off:

- it waits for ever for a probe that is not there: ``--no-wait``;
- it erases a protected chip when it connects: ``auto_unlock=false``;
- it lets the core run when it disconnects: ``resume_on_disconnect=false``.

J-Links are driven through SEGGER's library; without it pyOCD lists none. Options: pyOCD's
documentation, "Session options" and "Command line".
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final

from hil.bench.errors import ProbeLostError
from hil.bench.inventory import normal_serial
from hil.bench.probes import tool
from hil.bench.probes.model import Protection, Readiness, ResetKind
from hil.process import Finished, scratch

PROGRAM: Final = "pyocd"
MEND_INSTALL: Final = "pip install pyocd"
_RESETS: Final = {"system": "sysresetreq", "pin": "hw"}
_STATUS: Final = re.compile(r"AP register 0x100000c = (0x[0-9a-f]{8})")


class PyocdRunner:
    """See :class:`hil.bench.probes.model.Runner`."""

    name = "pyocd"

    def readiness(self) -> Readiness:
        if not tool.installed(PROGRAM):
            return Readiness(False, "", "pyocd is not installed", MEND_INSTALL)
        version = tool.first_line([PROGRAM, "--version"])
        if not re.fullmatch(r"\d+\.\S+", version):
            return Readiness(False, "", f"pyocd does not start: {version}", MEND_INSTALL)
        return Readiness(True, f"pyocd {version}")

    def serials(self) -> list[str]:
        finished = tool.ask(
            [PROGRAM, "json", "--probes", "--no-config"],
            name="pyocd json",
            timeout_s=tool.QUICK_S,
            mend=MEND_INSTALL,
        )
        try:
            boards = json.loads(finished.text)["boards"]
            return sorted(normal_serial(board["unique_id"]) for board in boards)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise ProbeLostError(
                f"pyocd answered no list of probes:\n    {finished.text[:400]}", MEND_INSTALL
            ) from error

    def open(self, serial: str) -> PyocdProbe:
        return PyocdProbe(serial)


class PyocdProbe:
    """See :class:`hil.bench.probes.model.Probe`."""

    runner = "pyocd"

    def __init__(self, serial: str) -> None:
        self.serial = serial

    def version(self) -> str:
        return f"pyocd {tool.first_line([PROGRAM, '--version'])}"

    def protection(self) -> Protection:
        finished = self._commander(["--no-init"], ["initdp", "readap 1 0x0c"], tool.QUICK_S)
        status = _STATUS.search(finished.text)
        if status is None:
            raise ProbeLostError(
                f"pyocd did not say whether {self.serial} is protected", tool.MEND_LOST
            )
        return Protection.OFF if int(status[1], 16) & 1 else Protection.ON

    def read_memory(self, address: int, size: int) -> bytes:
        with scratch("probe") as folder:
            path = folder / "memory.bin"
            command = f"savemem 0x{address:08x} {size} {path}"
            self._commander(["--connect", "attach"], [command], tool.READ_S)
            return tool.dump(path, size, PROGRAM)

    def program(self, image: Path) -> None:
        options = ["--connect", "halt", "--no-reset", "--erase", "sector", "--format", "hex"]
        self._run("load", [*options, str(image)], tool.WRITE_S)

    def erase(self) -> None:
        self._run("erase", ["--chip"], tool.WRITE_S)

    def reset(self, kind: ResetKind = "system") -> None:
        self._run("reset", ["--method", _RESETS[kind]], tool.QUICK_S)

    def recover(self) -> None:
        """A mass erase through CTRL-AP. Connecting once more writes UICR.APPROTECT, which the
        erasing has cleared, so that the port stays open."""
        self._run("erase", ["--mass"], tool.WRITE_S, unlock=True)
        self._run("commander", ["--command", "status"], tool.QUICK_S, unlock=True)

    def _commander(self, options: list[str], commands: list[str], timeout_s: float) -> Finished:
        for command in commands:
            options = [*options, "--command", command]
        return self._run("commander", options, timeout_s)

    def _run(
        self, command: str, arguments: list[str], timeout_s: float, *, unlock: bool = False
    ) -> Finished:
        argv = [PROGRAM, command, "--no-wait", "--no-config"]
        argv += ["--uid", self.serial, "--target", "nrf52840"]
        argv += ["-O", f"auto_unlock={str(unlock).lower()}", "-O", "resume_on_disconnect=false"]
        return tool.ask([*argv, *arguments], name=f"pyocd {command}", timeout_s=timeout_s)
