# SPDX-License-Identifier: Apache-2.0
"""Measurements of the scheduled pulses: exact ticks, analyser edges, completeness."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.budget import TICK_NS, judged
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, frames, seen_t_ns_bench
from hil.timesync.analysis import Sync
from hil.timesync.judging import absent, error_family, spread
from hil.timesync.pulses import (
    Common,
    EdgePairs,
    Pulses,
    common,
    edge_pairs,
    exact_error_ns,
    nearest,
)
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]
Int = NDArray[np.int64]

SIM_EDGE_GRID_NS = 1000.0
"""Resolution that budget line G1 already contains in simulation."""
EDGE_AT_COMPARE_NS = 10_000.0
"""An edge this close to the programmed COMPARE is that pulse, however badly timed."""


def pulse_errors(sync: Sync) -> list[Measurement]:
    """True time of the leader's COMPARE minus the follower's, pulse by pulse."""
    error_ns = settled_pulse_error_ns(sync)[1]
    how = (
        f"{error_ns.size} scheduled pulses while locked: programmed COMPARE of the leader minus "
        "the follower's, in exact ticks through the true clocks"
    )
    return error_family(sync, "sync.error", error_ns, how, "no pulse of both nodes while locked")


def settled_pulse_error_ns(sync: Sync) -> tuple[Int, Float]:
    """Leader ticks int64[n] and exact error float64[n] of the pulses of the settled spans."""
    pair = common(sync.pulses["leader"], sync.pulses["follower"])
    settled = sync.settled(pair.leader.scheduled_ticks_leader)
    pair = Common(pair.leader.take(settled), pair.follower.take(settled))
    error = exact_error_ns(pair, sync.truth) if sync.truth else np.zeros(0)
    return pair.leader.scheduled_ticks_leader, error


def _expected_pulses(sync: Sync) -> tuple[Int, float]:
    """Indices of the pulses due in the settled spans, and the period in ticks."""
    known = [p for p in sync.pulses.values() if len(p)]
    if not known or sync.models.until_ticks_leader.size == 0:
        return np.zeros(0, dtype=np.int64), math.nan
    longest = max(known, key=len)
    period = longest.period_ticks
    if not math.isfinite(period) or period <= 0:
        return np.zeros(0, dtype=np.int64), math.nan
    index0, t0 = longest.index[0], longest.scheduled_ticks_leader[0]
    # Frames of the last pulses may still be on their way when the run ends.
    end = sync.models.until_ticks_leader[-1] - max(2 * period, TICK_RATE_HZ)
    index = np.arange(index0, index0 + max(0, int((end - t0) / period)) + 1)
    due = t0 + (index - index0) * period
    return index[sync.settled(due) & (due <= end)], period


def pulse_counts(sync: Sync) -> list[Measurement]:
    """Pulses missing in the frames, or late."""
    c = sync.conditions
    expected, period = _expected_pulses(sync)
    if expected.size == 0:
        how = "no pulse was due: no schedule in the frames, or never locked"
        return [
            judged("sync.pulses_missing", math.nan, "P5", c, how),
            judged("sync.pulses_late", math.nan, "P5", c, how),
        ]
    late: dict[str, int] = {}
    missing: dict[str, int] = {}
    for role in ROLES:
        mine = sync.pulses[role]
        absent = ~np.isin(expected, mine.index)
        missing[role] = int(np.sum(absent))
        late[role] = int(np.sum(np.isin(mine.index[mine.late], expected)))
    how = (
        f"{expected.size} pulses due while locked, every {period / TICK_RATE_HZ:.3g} s; frames "
        "of both nodes"
    )
    return [
        judged("sync.pulses_missing", float(sum(missing.values())), "P5", c, how, details=missing),
        judged("sync.pulses_late", float(sum(late.values())), "P5", c, how, details=late),
    ]


def _edge_channel(recording: Recording, channel: str) -> Int | None:
    if channel not in recording.edges.channels:
        return None
    return recording.edges.select(channel)[0]


def edge_errors(recording: Recording, sync: Sync) -> list[Measurement]:
    """Pulse edges of the leader against the follower's, as the analyser saw them."""
    c = sync.conditions
    names = ("sync.edge_error_p99_ns", "sync.edge_error_max_ns", "sync.edges_alone")
    lines = ("G1", "G1", "P5")
    edges = [_edge_channel(recording, f"{role}.pulse") for role in ROLES]
    if edges[0] is None or edges[1] is None:
        value = math.nan if c.simulated else None
        how = "no analyser channel watched the pulse pins of both nodes"
        return [judged(n, value, line, c, how) for n, line in zip(names, lines, strict=True)]
    pairs = settled_edge_pairs(recording, sync)
    if pairs is None or pairs.difference_ns.size == 0:
        how = "no pulse edge of both nodes while locked"
        return [judged(n, math.nan, line, c, how) for n, line in zip(names, lines, strict=True)]
    found = pairs.difference_ns
    found_spread = spread(found)
    resolution = recording.edges.resolution_ns
    excess = max(0.0, resolution - SIM_EDGE_GRID_NS) if c.simulated else resolution
    how = (
        f"{found.size} pulses seen by the analyser on both nodes, leader minus follower, "
        f"resolution {resolution:g} ns"
    )
    details = {
        "mean_ns": float(np.mean(found)),
        "rms_ns": found_spread["rms"],
        "n": int(found.size),
    }
    return [
        judged(names[0], found_spread["p99"], "G1", c, how, uncertainty=excess, details=details),
        judged(names[1], found_spread["max"], "G1", c, how, uncertainty=excess, details=details),
        judged(names[2], float(pairs.alone), "P5", c, "edges of one node without one of the other"),
    ]


def settled_edge_pairs(recording: Recording, sync: Sync) -> EdgePairs | None:
    """Leading pulse edges of both nodes in the settled spans; None where nobody watched."""
    leader, follower = (_edge_channel(recording, f"{role}.pulse") for role in ROLES)
    expected, period = _expected_pulses(sync)
    if leader is None or follower is None or expected.size == 0:
        return None
    spans = bench_spans(recording, sync, max(2 * period, TICK_RATE_HZ))
    parts = [edge_pairs(leader, follower, period * TICK_NS, a, b) for a, b in spans]
    if not parts:
        return None
    return EdgePairs(
        np.concatenate([p.t_ns_bench for p in parts]),
        np.concatenate([p.difference_ns for p in parts]),
        sum(p.alone for p in parts),
    )


def bench_spans(recording: Recording, sync: Sync, margin_ticks: float) -> list[tuple[float, float]]:
    """The settled spans on the bench clock, ns, less a margin at their end."""
    sent = frames(recording, "leader", "sync_capture")
    if sent.size < 2:
        return []
    seen = seen_t_ns_bench(recording, "leader", sent).astype(np.float64)
    at = np.maximum(sent["tx_end_ticks_node"], sent["rx_end_ticks_node"]).astype(np.float64)
    # Frames arrive a little after what they report; the margins of the spans are far larger.
    slope, level = np.polyfit(at - at[0], seen - seen[0], 1)
    starts = sync.settled_from_ticks.astype(np.float64)
    ends = sync.settled_to_ticks.astype(np.float64) - margin_ticks
    to_ns = [seen[0] + level + slope * (t - at[0]) for t in (starts, ends)]
    return [(float(a), float(b)) for a, b in zip(*to_ns, strict=True) if b > a]


def compare_to_edge(recording: Recording, sync: Sync) -> Measurement:
    """Each pulse edge against the COMPARE that was programmed for it."""
    name = "sync.compare_to_edge_max_ns"
    if not sync.truth:
        value, how = absent(sync, "")
        return judged(name, value, "G2", sync.conditions, how)
    found = {role: edge_lateness_ns(recording, sync, role) for role in ROLES}
    for role, (_, late_ns) in found.items():
        if late_ns.size == 0:
            how = f"no pulse of the {role} while locked, or its pin was not watched"
            return judged(name, math.nan, "G2", sync.conditions, how)
    distance = {role: np.abs(late_ns) for role, (_, late_ns) in found.items()}
    worst = {role: float(np.max(apart)) for role, apart in distance.items()}
    without = sum(int(np.sum(apart > EDGE_AT_COMPARE_NS)) for apart in distance.values())
    n = sum(apart.size for apart in distance.values())
    return judged(
        name,
        max(worst.values()),
        "G2",
        sync.conditions,
        f"{n} pulses of both nodes while locked: nearest edge of the pulse pin to the true time "
        "of the programmed COMPARE",
        details={**worst, "without_edge": without},
    )


def edge_lateness_ns(recording: Recording, sync: Sync, role: str) -> tuple[Float, Float]:
    """True time in ns of each COMPARE of the settled spans, and how much later its edge came.

    float64[n] each; empty where the truth is not known or nobody watched the pin.
    """
    edges = _edge_channel(recording, f"{role}.pulse")
    if edges is None or not sync.truth:
        return np.zeros(0), np.zeros(0)
    mine = sync.pulses[role]
    mine = mine.take(sync.settled(mine.scheduled_ticks_leader) & ~mine.late)
    mine = _emitted_before_end(recording, sync, role, mine)
    at_ns = sync.truth.clocks[role].true_ns(mine.compare_ticks_node)
    return at_ns, nearest(edges, at_ns)


def _emitted_before_end(recording: Recording, sync: Sync, role: str, mine: Pulses) -> Pulses:
    """A pulse may be reported when programmed; one due after the end of the run has no edge."""
    t_ns = recording.edges.t_ns_bench
    end = float(t_ns[-1]) if t_ns.size else 0.0
    return mine.take(sync.truth.clocks[role].true_ns(mine.compare_ticks_node) < end)
