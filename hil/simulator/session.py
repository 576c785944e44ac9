# SPDX-License-Identifier: Apache-2.0
"""One simulation from start to end: programs, pseudoterminals, folders, and their removal."""

from __future__ import annotations

import os
import pwd
import tempfile
import time
import uuid
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from hil.build import BabbleSim
from hil.errors import RigError
from hil.process import Child, Guard
from hil.recording import ClockModel
from hil.scenario import Scenario, to_mapping
from hil.simulator import arguments, commands, motion
from hil.simulator.node import Node
from hil.simulator.watch import ProgressWatch, check_ends, check_reached_end

DRAIN_LIMIT_S = 5.0
POLL_S = 0.01


class Session:
    """A running simulation; a context manager that leaves nothing behind, however it is left.

    Args:
        executables: role -> image built for the simulated board.
        stall_limit_s: real time without simulated progress after which a node counts as hung.
        flash: role -> file of what its flash holds; empty where there is none.
        speed: at most so many times as fast as real time; 0 for as fast as it goes.
    """

    def __init__(
        self,
        babblesim: BabbleSim,
        executables: Mapping[str, Path],
        scenario: Scenario,
        stall_limit_s: float = 30.0,
        flash: Mapping[str, Path] | None = None,
        *,
        speed: float = 0.0,
    ) -> None:
        self.sim_id = f"hil-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self.nodes: list[Node] = []
        self._babblesim = babblesim
        self._executables = executables
        self._scenario = scenario
        self._flash = flash or {}
        self._speed = speed
        self._watch = ProgressWatch(stall_limit_s)
        self._drain_deadline_s: float | None = None
        self._ended = 0
        self._cleanup = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            guard = stack.enter_context(Guard())
            guard.watch_folder(shared_folder(self.sim_id))
            # Told before it is made, so that there is no moment at which it could be left.
            folder = Path(tempfile.gettempdir()) / self.sim_id
            guard.watch_folder(folder)
            folder.mkdir(mode=0o700)
            self._start(stack, guard, folder)
            self._cleanup = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._cleanup.__exit__(kind, error, traceback)

    @property
    def true_s(self) -> float:
        """True simulated time that every node has reached."""
        return min(node.true_s for node in self.nodes)

    def wait(self) -> bool:
        """Wait a moment; False when the run has ended.

        The end of a program is told one call late, so that the caller has read what it said last,
        and knows when that was.

        Raises:
            RigError: a program died or hangs; the message names it and shows its last output.
        """
        children = [self._phy, *(node.child for node in self.nodes)]
        ended = sum(child.exit_status() is not None for child in children)
        if ended == self._ended and check_ends(self.nodes, self._phy):
            return False
        self._ended = ended
        # Woken for each burst, this process would cost as much as the simulation.
        time.sleep(POLL_S)
        self._watch.look(self.nodes, self._phy)
        return True

    def drained(self) -> bool:
        """After the end: True when every byte that was sent has been read.

        Raises:
            RigError: bytes are missing, or a node ended before its time.
        """
        check_reached_end(self.nodes, self._scenario.duration_s)
        missing = {node.role: node.line.undelivered for node in self.nodes}
        if not any(missing.values()):
            return True
        if self._drain_deadline_s is None:
            self._drain_deadline_s = time.monotonic() + DRAIN_LIMIT_S
        if time.monotonic() > self._drain_deadline_s:
            raise RigError(
                "the serial line lost bytes: "
                + ", ".join(f"{count} of the {role}" for role, count in missing.items())
            )
        time.sleep(0.01)
        return False

    def _start(self, stack: ExitStack, guard: Guard, folder: Path) -> None:
        core = pick_core()
        clocks = to_mapping(self._scenario)["nodes"]
        for role in arguments.started(self._scenario):
            clock = ClockModel.from_mapping(clocks.get(role, {}))
            node = Node(role, clock, folder)
            stack.callback(node.close)
            self.nodes.append(node)
        self._phy = self._spawn(
            stack,
            guard,
            arguments.phy(self._babblesim, self.sim_id, self._scenario),
            name="the radio simulator",
            # It loads the channel and the modem from ../lib.
            cwd=self._babblesim.phy.parent,
            core=core,
        )
        for node in self.nodes:
            has_commands = commands.write(
                arguments.commands_file(folder, node.role), self._scenario, node.role, node.clock
            )
            if self._scenario.motion is not None:
                motion.write(arguments.motion_file(folder, node.role), self._scenario, node.role)
            argv = arguments.node(
                self._executables[node.role],
                node.role,
                self._scenario,
                sim_id=self.sim_id,
                serial=node.line.path,
                folder=folder,
                commands=has_commands,
                flash=self._flash.get(node.role),
                speed=self._speed,
            )
            node.attach(
                self._spawn(stack, guard, argv, name=f"the {node.role} node", cwd=folder, core=core)
            )

    def _spawn(
        self, stack: ExitStack, guard: Guard, argv: list[str], *, name: str, cwd: Path, core: int
    ) -> Child:
        child = Child(argv, name=name, cwd=cwd, core=core)
        # Nothing of value is in these programs, so they are killed and not asked.
        stack.callback(child.stop, grace_s=0.0)
        guard.watch_session(child.pid)
        return child


def shared_folder(sim_id: str) -> Path:
    """Where BabbleSim keeps the pipes and locks of a simulation (libPhyComv1, bs_pc_base.c)."""
    return Path("/tmp") / f"bs_{pwd.getpwuid(os.geteuid()).pw_name}" / sim_id  # noqa: S108


def pick_core() -> int:
    """One core for all programs of a simulation: they take turns, and waking another core costs
    more than it gives. Simulations side by side spread over the cores."""
    cores = sorted(os.sched_getaffinity(0))
    return cores[os.getpid() % len(cores)]
