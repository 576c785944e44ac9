# SPDX-License-Identifier: Apache-2.0
"""A stream tied to its chip: right slots, times, periods and checksums, also where it is hard."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hil import timesync
from hil.imu import truth as against
from hil.imu.batches import Batches, since_setup, starts
from hil.imu.chip import FifoStats
from hil.imu.tie import counts_bytes, tie
from hil.imu.truth import Compared
from hil.measure import Verdict
from hil.recording import ClockModel, ImuTruth
from hil.synthesis import Plan, synthesise
from hil.timesync.truth import NodeClock
from hil.wire.messages import BY_NAME, IMU_FLAGS
from hil.wire.records import record_type

CLOCK = NodeClock(ClockModel(drift=20e-6, start_offset_us=1000.0), 500.0)
BATCH = 8
RATE_HZ = 1553.4
UNSETTLED = 30
HARDWARE = IMU_FLAGS["hardware_time"]


def chip(slots: int = 8000, run: int = 3, start_us: float = 2e5, seed: int = 1) -> ImuTruth:
    """Noisy counts, all in the FIFO."""
    rng = np.random.default_rng(seed)
    return ImuTruth(
        run=np.full(slots, run, np.uint32),
        slot=np.arange(slots, dtype=np.uint32),
        t_us_true=start_us + np.arange(slots) * (1e6 / RATE_HZ),
        counts=rng.normal(0, 300, (slots, 6)).astype(np.int16),
        flags=np.full(slots, 11, np.uint8),
    )


def joined(*parts: ImuTruth) -> ImuTruth:
    names = ("run", "slot", "t_us_true", "counts", "flags")
    return ImuTruth(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def stream(t: ImuTruth, first_row: int = UNSETTLED, decimation: int = 1) -> Batches:
    """What a perfect driver sends: batches from ``first_row`` on, times in whole ticks."""
    rows = np.arange(first_row, len(t), decimation)
    rows = rows[: rows.size // BATCH * BATCH]
    ticks = CLOCK.ticks(1e3 * t.t_us_true[rows])
    n = rows.size // BATCH
    index = np.arange(rows.size, dtype=np.int64)[::BATCH]
    period = 1e6 / RATE_HZ * 16 * (1 + 20e-6) * decimation
    return Batches(
        first=index,
        count=np.full(n, BATCH, np.int64),
        t_first_ticks=np.rint(ticks[::BATCH]).astype(np.int64),
        period_ticks=np.full(n, np.rint(period * 256) / 256),
        flags=np.full(n, HARDWARE, np.int64),
        offset=np.arange(n, dtype=np.int64),
        seen_t_ns_bench=np.rint(t.t_us_true[rows[BATCH - 1 :: BATCH]] * 1e3).astype(np.int64),
        samples=t.counts[rows].copy(),
    )


def stats(t: ImuTruth, first_row: int = UNSETTLED, decimation: int = 1, **last: int) -> FifoStats:
    """A frame every 1000 slots; ``last`` changes the last one."""
    at = np.arange(1500, len(t), 1000)
    raw = np.zeros(at.size, record_type(BY_NAME["fifo_stats"]))
    raw["t_ticks_node"] = CLOCK.ticks(1e3 * t.t_us_true[at])
    raw["samples"] = at - first_row
    raw["samples_crc32"] = [zlib.crc32(t.counts[first_row:end].tobytes()) for end in at]
    raw["watermark"] = raw["level_max"] = 2 * BATCH
    for name, value in last.items():
        raw[name][-1] = value
    ticks = raw["t_ticks_node"].astype(np.int64)
    return FifoStats(raw, ticks, np.rint(1e3 * t.t_us_true[at]).astype(np.int64), 1667, decimation)


def compared(t: ImuTruth, b: Batches, s: FifoStats) -> Compared:
    found = tie(t, CLOCK, b, s)
    timed = np.flatnonzero(b.has("hardware_time"))
    row = found.row(b.first[timed] * s.decimation)
    return Compared(t, CLOCK, b, s, found, timed[row >= 0], row[row >= 0])


SYNC = timesync.analyse(synthesise(Plan(duration_s=4.0)))


def checksums(c: Compared) -> float | None:
    return against._checksums("fifo.x.truth_crc_mismatches", c, SYNC).value


def unread(c: Compared) -> float | None:
    return against._unread("fifo.x.truth", c, SYNC).value


@pytest.mark.parametrize("decimation", [1, 2, 8])
def test_a_perfect_stream_is_perfect(decimation: int) -> None:
    t = chip()
    c = compared(t, stream(t, decimation=decimation), stats(t, decimation=decimation))
    assert c.tie.shift.tolist() == [UNSETTLED]
    assert np.max(np.abs(against.time_error_us(c))) < 0.04
    assert np.max(np.abs(against.period_error_ppm(c))) < 0.2
    assert checksums(c) == 0
    assert unread(c) == 0
    if decimation == 1:
        assert against.samples_wrong(c) == (0, c.b.samples.shape[0])


@pytest.mark.parametrize("decimation", [1, 4])
@pytest.mark.parametrize("periods", [-3, -1, 1, 2])
def test_times_off_by_whole_periods_are_not_believed(decimation: int, periods: int) -> None:
    """Every batch names a neighbour of its slot: samples or checksum tell which is meant."""
    t = chip()
    b = stream(t, decimation=decimation)
    shift_ticks = round(periods * 16e6 / RATE_HZ * (1 + 20e-6))
    late = replace(b, t_first_ticks=b.t_first_ticks + shift_ticks)
    c = compared(t, late, stats(t, decimation=decimation))
    assert c.tie.shift.tolist() == [UNSETTLED]
    error_us = against.time_error_us(c)
    assert np.median(error_us) == pytest.approx(periods * 1e6 / RATE_HZ, abs=0.1)
    assert checksums(c) == 0


def test_a_still_sensor_is_tied_by_time_alone() -> None:
    t = chip()
    t = replace(t, counts=np.zeros_like(t.counts))
    c = compared(t, stream(t), stats(t))
    assert c.tie.shift.tolist() == [UNSETTLED]
    assert np.max(np.abs(against.time_error_us(c))) < 0.04


def test_one_late_batch_is_the_largest_error() -> None:
    t = chip()
    b = stream(t)
    b.t_first_ticks[400] += 32
    c = compared(t, b, stats(t))
    assert np.max(np.abs(against.time_error_us(c))) == pytest.approx(2.0, abs=0.04)


def test_a_batch_without_a_hardware_time_claims_none() -> None:
    t = chip()
    b = stream(t)
    b.t_first_ticks[400] += 32
    b.flags[400] = 0
    c = compared(t, b, stats(t))
    assert np.max(np.abs(against.time_error_us(c))) < 0.04
    assert against.samples_wrong(c)[0] == 0


def test_the_reported_period_is_held_against_the_chips_drift() -> None:
    """A chip that speeds up by 100 ppm: the period of the start is wrong at the end."""
    t = chip(20_000)
    s = (t.t_us_true - t.t_us_true[0]) / 1e6
    bent = replace(t, t_us_true=t.t_us_true[0] + 1e6 * (s - 0.5 * 100e-6 * s**2 / s[-1]))
    c = compared(bent, stream(bent), stats(bent))
    error = against.period_error_ppm(c)
    # The first samples that count are 2 s after the start, of 12.9 s.
    assert error[0] == pytest.approx(100 * 2.2 / s[-1], abs=2)
    assert error[-1] == pytest.approx(100, abs=3)


def test_a_rest_ends_one_run_and_begins_another() -> None:
    first, second = chip(4000, run=3), chip(4000, run=4, start_us=8e6, seed=2)
    t = joined(first, second)
    a, b = stream(first), stream(second)
    end = int(a.end[-1])
    columns = {
        name: np.concatenate([getattr(a, name), getattr(b, name)])
        for name in ("count", "t_first_ticks", "period_ticks", "flags", "offset", "samples")
    }
    both = replace(
        a,
        first=np.concatenate([a.first, b.first + end]),
        seen_t_ns_bench=np.concatenate([a.seen_t_ns_bench, b.seen_t_ns_bench]),
        **columns,
    )
    c = compared(t, both, stats(first))
    assert c.tie.run.tolist() == [3, 4]
    assert c.tie.start.tolist() == [0, end]
    assert c.tie.shift.tolist() == [UNSETTLED, UNSETTLED - end]
    assert against.samples_wrong(c) == (0, both.samples.shape[0])
    assert np.max(np.abs(against.time_error_us(c))) < 0.04
    assert np.max(np.abs(against.period_error_ppm(c))) < 0.2
    data = counts_bytes(c.tie, t, end - 1, end + 1)
    last, begun = first.counts[UNSETTLED + end - 1], second.counts[UNSETTLED]
    assert data == last.tobytes() + begun.tobytes()


def test_slots_that_the_truth_does_not_hold_are_wrong() -> None:
    t = chip()
    cut = ImuTruth(*(getattr(t, n)[:6000] for n in ("run", "slot", "t_us_true", "counts", "flags")))
    c = compared(cut, stream(t), stats(cut))
    wrong, total = against.samples_wrong(c)
    assert wrong == total - (6000 - UNSETTLED)


def test_nothing_to_tie() -> None:
    t = chip()
    silent = replace(stream(t), flags=np.zeros(stream(t).first.size, np.int64))
    found = tie(t, CLOCK, silent, stats(t))
    assert found.start.size == 0
    assert found.row(np.arange(5)).tolist() == [-1] * 5


def change(name: str, by: int) -> dict[str, int]:
    return {name: int(stats(chip()).raw[name][-1]) + by}


@pytest.mark.parametrize(
    ("last", "mismatches", "missing"),
    [
        (change("samples_crc32", 1), 1, 0),
        (change("samples", -40), 1, 40 - 16 - BATCH),
        (change("samples", 1), 1, 0),
        (change("samples_unsettled", 0), 0, 0),
    ],
)
def test_counters_that_do_not_add_up(last: dict[str, int], mismatches: int, missing: int) -> None:
    t = chip()
    c = compared(t, stream(t), stats(t, **last))
    assert checksums(c) == mismatches
    # The frame is taken at the instant of a slot, which is one more than was delivered by then.
    assert unread(c) == pytest.approx(missing, abs=1)


def test_slots_outside_the_fifo_need_not_be_read() -> None:
    t = chip()
    flags = t.flags.copy()
    flags[4000:4100] = 3
    s = stats(t, **change("samples", -100))
    assert unread(compared(t, stream(t), s)) > 50
    assert unread(compared(replace(t, flags=flags), stream(t), s)) == 0


# --- starting anew -------------------------------------------------------------------------------


def indexed(first: list[int]) -> Batches:
    t = chip(200)
    b = stream(t)
    n = len(first)
    rows = np.arange(n) % b.first.size
    columns = {
        name: getattr(b, name)[rows]
        for name in ("count", "t_first_ticks", "period_ticks", "flags", "offset", "seen_t_ns_bench")
    }
    samples: NDArray[np.int16] = np.repeat(np.array(first, np.int16), BATCH)[:, None]
    return replace(
        b, first=np.array(first, np.int64), samples=np.repeat(samples, 6, axis=1), **columns
    )


@pytest.mark.parametrize(
    ("first", "rows"),
    [
        ([], []),
        ([0, 8, 16, 24], []),
        ([0, 8, 0, 8], [2]),
        ([0, 8, 0, 8, 0], [2, 4]),
        ([800, 808, 816, 3, 11], [3]),
        # A link that was slow to come up lost the beginning both times.
        ([800, 808, 400, 408], [2]),
        # A batch that is late or repeated is no start.
        ([0, 64, 72, 64, 80], []),
    ],
)
def test_starts(first: list[int], rows: list[int]) -> None:
    b = indexed(first)
    assert starts(b) == rows
    rest = since_setup(b)
    assert rest.first.tolist() == first[rows[-1] if rows else 0 :]
    assert rest.samples[:, 0].tolist() == [f for f in rest.first.tolist() for _ in range(BATCH)]


def test_counters_before_a_start_are_left_out() -> None:
    s = stats(chip())
    s.raw["samples"][:3] += 50_000
    rest = s.since_setup()
    assert len(rest) == len(s) - 3
    assert rest.count("samples").tolist() == s.count("samples")[3:].tolist()


# --- what cannot be measured ---------------------------------------------------------------------


def test_a_bench_says_that_it_knows_no_truth() -> None:
    recording = synthesise(Plan(duration_s=6.0))
    bench = replace(recording, provenance=replace(recording.provenance, source="bench"))
    sync = timesync.analyse(bench)
    found = [*against.measure(bench, "leader", sync), *against.measure_fifo(bench, "leader", sync)]
    assert len(found) == 5
    for m in found:
        assert m.verdict is Verdict.UNSET
        assert "'bench' does not know what the chip sampled" in m.how
