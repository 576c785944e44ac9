# SPDX-License-Identifier: Apache-2.0
"""Scheduled pulses: both nodes act at the same instant of the leader's clock, or do they?

Two views of the same thing. The exact one takes the COMPARE values that both nodes programmed
and the true clocks: it resolves a tick, and needs simulation. The outside one takes the edges on
the analyser: it needs no help from the firmware, and resolves what the analyser resolves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.timesync.truth import Truth
from hil.wire.messages import PULSE_FLAGS

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

_BLOCK: Final = 1 << 14
"""Edges that are paired at once: what the processor's cache holds."""


@dataclass(frozen=True, eq=False)
class Pulses:
    """One node's ``pulse`` frames, one row per index, ascending.

    Attributes:
        index, scheduled_ticks_leader, compare_ticks_node: int64[n].
        late: bool[n], the node was too late to program it.
    """

    index: Int
    scheduled_ticks_leader: Int
    compare_ticks_node: Int
    late: Mask

    def __len__(self) -> int:
        return int(self.index.size)

    def take(self, rows: Mask | Int) -> Pulses:
        """The pulses selected by ``rows``."""
        return Pulses(
            self.index[rows],
            self.scheduled_ticks_leader[rows],
            self.compare_ticks_node[rows],
            self.late[rows],
        )

    def between(self, start_ticks_leader: float, end_ticks_leader: float) -> Pulses:
        """The pulses scheduled in [start, end)."""
        t = self.scheduled_ticks_leader
        return self.take((t >= start_ticks_leader) & (t < end_ticks_leader))

    @property
    def period_ticks(self) -> float:
        """Median distance of the schedule; NaN with fewer than two pulses."""
        if len(self) < 2:
            return float("nan")
        steps = np.diff(self.scheduled_ticks_leader) / np.diff(self.index)
        return float(np.median(steps))


def pulses(frames: NDArray[Any]) -> Pulses:
    """The ``pulse`` frames of one node; of a repeated index the first counts."""
    index, first = np.unique(frames["index"].astype(np.int64), return_index=True)
    return Pulses(
        index=index,
        scheduled_ticks_leader=frames["scheduled_ticks_leader"].astype(np.int64)[first],
        compare_ticks_node=frames["compare_ticks_node"].astype(np.int64)[first],
        late=(frames["flags"].astype(np.int64)[first] & PULSE_FLAGS["late"]).astype(bool),
    )


@dataclass(frozen=True, eq=False)
class Common:
    """Pulses that both nodes report under one index."""

    leader: Pulses
    follower: Pulses


def common(leader: Pulses, follower: Pulses) -> Common:
    """Pair the two nodes' pulses by index; late ones, which were not emitted, are left out."""
    leader, follower = leader.take(~leader.late), follower.take(~follower.late)
    _, a, b = np.intersect1d(leader.index, follower.index, assume_unique=True, return_indices=True)
    return Common(leader.take(a), follower.take(b))


def exact_error_ns(pair: Common, truth: Truth) -> Float:
    """float64[n]: true time of the leader's COMPARE minus that of the follower's."""
    leader = truth.clocks["leader"].true_ns(pair.leader.compare_ticks_node)
    follower = truth.clocks["follower"].true_ns(pair.follower.compare_ticks_node)
    return leader - follower


def nearest(sorted_ns: Float | Int, at_ns: Float | Int) -> Float:
    """float64[m]: nearest of ``sorted_ns`` minus ``at_ns``; infinite when there is none."""
    at = np.asarray(at_ns, dtype=np.float64)
    if sorted_ns.size == 0:
        return np.full(at.shape, np.inf)
    after = np.searchsorted(sorted_ns, at)
    before = np.maximum(after - 1, 0)
    after = np.minimum(after, sorted_ns.size - 1)
    up, down = sorted_ns[after] - at, sorted_ns[before] - at
    return np.where(np.abs(up) < np.abs(down), up, down).astype(np.float64)


def leading_edges(t_ns_bench: Int, period_ns: float) -> Int:
    """Edges that begin a pulse: not preceded by another within half a period.

    A node may toggle its pin at each pulse or raise and lower it; either way the first edge is
    the one that TIMER COMPARE made.
    """
    if t_ns_bench.size == 0:
        return t_ns_bench
    quiet_before = np.append(True, np.diff(t_ns_bench) > 0.5 * period_ns)
    return np.asarray(t_ns_bench[quiet_before], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class EdgePairs:
    """Leading edges of both nodes.

    Attributes:
        t_ns_bench: int64[n], leader's edges that have a partner.
        difference_ns: float64[n], leader minus follower.
        alone: edges of either node without a partner within a quarter of a period.
    """

    t_ns_bench: Int
    difference_ns: Float
    alone: int


def _partners(sorted_ns: Int, at_ns: Int, within_ns: float) -> Float:
    """As :func:`nearest`, of leading edges: distances beyond ``within_ns`` may be of others.

    Leading edges are more than ``2 * within_ns`` apart, so at most one is within it, and where all
    of a block have theirs in step nothing is searched for. A lost edge costs its block a search.
    """
    if not within_ns < 2**62:
        return nearest(sorted_ns, at_ns)
    found = np.empty(at_ns.size, dtype=np.float64)
    for begin in range(0, at_ns.size, _BLOCK):
        at, to = at_ns[begin : begin + _BLOCK], found[begin : begin + _BLOCK]
        # A float here would make one of every edge, for each block.
        first = int(np.searchsorted(sorted_ns, at[0] - np.int64(within_ns)))
        step = sorted_ns[first : first + at.size]
        if step.size == at.size:
            np.subtract(step, at, out=to)
            if max(to.max(), -to.min()) <= within_ns:
                continue
        to[:] = nearest(sorted_ns, at)
    return found


def edge_pairs(
    leader_ns: Int, follower_ns: Int, period_ns: float, start_ns: float, end_ns: float
) -> EdgePairs:
    """Pair the two nodes' leading edges between ``start_ns`` and ``end_ns``, nearest to nearest."""
    leader = leading_edges(leader_ns, period_ns)
    follower = leading_edges(follower_ns, period_ns)
    leader_in = leader[(leader >= start_ns) & (leader < end_ns)]
    follower_in = follower[(follower >= start_ns) & (follower < end_ns)]
    # Partners are sought among all edges: one may lie just outside the span.
    to_follower = _partners(follower, leader_in, 0.25 * period_ns)
    to_leader = _partners(leader, follower_in, 0.25 * period_ns)
    near = np.abs(to_follower) <= 0.25 * period_ns
    alone = int(np.sum(~near) + np.sum(np.abs(to_leader) > 0.25 * period_ns))
    return EdgePairs(leader_in[near], -to_follower[near], alone)
