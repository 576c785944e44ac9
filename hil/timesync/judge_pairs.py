# SPDX-License-Identifier: Apache-2.0
"""Measurements of the captures and pairs that the estimate is made from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hil.budget import judged
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, frames, seen_t_ns_bench
from hil.timesync.analysis import NS_PER_TICK, WRONG_PAIR_NS, Sync
from hil.timesync.judging import absent
from hil.timesync.ticks import breaks

STAMPS = {
    "sync_capture": ("tx_end_ticks_node", "rx_end_ticks_node"),
    "imu_batch": ("t_first_ticks_node",),
    "link_stats": ("t_ticks_node",),
    "system": ("t_ticks_node",),
}
"""Message -> fields that hold extended ticks of the sending node, in the order of time."""


def one_way_bias(sync: Sync) -> Measurement:
    """Leader to follower minus half the round trip, from the nodes' own captures."""
    one_way_ns = sync.pairs.one_way_ticks * NS_PER_TICK
    if one_way_ns.size == 0:
        how = "the two nodes have no capture of the same connection event"
        return judged("sync.one_way_bias_ns", math.nan, "B1", sync.conditions, how)
    median = float(np.median(one_way_ns))
    deviation = one_way_ns - median
    near = np.abs(deviation) < WRONG_PAIR_NS
    spread = float(np.std(one_way_ns[near]))
    error = spread / math.sqrt(int(np.sum(near)))
    return judged(
        "sync.one_way_bias_ns",
        float(np.mean(one_way_ns[near])),
        "B1",
        sync.conditions,
        f"mean of {int(np.sum(near))} pairs of the nodes' own captures; {int(np.sum(~near))} "
        "farther than 2 us from the median left out; chain delay of transmitter plus receiver",
        uncertainty=error,
        details={"median_ns": median, "std_ns": spread, "phy": sync.conditions.phy},
    )


def pair_bias(sync: Sync) -> Measurement:
    """Mean error of the two-way offset: what does not cancel."""
    near = np.abs(sync.pair_error_ns) < WRONG_PAIR_NS
    if not sync.truth or not np.any(near):
        value, how = absent(sync, "no pair near the truth")
        return judged("sync.pair_bias_ns", value, "B2", sync.conditions, how)
    error = sync.pair_error_ns[near]
    return judged(
        "sync.pair_bias_ns",
        float(np.mean(error)),
        "B2",
        sync.conditions,
        f"mean of {error.size} two-way offsets minus the true offset",
        uncertainty=float(np.std(error)) / math.sqrt(error.size),
        details={"std_ns": float(np.std(error)), "max_ns": float(np.max(np.abs(error)))},
    )


def pair_counts(sync: Sync) -> list[Measurement]:
    """Pairs used, dropped and wrong."""
    c, n = sync.conditions, len(sync.reported.pairs)
    used = int(np.sum(sync.reported.used))
    wrong = sync.reported_wrong
    from_what = "the truth" if sync.truth else "the line of its neighbours"
    details: dict[str, Any] = {
        "used": used,
        "dropped": n - used,
        "events": sync.events,
        "events_paired_here": len(sync.pairs),
        "repeated_captures": sum(own.repeated for own in sync.own.values()),
    }
    none = "the leader reported no pair"
    return [
        judged(
            "sync.pairs_used",
            float(used) if n else math.nan,
            "P2",
            c,
            f"pairs used of {sync.events} connection events; limit is a share of those"
            if n
            else none,
            scale=float(sync.events),
            details=details,
        ),
        judged(
            "sync.pairs_dropped_share",
            (n - used) / n if n else math.nan,
            "P3",
            c,
            f"{n - used} of {n} pairs dropped as outliers" if n else none,
        ),
        judged(
            "sync.pairs_wrong",
            float(np.sum(wrong)) if n else math.nan,
            "P1",
            c,
            f"of {n} pairs: stamps compared with the nodes' own captures of that event, offset "
            f"of used ones with {from_what} within 2 us"
            if n
            else none,
            details={
                "mismatched": int(np.sum(sync.agreement.mismatched)),
                "unverified": int(np.sum(sync.agreement.unverified)),
                "largest_used_error_ns": float(
                    np.max(np.abs(sync.reported_error_ns[sync.reported.used]), initial=0.0)
                ),
                "events": [int(k & 0xFFFFFFFF) for k in sync.reported.pairs.key[wrong][:20]],
            },
        ),
    ]


def captures_without_edge(sync: Sync) -> Measurement:
    """END captures that no END edge on the analyser confirms."""
    votes = sync.truth.votes
    if not votes:
        value, how = absent(sync, "no capture")
        return judged("sync.captures_without_edge", value, "P4", sync.conditions, how)
    missing = {role: round((1.0 - v.share) * v.captures) for role, v in votes.items()}
    return judged(
        "sync.captures_without_edge",
        float(sum(missing.values())),
        "P4",
        sync.conditions,
        f"{sum(v.captures for v in votes.values())} END captures looked up among the END edges, "
        "whole microseconds of the node's local time",
        details={
            **missing,
            **{f"{role}_t_start_us": v.t_start_us for role, v in votes.items()},
            **{f"{role}_runner_up": v.runner_up for role, v in votes.items()},
        },
    )


def wrap_errors(recording: Recording, sync: Sync) -> Measurement:
    """64-bit time stamps of both nodes: monotone, and continuous over each 32-bit wrap."""
    total, wraps, n = 0, 0, 0
    details: dict[str, Any] = {}
    for role in ROLES:
        for message, fields in STAMPS.items():
            sent = frames(recording, role, message)
            if message == "imu_batch":
                sent = sent[sent["source"] == ROLES.index(role)]
            seen = seen_t_ns_bench(recording, role, sent)
            for field in fields:
                found = breaks(sent[field].astype(np.int64), seen)
                # Batches out of order are the IMU suite's; here only a slip of a wrap counts.
                count = found.jumps if message == "imu_batch" else found.total
                total += count
                n += sent.size
                wraps = max(wraps, found.wraps)
                if count:
                    details[f"{role}.{message}.{field}"] = count
    if n == 0:
        how = "no time stamp in any stream"
        return judged("sync.wrap_errors", math.nan, "W1", sync.conditions, how)
    return judged(
        "sync.wrap_errors",
        float(total),
        "W1",
        sync.conditions,
        f"{n} time stamps in the order of sending against the bench clock, over {wraps} wrap(s) "
        "of the 32-bit counter",
        details={"wraps": wraps, **details},
    )


def reconnects(recording: Recording, sync: Sync) -> Measurement:
    """Connections beyond the first, less the disconnections that the run asked for."""
    generations = {role: np.unique(sync.own[role].key >> 32) for role in ROLES}
    planned = sum(event.kind in ("disconnect", "reset") for event in recording.events)
    count = max(int(g.size) for g in generations.values())
    if count == 0:
        how = "the nodes never connected"
        return judged("sync.reconnects", math.nan, "L1", sync.conditions, how)
    return judged(
        "sync.reconnects",
        float(max(0, count - 1 - planned)),
        "L1",
        sync.conditions,
        f"connections seen in the captures beyond the first, {planned} of them asked for",
        details={role: [int(x) for x in g] for role, g in generations.items()},
    )
