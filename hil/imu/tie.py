# SPDX-License-Identifier: Apache-2.0
"""Which slot of the simulated chip is which sample of the stream.

Symbols: J index of a streamed sample, f decimation, i = J f raw index, s slot of a run. Within a
run, s - i is one constant. It is found by a vote: each batch with a hardware time names the slot
that is nearest to it in true time. Times could agree on a neighbour, so the samples themselves, or
where they are decimated the driver's checksum, have the last word among the slots around.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.imu.batches import Batches
from hil.imu.chip import FifoStats
from hil.imu.correct import Correction, expected_counts
from hil.recording import ImuTruth
from hil.timesync.truth import NodeClock

Int = NDArray[np.int64]
Float = NDArray[np.float64]

NEIGHBOURS: Final = (0, *(sign * k for k in range(1, 9) for sign in (1, -1)))
"""By how many slots a vote may be corrected, in the order of trying."""
SAMPLED: Final = 64
"""Batches of a run that are compared with the chip's counts to do so."""


@dataclass(frozen=True, eq=False)
class Tie:
    """Raw index -> row of the chip's truth.

    Attributes:
        start: int64[k], ascending, raw index from which on each span holds.
        run, shift: int64[k], run of the chip, and slot minus raw index, of each span.
        key: int64[n], ascending: run << 32 | slot of each row of the truth.
    """

    start: Int
    run: Int
    shift: Int
    key: Int

    def row(self, raw: Int) -> Int:
        """int64[m]: row of each raw index; -1 where the truth has no such slot."""
        if self.start.size == 0 or self.key.size == 0:
            return np.full(raw.shape, -1, dtype=np.int64)
        span = np.maximum(np.searchsorted(self.start, raw, side="right") - 1, 0)
        wanted = (self.run[span] << 32) | (raw + self.shift[span])
        at = np.minimum(np.searchsorted(self.key, wanted), self.key.size - 1)
        return np.where(self.key[at] == wanted, at, -1)


def tie(
    truth: ImuTruth,
    clock: NodeClock,
    b: Batches,
    stats: FifoStats,
    correction: Correction | None = None,
) -> Tie:
    """Find the spans; empty where no batch has a hardware time.

    Args:
        b, stats: of one start of the IMU.
        correction: what the node did to the chip's counts.
    """
    key = (truth.run.astype(np.int64) << 32) | truth.slot.astype(np.int64)
    nothing = np.zeros(0, dtype=np.int64)
    timed = b.has("hardware_time")
    if len(truth) == 0 or not np.any(timed) or np.any(np.diff(key) <= 0):
        return Tie(nothing, nothing, nothing, key)
    raw = b.first * stats.decimation
    row = _nearest_row(truth.t_us_true, clock.true_ns(b.t_first_ticks) / 1e3)
    run = truth.run[row].astype(np.int64)
    shift = truth.slot[row].astype(np.int64) - raw
    spans = []
    for number in np.unique(run[timed]):
        votes, count = np.unique(shift[timed & (run == number)], return_counts=True)
        spans.append((int(raw[run == number].min()), int(number), int(votes[np.argmax(count)])))
    start, runs, shifts = np.array(sorted(spans), dtype=np.int64).T
    return _refined(Tie(start, runs, shifts, key), truth, b, stats, correction)


def _nearest_row(t_us: Float, at_us: Float) -> Int:
    after = np.clip(np.searchsorted(t_us, at_us), 1, max(t_us.size - 1, 1))
    before_is_nearer = at_us - t_us[after - 1] < t_us[np.minimum(after, t_us.size - 1)] - at_us
    return np.asarray(np.minimum(after - before_is_nearer, t_us.size - 1), dtype=np.int64)


def _refined(
    voted: Tie, truth: ImuTruth, b: Batches, stats: FifoStats, correction: Correction | None
) -> Tie:
    shift = voted.shift.copy()
    for k in range(shift.size):
        scores = []
        for step in NEIGHBOURS:
            tried = shift.copy()
            tried[k] += step
            candidate = replace(voted, shift=tried)
            if stats.decimation == 1:
                scores.append(_agreeing(candidate, k, truth, b, correction))
            else:
                scores.append(_checksum_fits(candidate, k, truth, stats))
        # The first of equals: the vote itself, or else the nearest.
        shift[k] += NEIGHBOURS[int(np.argmax(scores))]
    return replace(voted, shift=shift)


def _agreeing(
    candidate: Tie, k: int, truth: ImuTruth, b: Batches, correction: Correction | None
) -> int:
    """How many samples of span ``k``, in some of its batches, are the chip's."""
    end = candidate.start[k + 1] if k + 1 < candidate.start.size else np.iinfo(np.int64).max
    mine = np.flatnonzero((b.first >= candidate.start[k]) & (b.first < end))
    chosen = mine[np.linspace(0, mine.size - 1, min(SAMPLED, mine.size)).astype(np.int64)]
    begins = np.cumsum(b.count) - b.count
    rows_of_first = candidate.row(b.first[chosen])
    wanted = expected_counts(b, chosen, truth.counts[rows_of_first], correction)
    equal = np.all(b.samples[begins[chosen]] == wanted, axis=1)
    return int(np.sum(equal & (rows_of_first >= 0)))


def _checksum_fits(candidate: Tie, k: int, truth: ImuTruth, stats: FifoStats) -> int:
    """1 when the first checksum is that of the chip's counts. Only the first span has it."""
    samples = stats.count("samples")
    counted = np.flatnonzero(samples > 0)
    if k > 0 or counted.size == 0:
        return 0
    first = int(counted[0])
    data = counts_bytes(candidate, truth, 0, int(samples[first]))
    return int(zlib.crc32(data) == int(stats.raw["samples_crc32"][first]))


def counts_bytes(t: Tie, truth: ImuTruth, begin: int, end: int) -> bytes:
    """The chip's counts of raw indices [begin, end), as the driver's checksum takes them."""
    rows = t.row(np.arange(begin, end, dtype=np.int64))
    known = truth.counts[np.maximum(rows, 0)] if len(truth) else np.zeros((rows.size, 6), np.int16)
    return np.where((rows >= 0)[:, None], known, 0).astype("<i2").tobytes()
