# SPDX-License-Identifier: Apache-2.0
"""A ``pynrfjprog`` that records what is asked of it.

It behaves as version 10.24.2 does: without a J-Link library ``open()`` succeeds, lists no probes
and ``find_jlink_path()`` gives the bare file name; the error comes at ``DebugProbe()``.
"""

from __future__ import annotations

import enum
import types
from typing import Any

import pytest


class APIError(Exception):
    def __init__(self, err_code: int) -> None:
        super().__init__(f"An error was reported by NRFJPROG DLL: {err_code}")
        self.err_code = err_code


class _Named(enum.IntEnum):
    @staticmethod
    def _missing_(value: object) -> None:
        return None


class EraseAction(_Named):
    ERASE_NONE = 0
    ERASE_ALL = 1
    ERASE_SECTOR = 2


class ResetAction(_Named):
    RESET_NONE = 0
    RESET_SYSTEM = 1
    RESET_PIN = 3


class VerifyAction(_Named):
    VERIFY_NONE = 0
    VERIFY_READ = 1


class ProgramOptions:
    def __init__(self, **options: int) -> None:
        self.options = options


class Rig:
    """The state behind the fake module.

    Attributes:
        library: a J-Link library is installed.
        memory: address -> bytes there.
        protection: what ``get_readback_protection`` gives.
        calls: what was asked of probes.
    """

    def __init__(self) -> None:
        self.library = True
        self.serials = [683000001, 683000002]
        self.memory: dict[int, bytes] = {}
        self.protection = 0
        self.fails: int | None = None
        self.calls: list[tuple[Any, ...]] = []
        self.open_probes = 0


def install(monkeypatch: pytest.MonkeyPatch) -> Rig:
    """Put the fake in place of ``pynrfjprog``."""
    rig = Rig()

    class API:
        def __init__(self, log: bool = True) -> None:
            self.opened = False

        def dll_version(self) -> tuple[int, int, int]:
            return 10, 24, 2

        def find_jlink_path(self) -> str:
            return "/opt/SEGGER/JLink/libjlinkarm.so" if rig.library else "libjlinkarm-none.so"

        def open(self) -> None:
            self.opened = True

        def get_connected_probes(self) -> list[int]:
            assert self.opened
            return rig.serials if rig.library else []

    class DebugProbe:
        def __init__(self, api: API, snr: int, log: bool = True) -> None:
            assert api.opened
            if not rig.library:
                raise APIError(-101)
            if rig.fails is not None:
                raise APIError(rig.fails)
            self.snr = snr
            rig.open_probes += 1

        def close(self) -> None:
            rig.open_probes -= 1

        def get_readback_protection(self) -> int:
            return rig.protection

        def read(self, address: int, data_len: int = 4) -> int | bytearray:
            data = rig.memory[address][:data_len]
            return int.from_bytes(data, "little") if data_len == 4 else bytearray(data)

        def program(self, path: str, options: ProgramOptions) -> None:
            rig.calls.append(("program", self.snr, path, options.options))

        def erase(self, action: EraseAction) -> None:
            rig.calls.append(("erase", self.snr, action.name))

        def reset(self, action: ResetAction) -> None:
            rig.calls.append(("reset", self.snr, action.name))

        def recover(self) -> None:
            rig.calls.append(("recover", self.snr))

    package = types.ModuleType("pynrfjprog")
    high = types.ModuleType("pynrfjprog.HighLevel")
    high.API, high.DebugProbe = API, DebugProbe  # type: ignore[attr-defined]
    parameters = types.ModuleType("pynrfjprog.Parameters")
    for item in (EraseAction, ResetAction, VerifyAction, ProgramOptions):
        setattr(parameters, item.__name__, item)
    package.HighLevel, package.Parameters = high, parameters  # type: ignore[attr-defined]
    for name, module in (("", package), (".HighLevel", high), (".Parameters", parameters)):
        monkeypatch.setitem(__import__("sys").modules, f"pynrfjprog{name}", module)
    return rig
