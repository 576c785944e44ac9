# SPDX-License-Identifier: Apache-2.0
"""What each step's instructions cost, from QEMU's log of the blocks that it executed.

The log (``-d in_asm,exec,nochain``) lists a block's instructions when the block is first met, and
one line each time that it runs. A step lasts from the first block of ``Estimator<float>::step``
until the block at its return address.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

from hil.errors import RigError
from hil.parity import Batch
from hil.pil.cycles import Cost, Instruction, block_cost
from hil.pil.emulator import run_bytes
from hil.pil.feed import encode
from hil.pil.image import Image, Progress, quiet
from hil.process import scratch
from hil.reference.params import Params

STEP_SYMBOL: Final = "_ZN2bv9EstimatorIfE4step"
_INSTRUCTION: Final = re.compile(r"0x([0-9a-f]{8}):  ((?:[0-9a-f]{4} ?){1,2})\s+(\S+)\s*(.*)")


@dataclass
class Block:
    """Instructions that run one after the other, and the address after them."""

    instructions: list[Instruction] = field(default_factory=list)
    end: int = 0

    @cached_property
    def cost(self) -> Cost:
        """Asked for when the block has run, and is therefore listed whole."""
        return block_cost(self.instructions)


def step_costs(
    image: Image,
    samples: Batch,
    params: Params | None = None,
    *,
    progress: Progress = quiet,
) -> list[Cost]:
    """Cost of each step of a batch, which should be short: QEMU's log has 100 KB a step.

    Raises:
        RigError: as :func:`hil.pil.emulator.run`, or the log does not show the steps.
    """
    steps = len(samples.leader.t_ticks)
    with scratch("pil") as folder:
        log = folder / "log"
        run_bytes(image, encode(samples, params or Params()), steps, progress, log)
        with log.open(encoding="utf-8", errors="replace") as lines:
            costs = list(parse(lines))
    if len(costs) != steps:
        raise RigError(f"QEMU's log shows {len(costs)} steps of {steps}")
    return costs


def parse(lines: Iterable[str]) -> Iterator[Cost]:
    """Cost of each step that a log shows whole, in order."""
    blocks: dict[str, Block] = {}
    listed: Block | None = None
    ran = Block()
    entry = back = ""
    step: list[Cost] = []
    inside = False
    for line in lines:
        if line.startswith("Trace"):
            at = line.index("/") + 1
            address = line[at : at + 8]
            if not entry and STEP_SYMBOL in line:
                entry = address
            if inside and address == back:
                yield sum(step, Cost())
                inside, step = False, []
            elif not inside and address == entry:
                inside, back = True, f"{ran.end:08x}"
            ran = blocks[address]
            if inside:
                step.append(ran.cost)
        elif line.startswith("IN:"):
            listed = None
        elif found := _INSTRUCTION.match(line):
            if listed is None:
                listed = blocks[found[1]] = Block()
            size_bytes = len(found[2].replace(" ", "")) // 2
            listed.end = int(found[1], 16) + size_bytes
            listed.instructions.append(Instruction(found[3], found[4].strip(), size_bytes))
        elif line.startswith("Stopped execution") and step:
            # The block was announced and not run; it will be announced again.
            step.pop()
