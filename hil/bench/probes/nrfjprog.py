# SPDX-License-Identifier: Apache-2.0
"""Nordic's ``pynrfjprog`` (archived upstream, still the quickest way to a J-Link from Python).

It needs SEGGER's J-Link library. Without it ``HighLevel.API().open()`` succeeds and lists no
probes; only opening a probe fails, with -100 or -101. So the library is looked for first.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from hil.bench.errors import ProbeLostError
from hil.bench.inventory import normal_serial
from hil.bench.probes import tool
from hil.bench.probes.model import Protection, Readiness, ResetKind

Result = TypeVar("Result")

MEND_MODULE: Final = "pip install pynrfjprog"
MEND_LIBRARY: Final = (
    "install SEGGER's J-Link software (segger.com/downloads/jlink), which brings libjlinkarm.so\n"
    "or use a runner that does not need it: openocd"
)
JLINK_LIBRARY_ERRORS: Final = (-100, -101)
"""NrfjprogdllErr: JLINKARM_DLL_NOT_FOUND, JLINKARM_DLL_COULD_NOT_BE_OPENED."""


class NrfjprogRunner:
    """See :class:`hil.bench.probes.model.Runner`. The library is opened once and kept."""

    name = "nrfjprog"

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._api: Any = None

    def readiness(self) -> Readiness:
        try:
            from pynrfjprog import HighLevel  # noqa: PLC0415 (hardware library)
        except Exception as error:
            if isinstance(error, ModuleNotFoundError):
                return Readiness(False, "", "pynrfjprog is not installed", MEND_MODULE)
            return Readiness(False, "", f"pynrfjprog does not load: {error}", MEND_MODULE)
        try:
            api = HighLevel.API(log=False)
            version = "pynrfjprog " + ".".join(map(str, api.dll_version()))
        except Exception as error:
            return Readiness(False, "", f"pynrfjprog does not load: {error}", MEND_MODULE)
        missing = "pynrfjprog finds no J-Link library (libjlinkarm.so)"
        try:
            found = api.find_jlink_path()
        except Exception:
            return Readiness(False, version, missing, MEND_LIBRARY)
        # Where nothing is installed it answers with the bare name, for dlopen to try.
        if not Path(found).is_absolute() and not _loads(found):
            return Readiness(False, version, missing, MEND_LIBRARY)
        return Readiness(True, version)

    def serials(self) -> list[str]:
        probes = _call("listing probes", self.api().get_connected_probes)
        return sorted(normal_serial(serial) for serial in probes)

    def open(self, serial: str) -> NrfjprogProbe:
        return NrfjprogProbe(self, serial)

    def api(self) -> Any:
        """The opened library; two boards are worked on in two threads."""
        with self._lock:
            if self._api is None:
                from pynrfjprog import HighLevel  # noqa: PLC0415 (hardware library)

                api = _call("opening the library", lambda: HighLevel.API(log=False))
                _call("opening the library", api.open)
                self._api = api
            return self._api


class NrfjprogProbe:
    """See :class:`hil.bench.probes.model.Probe`."""

    runner = "nrfjprog"

    def __init__(self, runner: NrfjprogRunner, serial: str) -> None:
        self._runner = runner
        self.serial = serial

    def version(self) -> str:
        return "pynrfjprog " + ".".join(map(str, self._runner.api().dll_version()))

    def protection(self) -> Protection:
        status = self._do("reading the protection", lambda p: p.get_readback_protection())
        return Protection.OFF if int(status) == 0 else Protection.ON

    def read_memory(self, address: int, size: int) -> bytes:
        data = self._do("reading memory", lambda p: p.read(address, size))
        # Four bytes come as one number, all else as bytes.
        return data.to_bytes(4, "little") if isinstance(data, int) else bytes(data)

    def program(self, image: Path) -> None:
        from pynrfjprog import Parameters  # noqa: PLC0415 (hardware library)

        options = Parameters.ProgramOptions(
            verify=Parameters.VerifyAction.VERIFY_NONE,
            erase_action=Parameters.EraseAction.ERASE_SECTOR,
            qspi_erase_action=Parameters.EraseAction.ERASE_NONE,
            reset=Parameters.ResetAction.RESET_NONE,
        )
        self._do("programming", lambda p: p.program(str(image), options))

    def erase(self) -> None:
        from pynrfjprog import Parameters  # noqa: PLC0415 (hardware library)

        self._do("erasing", lambda p: p.erase(Parameters.EraseAction.ERASE_ALL))

    def reset(self, kind: ResetKind = "system") -> None:
        from pynrfjprog import Parameters  # noqa: PLC0415 (hardware library)

        action = getattr(Parameters.ResetAction, f"RESET_{kind.upper()}")
        self._do("resetting", lambda p: p.reset(action))

    def recover(self) -> None:
        self._do("recovering", lambda p: p.recover())

    def _do(self, what: str, use: Callable[[Any], Result]) -> Result:
        from pynrfjprog import HighLevel  # noqa: PLC0415 (hardware library)

        api = self._runner.api()
        what = f"{what} at probe {self.serial}"
        probe = _call(what, lambda: HighLevel.DebugProbe(api, int(self.serial), log=False))
        try:
            return _call(what, lambda: use(probe))
        finally:
            probe.close()


def _call(what: str, use: Callable[[], Result]) -> Result:
    """Run one call of the library; whatever it throws becomes one kind of error."""
    try:
        return use()
    except Exception as error:
        code = getattr(error, "err_code", None)
        if code in JLINK_LIBRARY_ERRORS:
            raise ProbeLostError(
                f"{what}: pynrfjprog finds no J-Link library (error {int(code)})", MEND_LIBRARY
            ) from error
        raise ProbeLostError(f"{what}: pynrfjprog says: {error}", tool.MEND_LOST) from error


def _loads(library: str) -> bool:
    import ctypes  # noqa: PLC0415 (only where the library has no path)

    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
