# SPDX-License-Identifier: Apache-2.0
"""Nordic's ``nrfutil device``.

Syntax and option values: Nordic's documentation of nRF Util, pages "device program", "Programming
options", "device read", "device reset". The ``nrfutil`` on PyPI is an older, different tool.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from hil.bench.errors import ProbeLostError
from hil.bench.inventory import normal_serial
from hil.bench.probes import tool
from hil.bench.probes.model import Protection, Readiness, ResetKind
from hil.process import scratch

PROGRAM: Final = "nrfutil"
MEND_INSTALL: Final = (
    "download nrfutil from nordicsemi.com (nRF Util), put it on PATH, then: nrfutil install device"
)
_RESETS: Final = {"system": "RESET_SYSTEM", "pin": "RESET_PIN"}
_OPTIONS: Final = (
    "chip_erase_mode=ERASE_RANGES_TOUCHED_BY_FIRMWARE,verify=VERIFY_NONE,reset=RESET_NONE"
)


class NrfutilRunner:
    """See :class:`hil.bench.probes.model.Runner`."""

    name = "nrfutil"

    def readiness(self) -> Readiness:
        if not tool.installed(PROGRAM):
            return Readiness(False, "", "nrfutil is not installed", MEND_INSTALL)
        try:
            said = tool.ask(
                [PROGRAM, "device", "--version"], name=PROGRAM, timeout_s=tool.READY_S, check=False
            )
        except ProbeLostError as error:
            return Readiness(False, "", error.message.splitlines()[0], MEND_INSTALL)
        if said.status == 0:
            version = next((line.strip() for line in said.lines if line.strip()), PROGRAM)
            return Readiness(True, version)
        if "no such command" in said.text.lower():
            return Readiness(
                False,
                "",
                "this nrfutil is PyPI's, another tool of the same name without 'device'",
                f"pip uninstall nrfutil\n{MEND_INSTALL}",
            )
        return Readiness(False, "", "nrfutil has no 'device' command yet", "nrfutil install device")

    def serials(self) -> list[str]:
        data = _json(["device", "list"], tool.QUICK_S)
        found = [
            device.get("serialNumber")
            for device in _list(data, "devices")
            if device.get("traits", {}).get("jlink")
        ]
        return sorted(normal_serial(serial) for serial in found if serial)

    def open(self, serial: str) -> NrfutilProbe:
        return NrfutilProbe(serial)


class NrfutilProbe:
    """See :class:`hil.bench.probes.model.Probe`."""

    runner = "nrfutil"

    def __init__(self, serial: str) -> None:
        self.serial = serial

    def version(self) -> str:
        return tool.first_line([PROGRAM, "device", "--version"])

    def protection(self) -> Protection:
        data = self._device(["protection-get"], tool.QUICK_S)
        status = next((d["protectionStatus"] for d in data if "protectionStatus" in d), "")
        if status.endswith("_NONE"):
            return Protection.OFF
        if status:
            return Protection.ON
        raise ProbeLostError(
            f"nrfutil did not say whether {self.serial} is protected", tool.MEND_LOST
        )

    def read_memory(self, address: int, size: int) -> bytes:
        from intelhex import IntelHex, IntelHexError  # noqa: PLC0415 (only with hardware)

        with scratch("probe") as folder:
            path = folder / "memory.hex"
            where = ("--address", f"0x{address:08x}", "--bytes", str(size))
            self._device(["read", *where, "--to-file", str(path)], tool.READ_S)
            try:
                memory = IntelHex(str(path))
                data: bytes = memory.gets(address, size)
            except (OSError, IntelHexError) as error:
                raise ProbeLostError(
                    f"nrfutil read no {size} bytes at 0x{address:08x}: {error}", tool.MEND_LOST
                ) from error
            return data

    def program(self, image: Path) -> None:
        self._device(["program", "--firmware", str(image), "--options", _OPTIONS], tool.WRITE_S)

    def erase(self) -> None:
        self._device(["erase", "--all"], tool.WRITE_S)

    def reset(self, kind: ResetKind = "system") -> None:
        self._device(["reset", "--reset-kind", _RESETS[kind]], tool.QUICK_S)

    def recover(self) -> None:
        self._device(["recover"], tool.WRITE_S)

    def _device(self, command: list[str], timeout_s: float) -> list[dict[str, Any]]:
        data = _json(["device", *command, "--serial-number", self.serial], timeout_s)
        return _list(data, "devices")


def _json(command: list[str], timeout_s: float) -> Any:
    """What ``nrfutil`` answers; with --skip-overhead that is one JSON document."""
    argv = [PROGRAM, "--json", "--skip-overhead", *command]
    finished = tool.ask(argv, name=f"nrfutil {command[1]}", timeout_s=timeout_s)
    for text in (finished.text, *reversed(finished.lines)):
        try:
            return json.loads(text) if text.strip() else {}
        except (ValueError, RecursionError):
            continue
    raise ProbeLostError(
        f"nrfutil {command[1]} answered no JSON:\n    " + "\n    ".join(finished.lines[-10:]),
        "update it: nrfutil self-upgrade && nrfutil install device --force",
    )


def _list(data: Any, key: str) -> list[dict[str, Any]]:
    rows = data.get(key, []) if isinstance(data, dict) else []
    return [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
