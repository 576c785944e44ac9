# SPDX-License-Identifier: Apache-2.0
"""The truth: what each node's TIMER really read at each instant of the bench clock.

In simulation the crystals are known exactly, so a node's ticks follow from one unknown, the
local time at which its TIMER was started::

    ticks = 16 * (local_us(true_us) - t_start_us)

That unknown is found from outside, without asking the firmware: every END capture has an edge
on the analyser, so the difference between the two, in local microseconds, is the same whole
number for all of them. The number with the most votes wins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.recording import ClockModel
from hil.timesync.ticks import distinct
from hil.wire.messages import TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]

TICKS_PER_US: Final = TICK_RATE_HZ // 1_000_000
MIN_SHARE: Final = 0.5
"""Share of the captures that must have an edge for the vote to count."""
MIN_LEAD: Final = 10
"""By how many captures the winner must lead. Periodic traffic fits itself, shifted by an event, but
for the few captures where the grid of 1 us shows that the period is no whole number of it; the
true start misses none of those.
"""

_SAMPLE: Final = 256
_BEFORE_US: Final = 3_000_000
_AFTER_US: Final = 200_000
_BLOCK: Final = 4096
"""Captures that are looked up at once."""
_TABLE_US: Final = 1 << 25
"""A block that spans longer is searched for, so that scattered captures cost no memory."""


@dataclass(frozen=True)
class NodeClock:
    """A node's TIMER on the bench clock.

    Attributes:
        model: the node's crystal.
        t_start_us: local time at which the TIMER read zero.
    """

    model: ClockModel
    t_start_us: float

    def true_ns(self, ticks: Int | Float) -> Float:
        """float64[n]: bench time, ns, at which the TIMER reads ``ticks``."""
        local_us = np.asarray(ticks, dtype=np.float64) / TICKS_PER_US + self.t_start_us
        return np.asarray(self.model.true_us(local_us), dtype=np.float64) * 1e3

    def ticks(self, true_ns: Int | Float) -> Float:
        """float64[n]: reading of the TIMER, not rounded, at bench time ``true_ns``."""
        local_us = self.model.local_us(np.asarray(true_ns, dtype=np.float64) / 1e3)
        return (np.asarray(local_us, dtype=np.float64) - self.t_start_us) * TICKS_PER_US


@dataclass(frozen=True)
class Vote:
    """Where a TIMER started, and how sure that is.

    Attributes:
        t_start_us: local time of the start, whole microseconds.
        share: of the captures that have an edge exactly there.
        runner_up: share of the best other candidate.
        captures: that voted.
    """

    t_start_us: int
    share: float
    runner_up: float
    captures: int

    @property
    def sound(self) -> bool:
        lead = (self.share - self.runner_up) * self.captures
        return self.share >= MIN_SHARE and lead >= MIN_LEAD


@dataclass(frozen=True)
class Truth:
    """Both nodes' clocks on the bench clock, or why there are none.

    Attributes:
        clocks: role -> clock; empty when the truth is not known.
        votes: role -> how the start of its TIMER was found.
        why: why ``clocks`` is empty.
        due: the source can give the truth, so its absence is a failure.
    """

    clocks: Mapping[str, NodeClock]
    votes: Mapping[str, Vote]
    why: str
    due: bool

    def __bool__(self) -> bool:
        return bool(self.clocks)

    def offset_ticks(self, ticks_leader: Int | Float) -> Float:
        """float64[n]: true follower minus leader ticks at instants of the leader's clock."""
        true_ns = self.clocks["leader"].true_ns(ticks_leader)
        return self.clocks["follower"].ticks(true_ns) - np.asarray(ticks_leader, dtype=np.float64)

    def skew(self, ticks_leader: Int | Float, half_span_ticks: float = 160_000.0) -> Float:
        """float64[n]: true follower rate over leader rate, minus one."""
        t = np.asarray(ticks_leader, dtype=np.float64)
        later = self.offset_ticks(t + half_span_ticks)
        earlier = self.offset_ticks(t - half_span_ticks)
        return (later - earlier) / (2.0 * half_span_ticks)

    def leader_ticks(self, ticks_follower: Int | Float) -> Float:
        """float64[n]: what the leader's TIMER reads when the follower's reads this."""
        return self.clocks["leader"].ticks(self.clocks["follower"].true_ns(ticks_follower))


def edges_local_us(model: ClockModel, t_ns_bench: Int) -> Int:
    """int64[n], sorted: edges in whole microseconds of the node's local time."""
    local = np.asarray(model.local_us(t_ns_bench.astype(np.float64) / 1e3), dtype=np.float64)
    return np.sort(np.rint(local).astype(np.int64))


def has_edge(edges_us: Int, at_us: Int, tolerance_us: int = 0) -> NDArray[np.bool_]:
    """bool[n]: whether a sorted edge list has an edge within the tolerance of each instant."""
    if edges_us.size == 0:
        return np.zeros(at_us.size, dtype=bool)
    after = np.searchsorted(edges_us, at_us - tolerance_us, side="left")
    inside = after < edges_us.size
    found = edges_us[np.minimum(after, edges_us.size - 1)]
    return inside & (found <= at_us + tolerance_us)


def _shares(edges_us: Int, captures_us: Int, shifts_us: Int) -> Float:
    """float64[k]: share of the captures that lie on an edge when shifted by each of ``shifts_us``.

    All shifts are looked up at once, block by block, in a table of the block's microseconds.
    """
    on_edge = np.zeros(shifts_us.size, dtype=np.int64)
    lowest, highest = int(shifts_us.min()), int(shifts_us.max())
    for block in np.split(captures_us, range(_BLOCK, captures_us.size, _BLOCK)):
        first, last = int(block[0]) + lowest, int(block[-1]) + highest
        shifted = block + shifts_us[:, np.newaxis]
        if last - first > _TABLE_US:
            on_edge += has_edge(edges_us, shifted.ravel()).reshape(shifted.shape).sum(axis=1)
            continue
        near = edges_us[slice(*np.searchsorted(edges_us, [first, last + 1]))]
        is_edge = np.zeros(last - first + 1, dtype=bool)
        is_edge[near - first] = True
        on_edge += is_edge[shifted - first].sum(axis=1)
    return on_edge / captures_us.size


def vote(edges_us: Int, captures_ticks: Int, upper_us: float) -> Vote | None:
    """Find the start of a TIMER: the shift that puts the most captures onto an edge.

    Args:
        edges_us: int64[n], sorted, END edges in local microseconds.
        captures_ticks: int64[m], END captures of the same node.
        upper_us: an upper bound of the start: no frame is seen before what it reports. The
            search goes from 3 s below to 0.2 s above.

    Returns:
        the winner, sound or not; ``None`` when there is nothing to vote.
    """
    captures_us = distinct(captures_ticks // TICKS_PER_US)
    if captures_us.size < 8 or edges_us.size < 8:
        return None
    rng = np.random.default_rng(0)
    sample = rng.choice(captures_us, size=min(_SAMPLE, captures_us.size), replace=False)
    lowest = np.searchsorted(edges_us, sample + upper_us - _BEFORE_US)
    highest = np.searchsorted(edges_us, sample + upper_us + _AFTER_US)
    differences = np.concatenate(
        [edges_us[a:b] - s for s, a, b in zip(sample, lowest, highest, strict=True)]
    )
    if differences.size == 0:
        return None
    candidates, votes = np.unique(differences, return_counts=True)
    best = candidates[np.argsort(votes)[::-1][:32]]
    shares = _shares(edges_us, captures_us, best)
    order = np.argsort(shares)[::-1]
    return Vote(
        t_start_us=int(best[order[0]]),
        share=float(shares[order[0]]),
        runner_up=float(shares[order[1]]) if order.size > 1 else 0.0,
        captures=int(captures_us.size),
    )
