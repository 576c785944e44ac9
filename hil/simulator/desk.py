# SPDX-License-Identifier: Apache-2.0
"""One simulated unit on a desk: its serial line is a terminal that any program can open.

The unit runs until the desk is left. It keeps its flash over resets, and a reset that its firmware
asks for starts it again on the same terminal, as a board on its debugger's serial port would.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
import uuid
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from hil.build import BabbleSim
from hil.errors import HilError, RigError
from hil.motion.imu_model import ChipErrors
from hil.process import Child, Guard
from hil.process.child import describe_status
from hil.scenario import ImuScenario
from hil.simulator.arguments import chip
from hil.simulator.cable import Cable
from hil.simulator.hands import Hands
from hil.simulator.session import pick_core, shared_folder

EXIT_POWER_CUT: Final = 86
EXIT_REBOOT: Final = 87
"""Exit statuses of a simulated board (firmware/sim/flash_power.c, reboot.c)."""
FLASH_FILE: Final = "flash.bin"
POLL_S: Final = 0.01


class Desk:
    """A running unit; a context manager that leaves nothing behind, however it is left.

    Args:
        executable: image built for the simulated board.
        errors: of its sensor.
        imu: the rest of what its sensor is like.
        seed: of noise and radio; with ``number``, the chip's identity.
        number: the device's, as in a simulation of several.
        speed: at most so many times as fast as real time; 0 for as fast as it goes.
        flash: file of the flash, made when it is not there; by default one that goes with the desk.
        options: further options of the executable, e.g. ``-hil_flash_cut=3:torn``.

    Attributes:
        port: path of the terminal.
        hands: hold the unit.
        boots: times that it has started.
    """

    def __init__(
        self,
        babblesim: BabbleSim,
        executable: Path,
        errors: ChipErrors,
        *,
        imu: ImuScenario | None = None,
        seed: int = 1,
        number: int = 0,
        speed: float = 0.0,
        flash: Path | None = None,
        options: tuple[str, ...] = (),
    ) -> None:
        self.port = ""
        self.boots = 0
        self._babblesim = babblesim
        self._executable = executable
        self._errors = errors
        self._imu = imu or ImuScenario()
        self._seed = seed
        self._number = number
        self._speed = speed
        self._flash = flash
        self._options = options
        self._leaving = threading.Event()
        self._ended = threading.Event()
        self._why = ""
        self._power_cut = False
        self._cleanup = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._guard = stack.enter_context(Guard())
            self._folder = Path(tempfile.gettempdir()) / f"hil-desk-{uuid.uuid4().hex[:12]}"
            self._guard.watch_folder(self._folder)
            self._folder.mkdir(mode=0o700)
            self._cable = Cable()
            stack.callback(self._cable.close)
            self.port = self._cable.outer
            self.hands = Hands(self._folder / "hands", self._errors)
            stack.callback(self.hands.close)
            keeper = threading.Thread(target=self._keep_running, name="desk", daemon=True)
            stack.callback(keeper.join)
            stack.callback(self._leaving.set)
            keeper.start()
            self._cleanup = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._cleanup.__exit__(kind, error, traceback)

    def check(self) -> None:
        """Raise what ended the unit, when it has ended.

        Raises:
            RigError: it died, or lost its power; the message shows its last words.
        """
        if self._ended.is_set():
            raise RigError(self._why)

    def wait_power_cut(self, timeout_s: float) -> bool:
        """Wait for the end of the unit; True when it lost its power as it was told to."""
        self._ended.wait(timeout_s)
        return self._power_cut

    def _keep_running(self) -> None:
        try:
            self._run()
        except HilError as error:
            self._why = str(error)
            self._ended.set()

    def _run(self) -> None:
        while not self._leaving.is_set():
            # A chip that starts does not know how it is held.
            self.hands.rest()
            status, words = self._run_once()
            if status is None or status == EXIT_REBOOT:
                continue
            self._power_cut = status == EXIT_POWER_CUT
            self._why = (
                "the simulated unit lost its power, as it was told to"
                if self._power_cut
                else f"the simulated unit ended ({describe_status(status)}); "
                f"its last words:\n{words}"
            )
            self._ended.set()
            return

    def _run_once(self) -> tuple[int | None, str]:
        sim_id = f"hil-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self._guard.watch_folder(shared_folder(sim_id))
        core = pick_core()
        phy = [str(self._babblesim.phy), f"-s={sim_id}", "-D=1", "-nodump", "-no-color"]
        with (
            Child(
                phy, name="the radio simulator", cwd=self._babblesim.phy.parent, core=core
            ) as air,
            Child(self._argv(sim_id), name="the unit", cwd=self._folder, core=core) as unit,
        ):
            self._guard.watch_session(air.pid)
            self._guard.watch_session(unit.pid)
            self.boots += 1
            while not self._leaving.is_set():
                status = unit.exit_status()
                if status is not None:
                    return status, unit.last_words()
                time.sleep(POLL_S)
            unit.stop(grace_s=0.0)
            air.stop(grace_s=0.0)
        return None, ""

    def _argv(self, sim_id: str) -> list[str]:
        return [
            str(self._executable),
            f"-s={sim_id}",
            "-d=0",
            f"-gd={self._number}",
            f"-rs={self._seed}",
            "-no-color",
            *chip(self._imu, self._seed + self.boots),
            f"-hil_uart={self._cable.inner}",
            f"-hil_speed={self._speed!r}",
            f"-imu_hands={self._folder / 'hands'}",
            f"-flash={self._flash or self._folder / FLASH_FILE}",
            *self._options,
        ]
