# SPDX-License-Identifier: Apache-2.0
"""64-bit ticks: are they the 32-bit counter, extended without a slip?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.wire.messages import TICK_RATE_HZ

WRAP_TICKS: Final = 1 << 32
"""The TIMER wraps every 2^32 ticks: 268.4 s at 16 MHz."""


def distinct(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """int64[m]: each value once, ascending.

    Runs of ``values`` that ascend are merged in linear time, where ``np.unique`` puts 64-bit
    numbers into a hash table and then sorts them.
    """
    ordered = np.sort(values, kind="stable")
    new = np.ones(ordered.size, dtype=bool)
    np.not_equal(ordered[1:], ordered[:-1], out=new[1:])
    return ordered[new]


@dataclass(frozen=True)
class TickBreaks:
    """Breaks in one stream of time stamps.

    Attributes:
        backwards: stamps older than the one before.
        jumps: stamps that left the bench clock by more than half a wrap against the one before.
        wraps: wraps of the 32-bit counter between the first stamp and the last.
    """

    backwards: int
    jumps: int
    wraps: int

    @property
    def total(self) -> int:
        return self.backwards + self.jumps


def breaks(ticks: NDArray[np.int64], seen_t_ns_bench: NDArray[np.int64]) -> TickBreaks:
    """Count breaks in a stream of extended ticks.

    A wrap that was not extended shows as a step of -2^32 against the bench clock, one that was
    counted twice as +2^32; both are far beyond the delay between a stamp and its frame.

    Args:
        ticks: int64[n], in the order of sending.
        seen_t_ns_bench: int64[n], when the frame with that stamp was seen.
    """
    if ticks.size == 0:
        return TickBreaks(0, 0, 0)
    step = np.diff(ticks)
    expected = np.diff(seen_t_ns_bench) * (TICK_RATE_HZ / 1e9)
    jumps = np.abs(step - expected) > WRAP_TICKS / 2
    backwards = (step < 0) & ~jumps
    wraps = int(ticks.max() // WRAP_TICKS - ticks.min() // WRAP_TICKS)
    return TickBreaks(int(np.sum(backwards)), int(np.sum(jumps)), wraps)
