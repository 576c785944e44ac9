# SPDX-License-Identifier: Apache-2.0
"""What the estimator may cost on the target's processor, with the arithmetic of each limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from hil.budget.model import Case, Conditions, Line
from hil.measure import Limits


def _always(_: Conditions) -> bool:
    return True


LINES: Final[tuple[Line, ...]] = (
    Line(
        "E1",
        "steps whose outputs on the processor differ from the host core's in any bit",
        "1",
        "both use IEEE 754 single precision, the same order of operations and no contraction",
        (Case("always", _always, high=0.0),),
    ),
    Line(
        "E2",
        "longest step with a rigid-body update and no other",
        "instructions",
        "what the product asks for; at 3 cycles each, 20,000 * 3 = 60,000 of the "
        "64e6 / 416 = 153,846 cycles between two samples",
        (Case("always", _always, high=20_000.0),),
    ),
    Line(
        "E3",
        "longest step of any kind, cache off and no fetch overlapped",
        "cycles",
        "a step must end before the next sample: 64e6 / 416 = 153,846; one third is left for the "
        "radio and the drivers: 153,846 * 2 / 3 = 102,564",
        (Case("always", _always, high=102_564.0),),
    ),
    Line(
        "E4",
        "share of the processor at 416 Hz, cache off",
        "1",
        "a fifth of 64 MHz, so that half is left in line F4 with radio and drivers: "
        "0.2 * 64e6 / 416 = 30,769 cycles a step on average",
        (Case("always", _always, high=0.2),),
    ),
    Line(
        "E5",
        "bytes of stack below a step's caller, bound over all inputs",
        "B",
        "a third of the fusion thread's 6144 B: 6144 / 3 = 2048; the rest is the caller's, and "
        "interrupts' frames of 104 B",
        (Case("always", _always, high=2048.0),),
    ),
    Line(
        "E6",
        "functions of the heap in the linked program",
        "1",
        "the estimator has fixed sizes",
        (Case("always", _always, high=0.0),),
    ),
)

_BY_ID: Final[Mapping[str, Line]] = {line.id: line for line in LINES}


def limits(line_id: str) -> Limits:
    """Of a line; they hold under all conditions."""
    return _BY_ID[line_id].limits(Conditions(conn_interval_us=0.0))
