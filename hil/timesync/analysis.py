# SPDX-License-Identifier: Apache-2.0
"""Everything about the sync of one recording, computed once and then judged or drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hil.budget import WINDOW_S, Conditions
from hil.recording import Recording
from hil.streams import ROLES, conditions, frames, hold_s, seen_t_ns_bench, table
from hil.timesync.fit import Lines, deviations, trailing_lines
from hil.timesync.model import Models, Progress, models, progress
from hil.timesync.pairs import Agreement, Captures, Pairs, Reported, captures, compare, join
from hil.timesync.pairs import reported as read_reported
from hil.timesync.pulses import Pulses, pulses
from hil.timesync.ticks import distinct
from hil.timesync.truth import TICKS_PER_US, NodeClock, Truth, Vote, edges_local_us, vote
from hil.wire.messages import TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

NS_PER_TICK: Final = 1e9 / TICK_RATE_HZ
WRONG_PAIR_NS: Final = 2000.0
"""A pair whose offset is farther off than this belongs to another packet (budget line P1)."""
SETTLE_S: Final = 2.0
"""After a lock, the follower may still be waiting for the first planned pulse."""


@dataclass(frozen=True, eq=False)
class Sync:
    """The sync of one recording.

    Attributes:
        own: role -> that node's captures; ``pairs``: both joined by connection event.
        pair_error_ns: float64[len(pairs)], offset minus truth, or minus its neighbours' line
            where the truth is not known.
        reported: the leader's pairs; ``agreement``: held against ``own``;
            ``reported_error_ns``: as ``pair_error_ns``.
        refit: independent fit at each model's "now".
        events: connection events that took place, by either node's counter.
        settled_from_ticks, settled_to_ticks: int64[k], spans of the leader's clock in which the
            model had been locked for :data:`SETTLE_S`.
    """

    conditions: Conditions
    truth: Truth
    own: dict[str, Captures]
    pairs: Pairs
    pair_error_ns: Float
    reported: Reported
    agreement: Agreement
    reported_error_ns: Float
    leader_clock: Progress
    away_ticks_leader: Int
    models: Models
    refit: Lines
    pulses: dict[str, Pulses]
    events: int
    settled_from_ticks: Int
    settled_to_ticks: Int

    @property
    def reported_wrong(self) -> Mask:
        """bool[n]: the leader's pairs that are not what they claim, or misled the estimate."""
        off = np.abs(self.reported_error_ns) > WRONG_PAIR_NS
        return self.agreement.mismatched | (self.reported.used & off)

    def refit_offset(self, ticks_leader: Float) -> Float:
        """float64[m]: offset in ticks by the latest independent fit; NaN where there is none."""
        row = self.models.row_in_use(ticks_leader)
        if len(self.models) == 0:
            return np.full(ticks_leader.shape, np.nan)
        span = ticks_leader - self.models.now_ticks_leader[row]
        value = self.refit.value[row] + self.refit.slope[row] * span
        return np.asarray(np.where(row >= 0, value, np.nan), dtype=np.float64)

    def settled(self, ticks_leader: Int | Float) -> Mask:
        """bool[m]: whether the model was locked, and had been for a while."""
        span = np.searchsorted(self.settled_from_ticks, ticks_leader, side="right") - 1
        if self.settled_from_ticks.size == 0:
            return np.zeros(np.shape(ticks_leader), dtype=bool)
        return (span >= 0) & (ticks_leader < self.settled_to_ticks[np.maximum(span, 0)])


_KEPT: WeakKeyDictionary[Recording, Sync] = WeakKeyDictionary()


def analyse(recording: Recording) -> Sync:
    """The sync of ``recording``; empty streams give empty results, never an error.

    A recording never changes, so its analysis is kept for as long as it lives.
    """
    kept = _KEPT.get(recording)
    if kept is None:
        kept = _KEPT[recording] = _analyse(recording)
    return kept


def away(recording: Recording, clock: Progress) -> Int:
    """int64[k, 2]: from and to, in leader ticks, of each hold that the run asked for, in order."""
    asked_ns = sorted(
        (float(event.t_ns_bench), event.t_ns_bench + hold_s(event) * 1e9)
        for event in recording.events
        if hold_s(event) > 0
    )
    if not asked_ns or clock.offset.size == 0:
        return np.zeros((0, 2), dtype=np.int64)
    seen_ns = recording.serial["leader"].t_ns_bench(clock.offset)
    ticks = np.interp(np.array(asked_ns), seen_ns, clock.ticks_leader)
    return np.asarray(np.rint(ticks), dtype=np.int64)


def _analyse(recording: Recording) -> Sync:
    own = {role: captures(frames(recording, role, "sync_capture")) for role in ROLES}
    truth = locate(recording)
    pairs = join(own["leader"], own["follower"])
    reported = read_reported(frames(recording, "leader", "sync_pair"))
    clock = progress(
        frames(recording, "leader", "sync_capture"),
        (frames(recording, "leader", "link_stats"), frames(recording, "leader", "system")),
    )
    m = models(frames(recording, "leader", "sync_state"), clock, table(recording, "leader"))
    pair_error_ns = offset_error_ns(pairs, truth)
    settled_from, settled_to = settled_spans(m)
    return Sync(
        conditions=conditions(recording),
        truth=truth,
        own=own,
        pairs=pairs,
        pair_error_ns=pair_error_ns,
        reported=reported,
        agreement=compare(reported.pairs, own["leader"], own["follower"]),
        reported_error_ns=offset_error_ns(reported.pairs, truth),
        leader_clock=clock,
        away_ticks_leader=away(recording, clock),
        models=m,
        refit=refit(pairs, pair_error_ns, m),
        pulses={role: pulses(frames(recording, role, "pulse")) for role in ROLES},
        events=count_events(own),
        settled_from_ticks=settled_from,
        settled_to_ticks=settled_to,
    )


def locate(recording: Recording) -> Truth:
    """Both nodes' true clocks, with the start of each TIMER voted from captures and END edges."""
    crystals = recording.truth
    source = recording.provenance.source
    if not crystals:
        return Truth({}, {}, f"source '{source}' does not know the crystals' true time", False)
    votes: dict[str, Vote] = {}
    for role in ROLES:
        found = _vote_for(recording, role)
        if found is None:
            why = f"no END capture of the {role} could be matched with an END edge"
            return Truth({}, votes, why, True)
        votes[role] = found
        if not found.sound:
            why = (
                f"the start of the {role}'s TIMER is not certain: {found.share:.1%} of "
                f"{found.captures} END captures lie on an edge, the next best start has "
                f"{found.runner_up:.1%}"
            )
            return Truth({}, votes, why, True)
    clocks = {role: NodeClock(crystals[role], votes[role].t_start_us) for role in ROLES}
    return Truth(clocks, votes, "", True)


def _vote_for(recording: Recording, role: str) -> Vote | None:
    sent = frames(recording, role, "sync_capture")
    channel = f"{role}.radio_end"
    if sent.size == 0 or channel not in recording.edges.channels:
        return None
    crystal = recording.truth[role]
    tx = sent["tx_end_ticks_node"].astype(np.int64)
    rx = sent["rx_end_ticks_node"].astype(np.int64)
    seen_us = crystal.local_us(seen_t_ns_bench(recording, role, sent) / 1e3)
    # A low percentile, not the minimum: one bad stamp must not move the search.
    upper_us = float(np.percentile(seen_us - np.maximum(tx, rx) / TICKS_PER_US, 5))
    edges_us = edges_local_us(crystal, recording.edges.select(channel)[0])
    return vote(edges_us, np.concatenate([tx, rx]), upper_us)


def offset_error_ns(pairs: Pairs, truth: Truth) -> Float:
    """float64[n]: each pair's offset minus the truth, or minus the line of its neighbours."""
    if truth:
        return (pairs.offset_ticks - truth.offset_ticks(pairs.t_ticks_leader)) * NS_PER_TICK
    return deviations(pairs.t_ticks_leader, pairs.offset_ticks) * NS_PER_TICK


def refit(pairs: Pairs, pair_error_ns: Float, m: Models) -> Lines:
    """Offset and skew at each model's "now", from the nodes' own captures up to then."""
    sound = pairs.take(np.abs(pair_error_ns) <= WRONG_PAIR_NS)
    order = np.argsort(sound.t_ticks_leader, kind="stable")
    given_us = m.window_us[m.locked & (m.window_us > 0)]
    window_s = float(np.median(given_us)) / 1e6 if given_us.size else WINDOW_S
    return trailing_lines(
        sound.t_ticks_leader[order],
        sound.offset_ticks[order],
        m.now_ticks_leader.astype(np.float64),
        window_s * TICK_RATE_HZ,
    )


def count_events(own: dict[str, Captures]) -> int:
    """Connection events between the first and last that either node captured, per connection."""
    keys = distinct(np.concatenate([c.key for c in own.values()]))
    if keys.size == 0:
        return 0
    generation = keys >> 32
    first = np.append(True, generation[1:] != generation[:-1])
    last = np.append(first[1:], True)
    return int(np.sum(keys[last] - keys[first] + 1))


def settled_spans(m: Models) -> tuple[Int, Int]:
    """Start and end, leader ticks, of each span locked throughout, less its first 2 s."""
    locked = m.locked
    if not np.any(locked):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    broken = np.append(True, m.generation[1:] != m.generation[:-1])
    begins = locked & (np.append(True, ~locked[:-1]) | broken)
    ends = locked & (np.append(~locked[1:], True) | np.append(broken[1:], True))
    start = m.now_ticks_leader[begins] + int(SETTLE_S * TICK_RATE_HZ)
    end = m.until_ticks_leader[ends]
    keep = end > start
    return start[keep], end[keep]
