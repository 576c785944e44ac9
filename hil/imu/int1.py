# SPDX-License-Identifier: Apache-2.0
"""The interrupt line on the analyser against the batches: an outside witness of sample times.

INT1 rises when the sample that fills the FIFO up to its watermark is written, so each rising edge
falls on a sample instant. Which of the batches' instants is nearest is looked up on the node's own
clock. That clock is tied to the analyser's by the pulses: each has a programmed COMPARE in ticks
and an edge on the analyser. No truth is needed, so a real bench is judged in the same way.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import TICK_NS, judged
from hil.imu.batches import Batches, batches, since_setup
from hil.imu.chip import fifo_stats, has_chip
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import frames, seen_t_ns_bench
from hil.timesync.analysis import Sync
from hil.timesync.fit import trailing_lines
from hil.timesync.pulses import leading_edges, nearest
from hil.wire.messages import TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]

FIT_S: Final = 2.0
FIT_PULSES: Final = 5
"""The clocks are tied by the pulses of so long around an edge, and by so many."""
TICKS_PER_US: Final = TICK_RATE_HZ // 1_000_000
MIN_CAPTURES: Final = 8


def measure(recording: Recording, role: str, sync: Sync) -> list[Measurement]:
    """``imu.<role>.int1_error_p99_us``; nothing for a node whose samples come from no chip."""
    if not has_chip(recording, role):
        return []
    c, name = sync.conditions, f"imu.{role}.int1_error_p99_us"
    channel = f"{role}.imu_int1"
    if channel not in recording.edges.channels:
        how = f"no analyser channel watched INT1 of the {role}"
        return [judged(name, math.nan if c.simulated else None, "I9", c, how)]
    _, error_us = edge_errors_us(recording, role, sync)
    if error_us.size == 0:
        how = "no rising edge of INT1 between two pulses and within a batch with a hardware time"
        return [judged(name, math.nan, "I9", c, how)]
    return [
        judged(
            name,
            float(np.percentile(np.abs(error_us), 99)),
            "I9",
            c,
            f"{error_us.size} rising edges of INT1 on the analyser against the nearest sample "
            "instant of the batches, clocks tied by the pulses",
            uncertainty=0.0 if c.simulated else recording.edges.resolution_ns / 1e3,
            details={
                "mean_us": float(np.mean(error_us)),
                "max_us": float(np.max(np.abs(error_us))),
            },
        )
    ]


def rising_edges(recording: Recording, role: str, sync: Sync) -> tuple[Int, Float]:
    """INT1's rising edges whose instant on the node's clock is known: bench ns, and ticks.

    None where the channel was not captured.
    """
    channel = f"{role}.imu_int1"
    if channel not in recording.edges.channels:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    t_ns, level = recording.edges.select(channel)
    rising = t_ns[level == 1]
    at_ticks = node_ticks(recording, role, sync, rising)
    known = np.isfinite(at_ticks)
    return rising[known], at_ticks[known]


def edge_errors_us(recording: Recording, role: str, sync: Sync) -> tuple[Int, Float]:
    """Bench time in ns of INT1's rising edges, and each minus the nearest sample instant in us."""
    rising, at_ticks = rising_edges(recording, role, sync)
    b = since_setup(batches(recording, role, role))
    late = late_ticks(b, fifo_stats(recording, role).decimation, at_ticks)
    inside = np.isfinite(late)
    return rising[inside], np.asarray(late[inside] / TICKS_PER_US, dtype=np.float64)


def node_ticks(recording: Recording, role: str, sync: Sync, at_ns: Int) -> Float:
    """float64[n]: reading of the node's clock at instants of the bench clock, by the pulses.

    NaN before the first pulse, after the last, and where there are fewer than three around.
    """
    compare_ticks, edge_ns = _pulse_knots(recording, role, sync)
    if edge_ns.size < 3:
        return np.full(at_ns.shape, np.nan)
    at = np.asarray(at_ns, dtype=np.float64)
    ahead = 0.5 * max(1e9 * FIT_S, FIT_PULSES * float(np.median(np.diff(edge_ns))))
    fit = trailing_lines(edge_ns, compare_ticks, at + ahead, 2.0 * ahead)
    inside = (at >= edge_ns[0]) & (at <= edge_ns[-1])
    return np.where(inside, fit.value - fit.slope * ahead, np.nan)


def _pulse_knots(recording: Recording, role: str, sync: Sync) -> tuple[Float, Float]:
    """COMPARE in ticks and edge in ns of each of the node's pulses, ascending."""
    nothing = np.zeros(0), np.zeros(0)
    mine = sync.pulses[role].take(~sync.pulses[role].late)
    sent = frames(recording, role, "sync_capture")
    channel = f"{role}.pulse"
    if len(mine) < 3 or sent.size < MIN_CAPTURES or channel not in recording.edges.channels:
        return nothing
    # When frames are seen says to some ms which edge is which pulse; pulses are 100 ms apart.
    stamp = np.maximum(sent["tx_end_ticks_node"], sent["rx_end_ticks_node"]).astype(np.float64)
    seen = seen_t_ns_bench(recording, role, sent).astype(np.float64)
    slope = float(np.polyfit(stamp - stamp[0], seen - seen[0], 1)[0])
    level = float(np.percentile(seen - slope * stamp, 5))
    ticks = mine.compare_ticks_node.astype(np.float64)
    if sync.conditions.simulated:
        # The simulator's pin follows at the whole microsecond below.
        ticks -= ticks % TICKS_PER_US
    expected_ns = level + slope * ticks
    period_ns = mine.period_ticks * TICK_NS
    edges = leading_edges(recording.edges.select(channel)[0], period_ns)
    distance = nearest(edges, expected_ns)
    found = np.abs(distance) <= 0.25 * period_ns
    # `nearest` adds a difference to what it was given; whole ns come out as they went in.
    at_ns, first = np.unique(np.rint(expected_ns + distance)[found], return_index=True)
    return ticks[found][first], at_ns


def late_ticks(b: Batches, decimation: int, at_ticks: Float) -> Float:
    """float64[n]: instants of the node's clock minus the nearest sample instant of the batches.

    NaN for an instant within no batch that has a hardware time.
    """
    timed = np.flatnonzero(b.has("hardware_time"))
    order = timed[np.argsort(b.t_first_ticks[timed], kind="stable")]
    if order.size == 0:
        return np.full(at_ticks.shape, np.nan)
    begin = b.t_first_ticks[order].astype(np.float64)
    period = b.period_ticks[order] / decimation
    batch = np.searchsorted(begin - 0.5 * period, at_ticks, side="right") - 1
    held = np.maximum(batch, 0)
    sample = np.rint((at_ticks - begin[held]) / period[held])
    inside = (batch >= 0) & (sample < b.count[order][held] * decimation)
    return np.where(inside, at_ticks - begin[held] - sample * period[held], np.nan)


def latency_ms(recording: Recording, role: str, sync: Sync) -> tuple[Int, Float]:
    """From the rising edge of INT1 to the batch on the node's serial line.

    The edge of a batch is the first at or after its last sample, or, where the burst has already
    brought samples from after it, the last one before the frame.

    Returns:
        bench time of the frames in ns, int64[n] ascending, and latency in ms, float64[n].
    """
    rising, at_ticks = rising_edges(recording, role, sync)
    b = since_setup(batches(recording, role, role))
    timed = np.flatnonzero(b.has("hardware_time"))
    last_ticks = b.t_first_ticks[timed] + (b.count[timed] - 1) * b.period_ticks[timed]
    inside = np.zeros(0, dtype=bool)
    if rising.size:
        inside = (last_ticks >= at_ticks[0]) & (last_ticks <= at_ticks[-1])
    if not np.any(inside):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    timed, last_ticks = timed[inside], last_ticks[inside]
    seen = b.seen_t_ns_bench[timed]
    edge = np.searchsorted(at_ticks, last_ticks - 0.5 * b.period_ticks[timed])
    edge = np.minimum(edge, np.searchsorted(rising, seen, side="right") - 1)
    keep = edge >= 0
    order = np.argsort(seen[keep], kind="stable")
    late_ms = (seen[keep] - rising[edge[keep]]) / 1e6
    return seen[keep][order], np.asarray(late_ms[order], dtype=np.float64)
