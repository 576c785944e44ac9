# SPDX-License-Identifier: Apache-2.0
"""Times, and a row of the table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        work, ours, peer: what was done, and what came out of either, with units.
        ratio: how many times faster than the peer ours is; None without a peer.
        limit: share of the physical limit that ours reaches: reading the same bytes once from
            memory; None where no bytes are read.
        aim, met: what is wanted, and whether it is so; None when it could not be measured.
        lacking: where it is not met, by how much, and the next step.
    """

    work: str
    ours: str
    peer: str
    ratio: float | None
    limit: float | None
    aim: str
    met: bool | None
    lacking: str = ""


def best(work: Callable[[], Any], times: int = 5) -> float:
    """Least processor time of several runs, s: that of the run disturbed least."""

    def once() -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    return min(once() for _ in range(times))


def reading_s(size: int) -> float:
    """Processor time of reading so many bytes once from memory, s."""
    words = np.ones(min(max(size, 1 << 20), 1 << 27) // 8, np.int64)
    return best(words.max, 5) * size / words.nbytes
