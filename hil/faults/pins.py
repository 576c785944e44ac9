# SPDX-License-Identifier: Apache-2.0
"""Faults of the edges that an analyser sees. Pure, on arrays of one channel's edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]
Mask = NDArray[np.bool_]


def missing(rng: np.random.Generator, t_ns: Times, inside: Mask, share: float) -> Mask:
    """bool[n]: edges that are still seen. One draw for each edge, in the span or not."""
    return np.asarray(~(inside & (rng.random(t_ns.size) < share)))


def late(t_ns: Times, inside: Mask, late_s: float) -> Times:
    """int64[n], ns: when the edges are seen."""
    return np.asarray(t_ns + inside * round(late_s * 1e9), dtype=np.int64)


def analyser_drop(t_ns: Times, from_ns: int, lost_s: float) -> tuple[Times, NDArray[Any]]:
    """Times, ns, by an analyser that counts samples and misses some; and which edges it saw."""
    lost_ns = round(lost_s * 1e9)
    seen = (t_ns < from_ns) | (t_ns >= from_ns + lost_ns)
    return t_ns - (t_ns >= from_ns + lost_ns) * lost_ns, seen
