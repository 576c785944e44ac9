# SPDX-License-Identifier: Apache-2.0
"""Batches of IMU samples: reading them, and accounting for every sample index.

Each batch says which sample comes first, when, and how far apart the samples are. That is enough
to find every lost, repeated or displaced sample without knowing what was measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.recording import Recording
from hil.streams import ROLES, frames, rows, seen_t_ns_bench, table
from hil.timesync.fit import trailing_lines
from hil.wire.codec import physical
from hil.wire.messages import IMU_FLAGS, TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]

WARM_UP_S: Final = 2.0
"""A node needs this long to measure the period that it reports."""
REST_MIN_TICKS: Final = TICK_RATE_HZ // 50
"""A sensor that has rested takes longer than this to give samples again."""
FIRST_INDEX_MAX: Final = 16
"""A stream that falls back to an index below this was started anew."""


@dataclass(frozen=True, eq=False)
class Batches:
    """Batches of one IMU in one serial stream, in the order of sending.

    Attributes:
        first, count: int64[n], index of the first sample, samples in the batch.
        t_first_ticks: int64[n], time of the first sample on the sender's clock.
        period_ticks: float64[n].
        flags: int64[n], bits of IMU_FLAGS.
        offset: int64[n], byte offset in the sender's stream.
        seen_t_ns_bench: int64[n].
        samples: int16[m, 6], gyro x y z, accel x y z, all batches one after the other.
    """

    first: Int
    count: Int
    t_first_ticks: Int
    period_ticks: Float
    flags: Int
    offset: Int
    seen_t_ns_bench: Int
    samples: NDArray[np.int16]

    def __len__(self) -> int:
        return int(self.first.size)

    @property
    def end(self) -> Int:
        """int64[n]: index after the last sample of each batch."""
        return self.first + self.count

    @property
    def sample_index(self) -> Int:
        """int64[m]: index of each row of ``samples``."""
        begins = np.cumsum(self.count) - self.count
        within = np.arange(int(self.count.sum())) - np.repeat(begins, self.count)
        return np.repeat(self.first, self.count) + within

    def has(self, flag: str) -> NDArray[np.bool_]:
        """bool[n]: batches with this flag of IMU_FLAGS set."""
        return np.asarray((self.flags & IMU_FLAGS[flag]) != 0, dtype=bool)


def batches(recording: Recording, sender: str, source: str) -> Batches:
    """The batches of ``source``'s IMU in the serial stream of ``sender``."""
    sent = frames(recording, sender, "imu_batch")
    samples = rows(recording, sender, "imu_batch")
    mine = sent["source"] == ROLES.index(source)
    samples = samples[mine[samples["row"]]] if sent.size else samples
    sent = sent[mine]
    return Batches(
        first=sent["sample_index"].astype(np.int64),
        count=sent["count"].astype(np.int64),
        t_first_ticks=sent["t_first_ticks_node"].astype(np.int64),
        period_ticks=physical(sent, "imu_batch", "period_ticks", table(recording, sender)),
        flags=sent["flags"].astype(np.int64),
        offset=sent["offset"].astype(np.int64),
        seen_t_ns_bench=seen_t_ns_bench(recording, sender, sent),
        samples=np.concatenate([samples["gyro_lsb"], samples["accel_lsb"]], axis=1),
    )


def starts(b: Batches) -> list[int]:
    """Rows at which the IMU was started anew, which lets its samples count from 0 again.

    Decimation filters may swallow the first few samples, and a link whole batches.
    """
    found: list[int] = []
    begin = int(b.first[0]) if len(b) else 0
    for row in (np.flatnonzero(np.diff(b.first) < 0) + 1).tolist():
        if b.first[row] < max(FIRST_INDEX_MAX, begin):
            begin = int(b.first[row])
            found.append(row)
    return found


def since_setup(b: Batches) -> Batches:
    """The batches after the last of :func:`starts`."""
    start = max(starts(b), default=0)
    columns = {f.name: getattr(b, f.name)[start:] for f in fields(b) if f.name != "samples"}
    return replace(b, **columns, samples=b.samples[int(b.count[:start].sum()) :])


def without_rests(b: Batches, rests: int) -> Batches:
    """The batches as if the sensor had never rested: over a rest samples count on, time does not.

    The ``rests`` longest pauses without a missing index are cut out of the times of all batches
    after them, so that the first batch after a pause comes when the one before it predicts.
    """
    row = _in_order(b)
    if rests <= 0 or row.size < 2:
        return b
    late = b.t_first_ticks[row[1:]] - _predicted_ticks(b, row)
    pause = np.where((b.end[row[:-1]] == b.first[row[1:]]) & (late > REST_MIN_TICKS), late, 0)
    kept = np.argsort(pause, kind="stable")[:-rests]
    pause[kept] = 0
    after = np.searchsorted(b.first[row[1:]], b.first, side="right")
    removed = np.concatenate([[0], np.cumsum(np.rint(pause).astype(np.int64))])[after]
    return replace(b, t_first_ticks=b.t_first_ticks - removed)


def _predicted_ticks(b: Batches, row: Int) -> Float:
    """float64[len(row) - 1]: when each batch says that the next one begins."""
    before = row[:-1]
    return np.asarray(b.t_first_ticks[before] + b.count[before] * b.period_ticks[before])


@dataclass(frozen=True)
class Continuity:
    """Samples that are not where they should be: counts.

    Attributes:
        lost: indices between the first and the last that no batch holds.
        duplicated: samples that an earlier batch already held.
        out_of_order: batches that came after a batch with later samples, and are no repeats.
    """

    lost: int
    duplicated: int
    out_of_order: int


def continuity(first: Int, count: Int) -> Continuity:
    """Account for every sample index of a stream of batches; int64[n] each, in sending order."""
    if first.size == 0:
        return Continuity(0, 0, 0)
    order = np.argsort(first, kind="stable")
    start, end = first[order], (first + count)[order]
    reach = np.maximum.accumulate(end)[:-1]
    step = start[1:] - reach
    overlap = np.minimum(end[1:], reach) - start[1:]
    late = np.append(False, first[1:] < np.maximum.accumulate(first)[:-1])
    _, first_seen = np.unique(first, return_index=True)
    repeat = np.ones(first.size, dtype=bool)
    repeat[first_seen] = False
    return Continuity(
        lost=int(np.sum(step[step > 0])),
        duplicated=int(np.sum(overlap[overlap > 0])),
        out_of_order=int(np.sum(late & ~repeat)),
    )


@dataclass(frozen=True)
class Delivery:
    """The leader's copy of the follower's samples against the follower's own stream."""

    missing: int
    altered: int
    compared: int


def delivery(own: Batches, copy: Batches, in_flight: int) -> Delivery:
    """Look every sample of ``own`` up in ``copy``, from the first sample that was delivered.

    Args:
        in_flight: samples at the end of ``own`` that need not have arrived yet.
    """
    own_index, own_row = np.unique(own.sample_index, return_index=True)
    copy_index, copy_row = np.unique(copy.sample_index, return_index=True)
    if copy_index.size == 0 or own_index.size == 0:
        return Delivery(int(own_index.size), 0, 0)
    due = (own_index >= copy_index[0]) & (own_index <= own_index[-1] - in_flight)
    missing = int(np.sum(~np.isin(own_index[due], copy_index, assume_unique=True)))
    _, a, b = np.intersect1d(own_index, copy_index, assume_unique=True, return_indices=True)
    differs = np.any(own.samples[own_row[a]] != copy.samples[copy_row[b]], axis=1)
    return Delivery(missing, int(np.sum(differs)), int(a.size))


def sample_period_ticks(b: Batches) -> float:
    """Sample period from the time stamps: slope of a line through all batches, in ticks."""
    timed = b.has("hardware_time")
    index, ticks = b.first[timed].astype(np.float64), b.t_first_ticks[timed].astype(np.float64)
    if index.size < 3 or np.ptp(index) == 0:
        return math.nan
    u = index - index.mean()
    return float(np.dot(u, ticks - ticks.mean()) / np.dot(u, u))


def _in_order(b: Batches) -> NDArray[np.int64]:
    """Rows with a hardware time, one per first index, ascending."""
    timed = np.flatnonzero(b.has("hardware_time"))
    _, at = np.unique(b.first[timed], return_index=True)
    return timed[at]


def period_error_ppm(b: Batches, rate_hz: float) -> Float:
    """float64[k]: each batch's period minus the slope of the last second, past warm-up."""
    row = _in_order(b)
    index = b.first[row].astype(np.float64)
    fit = trailing_lines(index, b.t_first_ticks[row].astype(np.float64), index, rate_hz)
    warm = b.t_first_ticks[row] >= b.t_first_ticks[row[0]] + WARM_UP_S * TICK_RATE_HZ
    use = warm & np.isfinite(fit.slope)
    error = (b.period_ticks[row] / fit.slope - 1.0)[use] * 1e6
    return np.asarray(error, dtype=np.float64)


def time_jitter_us(b: Batches) -> Float:
    """float64[k]: hardware time of a batch minus what the batch before it predicts."""
    row = _in_order(b)
    warm = b.t_first_ticks[row] >= b.t_first_ticks[row[:1]] + WARM_UP_S * TICK_RATE_HZ
    row = row[warm]
    adjacent = b.end[row[:-1]] == b.first[row[1:]]
    late_ticks = (b.t_first_ticks[row[1:]] - _predicted_ticks(b, row))[adjacent]
    return np.asarray(late_ticks / (TICK_RATE_HZ / 1e6), dtype=np.float64)


def matched(own: Batches, copy: Batches) -> tuple[Int, Int]:
    """Rows of ``own`` and ``copy`` that begin with the same sample."""
    a, b = np.unique(own.first, return_index=True), np.unique(copy.first, return_index=True)
    _, i, j = np.intersect1d(a[0], b[0], assume_unique=True, return_indices=True)
    return a[1][i], b[1][j]


def sample_rate_hz(b: Batches) -> tuple[Float, Float]:
    """Bench time in ns and sample rate over the last second, float64[k] each, in order of time."""
    row = _in_order(b)
    period = sample_period_ticks(b)
    if row.size < 3 or not period > 0:
        return np.zeros(0), np.zeros(0)
    index = b.first[row].astype(np.float64)
    fit = trailing_lines(
        index, b.t_first_ticks[row].astype(np.float64), index, TICK_RATE_HZ / period
    )
    seen = np.maximum.accumulate(b.seen_t_ns_bench[row]).astype(np.float64)
    use = np.isfinite(fit.slope) & (fit.slope > 0)
    return seen[use], np.asarray(TICK_RATE_HZ / fit.slope[use], dtype=np.float64)
