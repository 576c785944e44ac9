# SPDX-License-Identifier: Apache-2.0
"""Telling which of the simulation's programs died or hangs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hil.errors import RigError
from hil.process import Child
from hil.process.child import describe_status
from hil.simulator.node import Node

END_TOLERANCE_S = 2.0
"""How long before the end of the run a node may have been heard of last. A node that has nothing
to do with the radio tells the simulator its time once a second."""

LOOKS = 7
LOOK_INTERVAL_S = 0.05

BUSY_STATES = {"R": "its processor never rests", "T": "it was stopped", "t": "it is being traced"}
"""Process states (proc(5)) that no program waiting for another one has."""


class ProgressWatch:
    """Notices when simulated time stands still."""

    def __init__(self, limit_s: float) -> None:
        self.limit_s = limit_s
        self._seen: dict[str, float] = {}
        self._moved_s = time.monotonic()

    def look(self, nodes: Sequence[Node], phy: Child) -> None:
        """Compare with the last look.

        Raises:
            RigError: no node's simulated time has moved for ``limit_s`` of real time.
        """
        now = {node.role: node.true_s for node in nodes}
        if now != self._seen:
            self._seen, self._moved_s = now, time.monotonic()
        elif time.monotonic() - self._moved_s > self.limit_s:
            raise hung(nodes, phy, self.limit_s)


def hung(nodes: Sequence[Node], phy: Child, limit_s: float) -> RigError:
    """The error for a simulation that stands still, naming who holds it up.

    All programs wait for the slowest: the one that is not waiting is to blame, and if all seem to
    wait, the one that is furthest behind.
    """
    order = sorted(nodes, key=lambda node: node.true_s)
    programs = [(node.child, f"the {node.role} node") for node in order]
    programs.append((phy, "the radio simulator"))
    child, title = programs[0]
    why = "it waits for something that does not come"
    for candidate, state in zip(programs, steady_states(programs), strict=True):
        if state in BUSY_STATES:
            child, title = candidate
            why = BUSY_STATES[state]
            break
    return RigError(
        f"{title} hangs at {order[0].true_s:.3f} s of simulated time: no progress for "
        f"{limit_s:g} s ({why}); its last output:\n{child.last_words()}",
        "look for a loop that never sleeps, or for a wait with interrupts locked",
    )


def steady_states(programs: Sequence[tuple[Child, str]]) -> list[str]:
    """The state that each program was in at every one of a few looks; empty where it changed.

    One look is not enough: a program that polls is busy now and then.
    """
    looks = []
    for _ in range(LOOKS):
        looks.append([process_state(child.pid) for child, _ in programs])
        time.sleep(LOOK_INTERVAL_S)
    return [seen[0] if len(set(seen)) == 1 else "" for seen in zip(*looks, strict=True)]


def process_state(pid: int) -> str:
    """The busiest state of a process's threads, as proc(5) abbreviates it; empty when gone."""
    states = set()
    for stat in Path(f"/proc/{pid}/task").glob("*/stat"):
        try:
            # The name in parentheses may itself hold parentheses and blanks.
            states.add(stat.read_text(encoding="utf-8").rpartition(")")[2].split()[0])
        except (OSError, IndexError):
            continue
    return next((state for state in (*BUSY_STATES, *sorted(states)) if state in states), "")


@dataclass(frozen=True)
class Ended:
    """A program that has ended."""

    title: str
    child: Child
    status: int
    true_s: float


def check_ends(nodes: Sequence[Node], phy: Child) -> bool:
    """True when the whole run has come to its proper end, False while it goes on.

    Raises:
        RigError: a program died, or ended before its time.
    """
    programs = [(f"the {node.role} node", node.child, node.true_s) for node in nodes]
    programs.append(("the radio simulator", phy, min(node.true_s for node in nodes)))
    ended = [
        Ended(title, child, status, true_s)
        for title, child, true_s in programs
        if (status := child.exit_status()) is not None
    ]
    # A program killed by a signal may have taken others with it, so it is named first.
    for one in sorted(ended, key=lambda e: e.status):
        if one.status != 0:
            raise RigError(
                f"{one.title} died at {one.true_s:.3f} s of simulated time "
                f"({describe_status(one.status)}); its last output:\n{one.child.last_words()}"
            )
    return len(ended) == len(programs)


def check_reached_end(nodes: Sequence[Node], duration_s: float) -> None:
    """See that no node left early.

    Raises:
        RigError: one did.
    """
    for node in nodes:
        if node.true_s < duration_s - END_TOLERANCE_S:
            raise RigError(
                f"the {node.role} node ended by itself at {node.true_s:.3f} s of "
                f"{duration_s:g} s of simulated time; its last output:\n"
                f"{node.child.last_words()}"
            )
