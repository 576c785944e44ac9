# SPDX-License-Identifier: Apache-2.0
"""A virtual bench whose boards are the simulated nodes, running while they are listened to.

They hear what the host sends. The nodes keep real time themselves (``firmware/sim/pace.c``), so
what they say is passed on as it comes.
"""

from __future__ import annotations

import os
import shlex
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hil.build import BabbleSim, Manifest
from hil.recording import EDGE_CHANNELS
from hil.scenario import Scenario
from hil.simulator import Session
from hil.wire.messages import ROLES
from tests.bench.virtual.disguise import Disguise
from tests.bench.virtual.play import Tape
from tests.bench.virtual.world import DEVICE_IDS, World

PACED = """#!/bin/sh
exec {program} "$@" -hil_speed=1.0
"""


class LiveWorld(World):
    """See the module.

    Args:
        images: role -> image built for the simulated board.
        scenario: crystals, chips and radio; its commands are for the host to send.
    """

    def __init__(
        self,
        folder: Path,
        babblesim: BabbleSim,
        images: Mapping[str, Manifest],
        scenario: Scenario,
    ) -> None:
        build_ids = {role: image.build_id for role, image in images.items()}
        kconfig = {role: dict(image.kconfig) for role, image in images.items()}
        self._blank = lambda: Tape(
            bursts={role: [] for role in ROLES},
            edges={channel: np.zeros(0) for channel in EDGE_CHANNELS},
            build_ids=build_ids,
            kconfig=kconfig,
            has_calibration=True,
        )
        super().__init__(folder, self._blank())
        self._babblesim = babblesim
        self._executables = {role: self._paced(image) for role, image in images.items()}
        self._scenario = scenario
        self._runner: threading.Thread | None = None
        self._ending = threading.Event()
        self._handed: dict[str, int] = {}

    def _paced(self, image: Manifest) -> Path:
        script = self.folder / f"{image.role}.sh"
        self.folder.mkdir(exist_ok=True)
        script.write_text(PACED.format(program=shlex.quote(str(image.file("exe")))))
        script.chmod(0o755)
        return script

    def reset(self, role: str) -> None:
        """As of any bench; but what begins is a simulation, and not known beforehand."""
        super().reset(role)
        if self._start_ns is None:
            self._end_session()
            return
        with self._lock:
            self._start_ns = None
            self.tape = self._blank()
        self._ending = threading.Event()
        self._runner = threading.Thread(target=self._simulate, args=(self._ending,), daemon=True)
        self._runner.start()

    def close(self) -> None:
        self._end_session()

    def _end_session(self) -> None:
        self._ending.set()
        runner, self._runner = self._runner, None
        if runner is not None:
            runner.join(20)

    def _simulate(self, ending: threading.Event) -> None:
        disguises = dict(zip(ROLES, map(Disguise, DEVICE_IDS), strict=True))
        with Session(self._babblesim, self._executables, self._scenario) as session:
            with self._lock:
                self._start_ns = time.monotonic_ns()
            while not ending.is_set() and session.wait():
                for node in session.nodes:
                    self._hand_over(node.role, node.line.master)
                    for t_ns, data in node.serial():
                        with self._lock:
                            said = (t_ns, disguises[node.role].feed(data))
                            self.tape.bursts[node.role].append(said)

    def _hand_over(self, role: str, line: int) -> None:
        """What the host sent since the last time goes to the node."""
        with self._lock:
            data = bytes(self.heard[role][self._handed.get(role, 0) :])
            self._handed[role] = len(self.heard[role])
        if data:
            os.write(line, data)
