# SPDX-License-Identifier: Apache-2.0
"""The driver against the simulated chip itself: what it sampled, when, and how fast."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hil.budget import judged
from hil.imu.batches import WARM_UP_S, Batches, batches, since_setup
from hil.imu.chip import FifoStats, fifo_stats, has_chip
from hil.imu.correct import Correction, changed, correction, expected_counts
from hil.imu.tie import Tie, counts_bytes, tie
from hil.measure import Measurement
from hil.recording import ImuTruth, Recording
from hil.timesync.analysis import Sync
from hil.timesync.truth import NodeClock
from hil.wire.messages import TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]

_BLOCK: Final = 1 << 16
"""Samples that are compared at once."""
PERIOD_SPAN_S: Final = 0.5
"""The chip's true period is taken over so long, around the sample it is compared at."""
WORDS_PER_SLOT: Final = 2
BATCH_SAMPLES: Final = 16
"""What may wait in the driver to become a batch."""


@dataclass(frozen=True, eq=False)
class Compared:
    """One node's stream beside its chip.

    Attributes:
        b, stats: since the IMU was last started.
        timed: rows of ``b`` with a hardware time whose slot is known.
        slot_row: int64[len(timed)], their rows in ``truth``.
        correction: what the node did to the chip's counts; None for nothing.
    """

    truth: ImuTruth
    clock: NodeClock
    b: Batches
    stats: FifoStats
    tie: Tie
    timed: Int
    slot_row: Int
    correction: Correction | None = None


_KEPT: WeakKeyDictionary[Recording, dict[str, Compared | str]] = WeakKeyDictionary()


def compare(recording: Recording, role: str, sync: Sync) -> Compared | str:
    """The stream of ``role`` tied to its chip, or why that cannot be done. Kept."""
    kept = _KEPT.setdefault(recording, {})
    if role not in kept:
        kept[role] = _compare(recording, role, sync)
    return kept[role]


def _compare(recording: Recording, role: str, sync: Sync) -> Compared | str:
    if not sync.conditions.simulated:
        return f"source '{recording.provenance.source}' does not know what the chip sampled"
    if role not in recording.imu_truth:
        return f"the recording holds no truth of the {role}'s IMU"
    if not sync.truth:
        return f"the {role}'s true clock is not known: {sync.truth.why}"
    b = since_setup(batches(recording, role, role))
    stats = fifo_stats(recording, role).since_setup()
    truth, clock = recording.imu_truth[role], sync.truth.clocks[role]
    applied = correction(recording, role)
    found = tie(truth, clock, b, stats, applied)
    if found.start.size == 0:
        return f"no batch of the {role} has a hardware time that a slot of its chip is near to"
    timed = np.flatnonzero(b.has("hardware_time"))
    row = found.row(b.first[timed] * stats.decimation)
    return Compared(truth, clock, b, stats, found, timed[row >= 0], row[row >= 0], applied)


def measure(recording: Recording, role: str, sync: Sync) -> list[Measurement]:
    """Batch times, periods and samples of ``role`` against its chip."""
    if not has_chip(recording, role):
        return []
    c, prefix = sync.conditions, f"imu.{role}.truth"
    found = compare(recording, role, sync)
    if isinstance(found, str):
        value, how = (math.nan if c.simulated else None), f"not measured: {found}"
        return [
            judged(f"{prefix}_time_error_us", value, "I7", c, how),
            judged(f"{prefix}_period_error_ppm", value, "I8", c, how),
            judged(f"{prefix}_samples_wrong", value, "I1", c, how),
        ]
    result = [
        _largest(f"{prefix}_time_error_us", time_error_us(found), "I7", sync, "hardware times"),
        _largest(f"{prefix}_period_error_ppm", period_error_ppm(found), "I8", sync, "periods"),
    ]
    if changed(recording, role):
        how = "not compared: the calibration in force changed within the run"
        result.append(judged(f"{prefix}_samples_wrong", None, "I1", c, how))
    elif found.stats.decimation == 1:
        wrong, compared = samples_wrong(found)
        how = (
            f"{compared} streamed samples against the chip's counts of their slots, corrected as "
            "the calibration in force says"
        )
        result.append(judged(f"{prefix}_samples_wrong", float(wrong), "I1", c, how))
    return result


def _largest(name: str, error: Float, line: str, sync: Sync, what: str) -> Measurement:
    how = f"largest of {error.size} {what} in the batches, against the chip's own on the true clock"
    if error.size == 0:
        return judged(name, math.nan, line, sync.conditions, how)
    details = {"mean": float(np.mean(error)), "rms": float(np.sqrt(np.mean(error**2)))}
    value = float(np.max(np.abs(error)))
    return judged(name, value, line, sync.conditions, how, details=details)


def time_error_us(c: Compared) -> Float:
    """float64[k]: time of each batch's first sample minus the chip's, on the true clock."""
    t_us = c.clock.true_ns(c.b.t_first_ticks[c.timed]) / 1e3
    return np.asarray(t_us - c.truth.t_us_true[c.slot_row], dtype=np.float64)


def period_error_ppm(c: Compared) -> Float:
    """float64[k]: each batch's period against the chip's on the node's clock, past warm-up."""
    return period_errors(c)[1]


def period_errors(c: Compared) -> tuple[Float, Float]:
    """True time in us of each batch, and as :func:`period_error_ppm`; float64[k] each."""
    t = c.b.t_first_ticks[c.timed]
    run = c.truth.run[c.slot_row]
    begun = np.array([t[run == r].min() for r in run]) if len(np.unique(run)) > 1 else t[:1]
    warm = t >= begun + WARM_UP_S * TICK_RATE_HZ
    row, run = c.slot_row[warm], run[warm]
    if row.size == 0:
        return np.zeros(0), np.zeros(0)
    step_s = float(np.median(np.diff(c.truth.t_us_true))) / 1e6
    reach = max(1, round(0.5 * PERIOD_SPAN_S / step_s))
    first, last = np.maximum(row - reach, 0), np.minimum(row + reach, len(c.truth) - 1)
    whole = (c.truth.run[first] == run) & (c.truth.run[last] == run)
    row, first, last = row[whole], first[whole], last[whole]
    slots = c.truth.slot[last].astype(np.float64) - c.truth.slot[first]
    ticks = [c.clock.ticks(1e3 * c.truth.t_us_true[end]) for end in (first, last)]
    period = (ticks[1] - ticks[0]) / slots
    said = c.b.period_ticks[c.timed][warm][whole] / c.stats.decimation
    return c.truth.t_us_true[row], np.asarray((said / period - 1.0) * 1e6, dtype=np.float64)


def samples_wrong(c: Compared) -> tuple[int, int]:
    """Streamed samples that are not what the chip measured in their slots, corrected by the
    calibration in force; samples compared."""
    row = c.tie.row(c.b.sample_index)
    of_batch = np.repeat(np.arange(len(c.b)), c.b.count)
    wrong = 0
    for begin in range(0, row.size, _BLOCK):
        some = slice(begin, begin + _BLOCK)
        slots = c.truth.counts[np.maximum(row[some], 0)]
        wanted = expected_counts(c.b, of_batch[some], slots, c.correction)
        equal = np.all(c.b.samples[some] == wanted, axis=1) & (row[some] >= 0)
        wrong += int(np.sum(~equal))
    return wrong, int(row.size)


def measure_fifo(recording: Recording, role: str, sync: Sync) -> list[Measurement]:
    """Completeness at the full rate, also of a decimated stream: checksum and count of slots."""
    c, prefix = sync.conditions, f"fifo.{role}.truth"
    found = compare(recording, role, sync)
    if isinstance(found, str) or len(found.stats) == 0:
        reason = found if isinstance(found, str) else f"the {role} sent no fifo_stats"
        value, how = (math.nan if c.simulated else None), f"not measured: {reason}"
        return [
            judged(f"{prefix}_crc_mismatches", value, "I1", c, how),
            judged(f"{prefix}_slots_unread", value, "I1", c, how),
        ]
    return [_checksums(f"{prefix}_crc_mismatches", found, sync), _unread(prefix, found, sync)]


def _checksums(name: str, c: Compared, sync: Sync) -> Measurement:
    """The driver's checksum over all its samples against the chip's consecutive slots."""
    samples, said = c.stats.count("samples"), c.stats.count("samples_crc32")
    # Where samples are decimated, nobody says which raw index began the next run.
    several = c.stats.decimation > 1 and c.tie.start.size > 1
    use = samples <= int(c.tie.start[1]) if several else np.ones(samples.size, dtype=bool)
    crc, done, wrong = 0, 0, 0
    details: dict[str, Any] = {}
    for total, expected in zip(samples[use].tolist(), said[use].tolist(), strict=True):
        crc = zlib.crc32(counts_bytes(c.tie, c.truth, done, total), crc)
        done = total
        if crc != expected:
            wrong += 1
            details.setdefault("first_mismatch_after_samples", total)
    how = (
        f"{int(np.sum(use))} fifo_stats frames: checksum over up to {done} samples against the "
        "chip's own counts of as many consecutive slots"
    )
    return judged(name, float(wrong), "I1", sync.conditions, how, details=details)


def slots_waiting(c: Compared) -> tuple[Float, Int]:
    """Slots that the chip put into its FIFO and the driver has neither delivered nor dropped.

    Returns:
        true time in us of each ``fifo_stats`` frame since the first delivered sample, float64[n],
        and slots, int64[n]: those that wait in the FIFO or in the driver, and those that are lost.
    """
    stats = c.stats
    first_row = int(c.tie.row(np.zeros(1, dtype=np.int64))[0])
    began = int(np.argmax(stats.count("samples") > 0))
    until_us = np.asarray(c.clock.true_ns(stats.t_ticks[began:]) / 1e3, dtype=np.float64)
    mine = c.truth.has("in_fifo") & (np.arange(len(c.truth)) >= first_row)
    sampled = np.searchsorted(np.sort(c.truth.t_us_true[mine]), until_us, side="right")
    unsettled = stats.count("samples_unsettled")[began:]
    taken = stats.count("samples")[began:] + unsettled - unsettled[:1]
    return until_us, np.asarray(sampled - taken, dtype=np.int64)


def may_wait(stats: FifoStats) -> int:
    """Slots that may be waiting in a FIFO and in the driver without anything being wrong."""
    level = max(stats.last("level_max"), stats.last("watermark"))
    # A rest discards what the FIFO holds when it begins.
    return (int(level) // WORDS_PER_SLOT + BATCH_SAMPLES) * (1 + int(stats.last("wake_ups")))


def _unread(prefix: str, c: Compared, sync: Sync) -> Measurement:
    """Slots in the FIFO neither delivered, nor dropped as unsettled, nor possibly waiting."""
    waiting, allowed = int(slots_waiting(c)[1][-1]), may_wait(c.stats)
    delivered = int(c.stats.last("samples"))
    how = (
        f"{waiting} slots of the chip's FIFO from the first delivered to the last fifo_stats "
        f"frame are neither among the {delivered} delivered nor dropped as unsettled, less up to "
        f"{allowed} that may be waiting"
    )
    value = float(max(0, waiting - allowed))
    return judged(f"{prefix}_slots_unread", value, "I1", sync.conditions, how)
