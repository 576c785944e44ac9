# SPDX-License-Identifier: Apache-2.0
"""What the host says to a simulated node, and when: the file that ``-hil_commands`` takes."""

from __future__ import annotations

from pathlib import Path

from hil.commands import planned
from hil.recording import ClockModel
from hil.scenario import Scenario
from hil.wire.codec import encode

BOOTED_US = 20_000
"""Node's time at which its receiver is on and its IMU has not yet made a sample."""


def write(path: Path, scenario: Scenario, role: str, clock: ClockModel) -> bool:
    """Write the commands of ``role``; False, and no file, when there are none."""
    lines = []
    for seq, command in enumerate(planned(scenario, role)):
        at_s = command.at_s
        local_us = BOOTED_US if at_s is None else float(clock.local_us(at_s * 1e6))
        lines.append(f"{round(local_us)},{encode(command.name, command.values, seq).hex()}\n")
    if not lines:
        return False
    # A drop may be meant for before the node is ready.
    lines.sort(key=lambda line: int(line.partition(",")[0]))
    path.write_text("".join(lines), encoding="ascii")
    return True
