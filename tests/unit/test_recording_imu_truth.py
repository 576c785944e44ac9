# SPDX-License-Identifier: Apache-2.0
"""The simulated IMU's truth in a recording: exact counts, times to 1 ns, and few bytes."""

from __future__ import annotations

import struct
from pathlib import Path

import mcap.reader
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hil.errors import RecordingError
from hil.recording import ImuTruth, Provenance, Recording, Writer, imu_truth_block, load
from hil.recording.imu_truth_block import SLOTS_PER_BLOCK, blocks, pack, slots, unpack

PROVENANCE = Provenance("sim", "2025-06-01T12:00:00Z")


def truth(n: int, rate_hz: float = 6213.6, noise_lsb: float = 5.0) -> ImuTruth:
    """A swinging sensor with white noise, sampled evenly."""
    rng = np.random.default_rng(3)
    t_s = np.arange(n) / rate_hz
    swing = 3000 * np.sin(2 * np.pi * np.outer(t_s, np.linspace(0.5, 1.5, 6)))
    counts = np.rint(swing + rng.normal(0, noise_lsb, (n, 6)))
    slot = np.arange(n) + 17
    return ImuTruth(
        run=np.full(n, 4),
        slot=slot,
        t_us_true=1e6 / rate_hz * slot + 123.4,
        counts=counts.astype(np.int16),
        flags=np.full(n, 11),
    )


def written(path: Path, t: ImuTruth, piece: int) -> Recording:
    with Writer(path, PROVENANCE) as writer:
        for at in range(0, len(t), piece):
            cut = slice(at, at + piece)
            columns = (t.run, t.slot, t.t_us_true, t.counts, t.flags)
            writer.write_imu_truth("leader", *(column[cut] for column in columns))
    return load(path)


def assert_same(found: ImuTruth, t: ImuTruth) -> None:
    for name in ("run", "slot", "counts", "flags"):
        np.testing.assert_array_equal(getattr(found, name), getattr(t, name))
    np.testing.assert_allclose(found.t_us_true, t.t_us_true, rtol=0, atol=1.01e-3)


@pytest.mark.parametrize("piece", [7, 1000, 100_000])
def test_what_was_written_comes_back(tmp_path: Path, piece: int) -> None:
    t = truth(20_000)
    recording = written(tmp_path / "r.mcap", t, piece)
    assert recording.integrity.complete
    assert recording.integrity.problems == ()
    assert list(recording.imu_truth) == ["leader"]
    assert_same(recording.imu_truth["leader"], t)
    assert not recording.imu_truth["leader"].counts.flags.writeable


def test_noisy_counts_take_less_than_half_their_bytes(tmp_path: Path) -> None:
    empty = tmp_path / "empty.mcap"
    with Writer(empty, PROVENANCE):
        pass
    n = 100_000
    written(tmp_path / "r.mcap", truth(n), 5000)
    bytes_per_slot = ((tmp_path / "r.mcap").stat().st_size - empty.stat().st_size) / n
    assert bytes_per_slot < 5.0


def test_runs_holes_and_bends_begin_a_block() -> None:
    t = truth(3000)
    run = np.where(np.arange(3000) < 1000, 4, 5)
    slot = np.where(np.arange(3000) < 2000, t.slot, t.slot + 3)
    t_us = t.t_us_true + np.where(np.arange(3000) < 2500, 0.0, 0.004)
    taken = slots(run, slot, t_us, t.counts, t.flags)
    found = [(int(b.run[0]), int(b.slot[0])) for b in blocks(taken)]
    assert {(4, 17), (5, 1017), (5, 2020)} <= set(found)
    for block in blocks(taken):
        back = unpack(memoryview(pack(block)))
        np.testing.assert_allclose(back.t_us_true, block.t_us_true, rtol=0, atol=1e-3)
    assert len(found) < 16


def test_a_drifting_clock_is_followed(tmp_path: Path) -> None:
    """A clock that gains 1e-5 per second bends away from a line by 1 ns in some 30 ms."""
    t = truth(7000)
    s = t.t_us_true / 1e6
    bent = ImuTruth(t.run, t.slot, (s + 1e-5 * s**2) * 1e6, t.counts, t.flags)
    assert_same(written(tmp_path / "r.mcap", bent, 3000).imu_truth["leader"], bent)


def test_a_block_by_hand() -> None:
    """Two slots; gyro x 1 then -1, accel z 0 then 256, the others 0."""
    counts = [[1, 0, 0, 0, 0, 0], [-1, 0, 0, 0, 0, 256]]
    block = pack(slots([2, 2], [9, 10], [1.5, 2.5], counts, [1, 8]))
    low = bytes([2, 3]) + bytes(8) + bytes([0, 0])
    high = bytes(10) + bytes([0, 2])
    assert block == struct.pack("<IIIdd", 2, 2, 9, 1.5, 2.5) + low + high + bytes([1, 8])


@given(arrays(np.int16, st.tuples(st.integers(1, 40), st.just(6))))
def test_any_counts_survive(counts: np.ndarray) -> None:
    n = len(counts)
    zeros = np.zeros(n, int)
    back = unpack(memoryview(pack(slots(zeros, np.arange(n), zeros, counts, zeros))))
    np.testing.assert_array_equal(back.counts, counts)


GOOD = ([1], [1], [1.0], [[1, 2, 3, 4, 5, 6]], [8])


@pytest.mark.parametrize(
    ("at", "bad"),
    [
        (0, [-1]),
        (0, [1 << 32]),
        (0, [1.5]),
        (1, [1, 2]),
        (2, [float("nan")]),
        (2, [1e300]),
        (2, ["noon"]),
        (3, [[1, 2, 3, 4, 5]]),
        (3, [[40_000, 0, 0, 0, 0, 0]]),
        (3, [1, 2, 3, 4, 5, 6]),
        (4, [256]),
        (4, [None]),
    ],
)
def test_slots_that_are_none_are_refused(tmp_path: Path, at: int, bad: list) -> None:
    columns = [*GOOD[:at], bad, *GOOD[at + 1 :]]
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        with pytest.raises(RecordingError, match="truth of an IMU"):
            writer.write_imu_truth("leader", *columns)
        with pytest.raises(RecordingError, match="'third'"):
            writer.write_imu_truth("third", *GOOD)
        writer.write_imu_truth("leader", [], [], [], [], [])
        writer.write_imu_truth("leader", *GOOD)
    loaded = load(tmp_path / "r.mcap")
    assert loaded.integrity.problems == ()
    assert loaded.imu_truth["leader"].counts.tolist() == [[1, 2, 3, 4, 5, 6]]
    with pytest.raises(RecordingError, match="closed"):
        writer.write_imu_truth("leader", *GOOD)


def test_slots_that_go_back_are_reported_and_kept(tmp_path: Path) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        for slot, t_us in ((5, 10.0), (4, 20.0), (6, 15.0)):
            writer.write_imu_truth("follower", [1], [slot], [t_us], [[0] * 6], [0])
    loaded = load(tmp_path / "r.mcap")
    assert loaded.integrity.problems == ("/truth/follower/imu: time or slot goes back 2 times",)
    assert loaded.imu_truth["follower"].slot.tolist() == [5, 4, 6]


def test_a_lost_chunk_of_truth_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    with Writer(path, PROVENANCE) as writer:
        for k in range(5):
            t = truth(SLOTS_PER_BLOCK)
            writer.write_imu_truth(
                "leader", t.run, t.slot + 5000 * k, t.t_us_true + 1e6 * k, t.counts, t.flags
            )
            writer.flush()
    with path.open("rb") as file:
        summary = mcap.reader.make_reader(file).get_summary()
    assert summary is not None
    hit = summary.chunk_indexes[3]
    damaged = bytearray(path.read_bytes())
    damaged[hit.chunk_start_offset + hit.chunk_length // 2] ^= 0xFF
    path.write_bytes(damaged)
    loaded = load(path)
    assert loaded.integrity.lost_blocks == 1
    assert not loaded.integrity.complete
    assert "/truth/leader/imu: 16384 of 20480 slots are here" in loaded.integrity.problems
    kept = set(loaded.imu_truth["leader"].slot.tolist())
    assert len(kept) == 4 * SLOTS_PER_BLOCK
    assert not kept & set(range(10_017, 15_000))


def test_the_truth_of_an_imu_is_a_set_of_equal_columns() -> None:
    t = truth(5)
    for columns in (
        (t.run[:4], t.slot, t.t_us_true, t.counts, t.flags),
        (t.run, t.slot, t.t_us_true, t.counts[:4], t.flags),
        (t.run, t.slot, t.t_us_true, t.counts[:, :5], t.flags),
    ):
        with pytest.raises(RecordingError, match="as many"):
            ImuTruth(*columns)
    assert t.has("in_fifo").tolist() == [True] * 5
    assert t.has("clipped").tolist() == [False] * 5


def test_layout_names_every_field_of_the_head() -> None:
    assert imu_truth_block.SCHEMA_IMU_TRUTH == "hil.imu_truth_block.v1"
    for name in ("slots", "run", "first_slot", "t_first_us_true", "t_last_us_true", "flags[n]"):
        assert name in imu_truth_block.LAYOUT_IMU_TRUTH
