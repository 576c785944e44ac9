# SPDX-License-Identifier: Apache-2.0
"""The analyser's clock beside the serial lines': by the pulses that the leader reports.

When a capture began is known on the host's clock within some 10 to 100 ms only. The leader tells
the tick of each of its pulses, and its frames tell when those ticks were, a few milliseconds late.
So each pulse is expected at a time, and the capture is moved until its pulses are there. Pulses
come at even distances: which one is which is told by where they begin and end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.recording import SerialStream
from hil.timesync.pulses import leading_edges, pulses
from hil.wire.codec import Decoded
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]
Int = NDArray[np.int64]

NEAR_NS: Final = 2_000_000.0
"""Pulses of one train agree within microseconds; the line through the frames, within this."""
LAG_NS: Final = 20_000_000.0
"""A frame is seen no later than this after what it reports, in the fastest case."""
LEAST: Final = 3
CAPTURES_MIN: Final = 8


@dataclass(frozen=True)
class Alignment:
    """How far a capture was moved.

    Attributes:
        shift_ns: to be added to the times of its edges.
        uncertainty_ns: of where it then is, on the host's clock.
        pulses: how many edges are where the leader's reports have them.
    """

    shift_ns: int
    uncertainty_ns: int
    pulses: int


def align(leader: SerialStream, said: Decoded, edge_ns: Int, uncertainty_ns: int) -> Alignment:
    """Move a capture to where the leader reports its pulses; not at all when it reports too few.

    Args:
        leader: its serial stream on the bench clock; ``said``: the same, decoded.
        edge_ns: int64[n], edges of ``leader.pulse`` on the bench clock as the host knows it.
        uncertainty_ns: of that.
    """
    expected_ns, period_ns = expected_pulses_ns(leader, said)
    edges = leading_edges(edge_ns, period_ns).astype(np.float64)
    stay = Alignment(0, uncertainty_ns, 0)
    if expected_ns.size < LEAST or edges.size < LEAST:
        return stay
    shifts = expected_ns[0] - edges
    shifts = shifts[np.abs(shifts) <= uncertainty_ns + LAG_NS]
    scores = [score(expected_ns, edges + shift, period_ns) for shift in shifts]
    if not scores or max(scores) < LEAST:
        return stay
    best = shifts[int(np.argmax(scores))]
    moved = edges + best
    near = moved[np.clip(np.searchsorted(moved, expected_ns - 0.5 * period_ns), 0, moved.size - 1)]
    beside = near - expected_ns
    beside = beside[np.abs(beside) <= NEAR_NS]
    shift = best - float(np.median(beside))
    return Alignment(round(shift), round(LAG_NS), int(beside.size))


def expected_pulses_ns(leader: SerialStream, said: Decoded) -> tuple[Float, float]:
    """float64[n]: when the leader's pulses were, by its own reports, and their period, ns."""
    made = pulses(said.messages["pulse"])
    made = made.take(~made.late)
    sent = said.messages["sync_capture"]
    if len(made) < LEAST or sent.size < CAPTURES_MIN:
        return np.zeros(0), 0.0
    stamp = np.maximum(sent["tx_end_ticks_node"], sent["rx_end_ticks_node"]).astype(np.float64)
    seen = leader.t_ns_bench(sent["offset"]).astype(np.float64)
    slope, level = np.polyfit(stamp - stamp[0], seen - seen[0], 1)
    late = seen - seen[0] - level - slope * (stamp - stamp[0])
    # The fastest frames are the ones that nothing has held up.
    level += float(np.percentile(late, 5))
    ticks = made.compare_ticks_node.astype(np.float64)
    expected = seen[0] + level + slope * (ticks - stamp[0])
    return expected, made.period_ticks * 1e9 / TICK_RATE_HZ


def score(expected_ns: Float, edges_ns: Float, period_ns: float) -> int:
    """Pulses that have an edge, less edges within the train that are no reported pulse."""
    span = edges_ns[
        (edges_ns > expected_ns[0] - 1.5 * period_ns)
        & (edges_ns < expected_ns[-1] + 0.5 * period_ns)
    ]
    if span.size == 0:
        return 0
    after = np.clip(np.searchsorted(expected_ns, span), 1, expected_ns.size - 1)
    distance = np.minimum(np.abs(span - expected_ns[after - 1]), np.abs(span - expected_ns[after]))
    found = int(np.sum(distance <= NEAR_NS))
    return found - int(span.size - found)
