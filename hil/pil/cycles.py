# SPDX-License-Identifier: Apache-2.0
"""From instructions to processor cycles: a model of the Cortex-M4F that leans to the slow side.

Timings: Cortex-M4 Technical Reference Manual, ARM DDI 0439B, table 3-1 (processor) and table 7-1
(FPU). Where the manual gives a range or a condition, the slow end is taken:

* every branch is taken and refills the pipeline in 3 cycles;
* no load or store hides behind its neighbour: 2 cycles, 1 + n for n words;
* every result of the FPU is consumed by the next instruction, which costs a cycle more;
* a division of integers takes 12 cycles.

Flash of the nRF52840 (Product Specification v1.7, CPU): 2 wait states with its cache off. A fetch
brings 4 bytes. Three figures follow:

* ``cached``: every fetch hits the cache;
* ``uncached``: the cache is off; in a block without branches the processor fetches while it
  executes, so the slower of the two decides; constants in the flash wait on top;
* ``serial``: the cache is off and every fetch holds the processor up in full: an upper bound.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

CLOCK_HZ: Final = 64_000_000
"""Of the nRF52840's processor."""
FETCH_BYTES: Final = 4
WAIT_STATES: Final = 2
BRANCH_REFILL: Final = 3

_MOVES: Final = re.compile(r"v?(ldr|str|ldm|stm|push|pop)")
_CYCLES: Final = tuple(
    (re.compile(pattern), cycles)
    for pattern, cycles in (
        (r"vdiv|vsqrt", 14 + 1),
        (r"vn?ml[as]|vfn?m[as]", 3 + 1),
        (r"vadd|vsub|vn?mul|vcvt", 1 + 1),
        (r"[su]div", 12),
        (r"tb[bh]", 2),
        (r"dsb|dmb|isb", 4),
    )
)
"""Instructions by the beginning of their name; all others take one cycle."""
_BRANCH: Final = re.compile(
    r"b|bl|bx|blx|cbz|cbnz|b(eq|ne|hs|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)|bx(eq|ne|hs|lo)"
)
_LISTS: Final = re.compile(r"(ldm|stm|push|pop|vldm|vstm|vpush|vpop)")


@dataclass(frozen=True)
class Instruction:
    """One instruction in the disassembler's unified syntax."""

    mnemonic: str
    operands: str
    size_bytes: int


@dataclass(frozen=True)
class Cost:
    """What a stretch of code costs: instructions executed, and cycles in three circumstances."""

    instructions: int = 0
    cached: float = 0.0
    uncached: float = 0.0
    serial: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(
            self.instructions + other.instructions,
            self.cached + other.cached,
            self.uncached + other.uncached,
            self.serial + other.serial,
        )


def block_cost(block: Iterable[Instruction]) -> Cost:
    """Of instructions that run one after the other."""
    count, bytes_, executing, constants = 0, 0, 0, 0
    for one in block:
        count += 1
        bytes_ += one.size_bytes
        executing += cycles(one.mnemonic, one.operands)
        constants += _constants(one)
    # The block may begin in the last bytes of a word: one fetch more.
    fetches = bytes_ / FETCH_BYTES + 1
    waiting = WAIT_STATES * constants
    return Cost(
        count,
        executing,
        max(executing + waiting, (1 + WAIT_STATES) * fetches),
        executing + waiting + WAIT_STATES * fetches,
    )


def _constants(one: Instruction) -> int:
    """Words that it loads from among the code."""
    name = one.mnemonic.partition(".")[0]
    return words(name, one.operands) if "ldr" in name and "[pc" in one.operands else 0


def cycles(mnemonic: str, operands: str) -> int:
    """Of one instruction without wait states."""
    name = mnemonic.partition(".")[0]
    refill = BRANCH_REFILL if _branches(name, operands) else 0
    return _base(name, operands) + refill


def words(name: str, operands: str) -> int:
    """How many words a load or store moves."""
    if _LISTS.match(name):
        return sum(_span(part) for part in operands.partition("{")[2].rstrip("}").split(","))
    if name.startswith(("vldr", "vstr")):
        return 2 if operands.startswith("d") else 1
    return 2 if name.startswith(("ldrd", "strd")) else 1


def _base(name: str, operands: str) -> int:
    if _MOVES.match(name):
        return 1 + words(name, operands)
    if name == "vmov" and operands.count(",") > 1:
        # Two registers of the processor at once.
        return 2
    return next((taken for pattern, taken in _CYCLES if pattern.match(name)), 1)


def _branches(name: str, operands: str) -> bool:
    if _BRANCH.fullmatch(name) or name in ("tbb", "tbh"):
        return True
    if name.startswith(("pop", "ldm")):
        return "pc" in operands
    return name.startswith(("ldr", "mov", "add")) and operands.startswith("pc,")


def _span(part: str) -> int:
    """Words of one entry of a register list: ``r4``, ``s16`` or ``d8``, or a range of them."""
    ends = part.strip().split("-")
    count = 1 if len(ends) == 1 else int(ends[1].strip()[1:]) - int(ends[0].strip()[1:]) + 1
    return count * (2 if part.strip().startswith("d") else 1)
