# SPDX-License-Identifier: Apache-2.0
"""What happens to files: cut, damaged, and the writer killed. Nothing false may come out.

The sample's contents are known read by read, so that every read that survives can be held
against the one that was written at that place of the stream.
"""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
from pathlib import Path

import mcap.reader
import numpy as np
import pytest

from hil.errors import RecordingError
from hil.recording import Event, Provenance, Recording, Writer, load
from hil.recording.layout import FLUSH_S

PROVENANCE = Provenance("synthetic", "2025-06-01T12:00:00Z", scenario={"name": "damage"})
ROLES = ("leader", "follower")
FLIPS = 1000
CUTS = 1000
TURNS = 160

Reads = dict[str, dict[int, tuple[int, bytes]]]
"""role -> offset in the stream -> (time, bytes)."""


class Sample:
    """A recording of some 20 chunks and everything that went into it."""

    def __init__(self, path: Path) -> None:
        rng = np.random.default_rng(11)
        self.reads: Reads = {role: {} for role in ROLES}
        self.edges: list[tuple[int, int, int]] = []
        self.events: list[Event] = []
        self.slots: list[tuple[int, float, list[int]]] = []
        ends = dict.fromkeys(ROLES, 0)
        with Writer(path, PROVENANCE) as writer:
            for i in range(TURNS):
                for role in ROLES:
                    data = rng.integers(0, 60, int(rng.integers(1, 400)), np.uint8).tobytes()
                    writer.write_serial(role, 1000 * i, data)
                    self.reads[role][ends[role]] = (1000 * i, data)
                    ends[role] += len(data)
                self.edges.append((1000 * i, i % 6, i % 2))
                writer.write_edges(*zip(self.edges[-1], strict=True))
                self.slots.append((i, 250.0 * i, rng.integers(-99, 99, 6).tolist()))
                slot, t_us, counts = self.slots[-1]
                writer.write_imu_truth("leader", [1], [slot], [t_us], [counts], [8])
                if i % 10 == 0:
                    self.events.append(Event(1000 * i, "note", "leader", {"i": i}))
                    writer.write_event(self.events[-1])
                if i % 8 == 7:
                    writer.flush()
        self.bytes = path.read_bytes()
        with path.open("rb") as file:
            summary = mcap.reader.make_reader(file).get_summary()
        assert summary is not None
        self.chunks = [
            (index.chunk_start_offset, index.chunk_start_offset + index.chunk_length)
            for index in summary.chunk_indexes
        ]


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    return Sample(tmp_path_factory.mktemp("damage") / "sample.mcap")


def surviving(recording: Recording) -> Reads:
    """The reads of a recording by their place in the stream as it was written."""
    found: Reads = {}
    for role, stream in recording.serial.items():
        bounds = [*stream.block_offset.tolist(), len(stream.data)]
        lost = np.concatenate([[0], np.cumsum(stream.gap_bytes)])
        before = lost[np.searchsorted(stream.gap_offset, stream.block_offset, side="right")]
        data = stream.data.tobytes()
        found[role] = {
            start + shift: (t_ns, data[start:end])
            for start, end, shift, t_ns in zip(
                bounds[:-1],
                bounds[1:],
                before.tolist(),
                stream.block_t_ns_bench.tolist(),
                strict=True,
            )
        }
    return found


def slots_of(recording: Recording) -> list[tuple[int, float, list[int]]]:
    if "leader" not in recording.imu_truth:
        return []
    truth = recording.imu_truth["leader"]
    columns = (truth.slot, np.round(truth.t_us_true, 2), truth.counts)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def assert_nothing_false(recording: Recording, sample: Sample) -> None:
    """Every part that came out went in, and ``complete`` means all of it came out."""
    found = surviving(recording)
    for role in ROLES:
        assert found[role].items() <= sample.reads[role].items()
    edges = recording.edges
    columns = (edges.t_ns_bench, edges.channel, edges.level)
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    assert set(rows) <= set(sample.edges)
    assert all(event in sample.events for event in recording.events)
    slots = slots_of(recording)
    assert all(slot in sample.slots for slot in slots)
    everything = (
        found == sample.reads
        and rows == sample.edges
        and slots == sample.slots
        and list(recording.events) == sample.events
    )
    if recording.integrity.complete:
        assert everything
        assert recording.integrity.lost_blocks == 0
    else:
        assert recording.integrity.problems
    assert recording.provenance.to_mapping()["scenario"] == {"name": "damage"}


def test_the_sample_itself_is_whole(sample: Sample, tmp_path: Path) -> None:
    path = tmp_path / "whole.mcap"
    path.write_bytes(sample.bytes)
    recording = load(path)
    assert recording.integrity.complete
    assert recording.integrity.problems == ()
    assert surviving(recording) == sample.reads
    assert len(sample.chunks) > 20
    assert_nothing_false(recording, sample)


def test_cuts(sample: Sample, tmp_path: Path) -> None:
    """A file cut anywhere opens up to the cut, says so, and never counts as complete."""
    path = tmp_path / "cut.mcap"
    size = len(sample.bytes)
    rng = np.random.default_rng(21)
    # Each end of a chunk and the closing records get cuts of their own beside the random ones.
    edges = [end for _, end in sample.chunks] + list(range(size - 60, size))
    for cut in [*edges, *rng.integers(0, size, CUTS).tolist()]:
        path.write_bytes(sample.bytes[:cut])
        if cut < sample.chunks[0][1]:
            with pytest.raises(RecordingError, match=r"cut\.mcap") as caught:
                load(path)
            assert "record the run again" in caught.value.mend
            continue
        recording = load(path)
        assert not recording.integrity.complete, cut
        assert any("cut" in text for text in recording.integrity.problems), cut
        assert_nothing_false(recording, sample)
        # All chunks that lie before the cut came out: 8 turns each, after the first.
        whole = sum(end <= cut for _, end in sample.chunks) - 1
        for role, reads in surviving(recording).items():
            assert len(reads) == min(8 * whole, TURNS), (cut, role)
            assert list(reads) == list(sample.reads[role])[: len(reads)]


def test_corruptions(sample: Sample, tmp_path: Path) -> None:
    """No changed byte goes unnoticed, none costs more than its chunk, none brings false data."""
    path = tmp_path / "bad.mcap"
    size = len(sample.bytes)
    rng = np.random.default_rng(22)
    lost_some = 0
    for _ in range(FLIPS):
        start = int(rng.integers(0, size))
        length = int(rng.choice([1, 1, 1, 1, 8, 300]))
        damaged = bytearray(sample.bytes)
        for at in range(start, min(start + length, size)):
            damaged[at] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            recording = load(path)
        except RecordingError as error:
            # Only the start of the file can take its nature away.
            assert start < 8, (start, length)
            assert "is not an MCAP file" in error.message  # noqa: PT017
            continue
        integrity = recording.integrity
        assert integrity.problems, (start, length)
        assert_nothing_false(recording, sample)
        hit = [
            chunk for chunk in sample.chunks[1:-2] if chunk[0] < start + length and start < chunk[1]
        ]
        missing = TURNS - len(recording.serial["leader"].block_offset)
        assert missing <= 8 * len(hit), (start, length)
        if missing:
            lost_some += 1
            assert integrity.lost_blocks >= 2, (start, length)
            assert not integrity.complete
            gap = recording.serial["leader"].gap_bytes.sum()
            tail = list(surviving(recording)["leader"])[-1:] != list(sample.reads["leader"])[-1:]
            assert gap > 0 or tail
    assert lost_some > FLIPS // 2


def test_any_two_chunks_may_be_lost_and_are_counted(sample: Sample, tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    first, second = sample.chunks[4], sample.chunks[9]
    damaged = bytearray(sample.bytes)
    for start, end in (first, second):
        damaged[(start + end) // 2] ^= 0xFF
    path.write_bytes(damaged)
    recording = load(path)
    # Each chunk holds a block of both ports, of edges, of truth and, most of them, an event.
    assert 8 <= recording.integrity.lost_blocks <= 10
    for role in ROLES:
        stream = recording.serial[role]
        assert len(stream.gap_bytes) == 2
        written = sum(len(data) for _, data in sample.reads[role].values())
        assert len(stream.data) + stream.gap_bytes.sum() == written
    assert_nothing_false(recording, sample)


def test_the_spare_copy_stands_in_for_the_first_chunk(sample: Sample, tmp_path: Path) -> None:
    start, end = sample.chunks[0]
    path = tmp_path / "front.mcap"
    path.write_bytes(sample.bytes[:start] + bytes(end - start) + sample.bytes[end:])
    recording = load(path)
    assert surviving(recording) == sample.reads
    assert recording.integrity.lost_blocks == 1
    assert not recording.integrity.complete


def test_statistics_stand_in_for_the_end_message(sample: Sample, tmp_path: Path) -> None:
    """With the last data chunk and the end message gone, the summary still counts the loss."""
    damaged = bytearray(sample.bytes)
    for start, end in (sample.chunks[-1], sample.chunks[-3]):
        damaged[(start + end) // 2] ^= 0xFF
    path = tmp_path / "end.mcap"
    path.write_bytes(damaged)
    recording = load(path)
    assert recording.integrity.lost_blocks >= 4
    assert not recording.integrity.complete
    assert_nothing_false(recording, sample)


def test_chunks_in_another_order_are_not_taken_for_the_stream(
    sample: Sample, tmp_path: Path
) -> None:
    (a0, a1), (b0, b1) = sample.chunks[5], sample.chunks[6]
    raw = sample.bytes
    path = tmp_path / "order.mcap"
    path.write_bytes(raw[:a0] + raw[b0:b1] + raw[a1:b0] + raw[a0:a1] + raw[b1:])
    recording = load(path)
    assert any("out of order" in text for text in recording.integrity.problems)
    assert recording.integrity.lost_blocks >= 3
    assert_nothing_false(recording, sample)


def test_a_chunk_twice_counts_once(sample: Sample, tmp_path: Path) -> None:
    a, b = sample.chunks[5]
    path = tmp_path / "twice.mcap"
    path.write_bytes(sample.bytes[:b] + sample.bytes[a:b] + sample.bytes[b:])
    recording = load(path)
    assert any("repeated" in text for text in recording.integrity.problems)
    assert surviving(recording) == sample.reads


# Slow enough that in the time of the test the clock closes chunks, and not their size.
VICTIM = """
import struct, sys, time
from hil.recording import Provenance, Writer
with Writer(sys.argv[1], Provenance("bench", "")) as writer:
    i = 0
    while True:
        for role in ("leader", "follower"):
            writer.write_serial(role, i, struct.pack("<Q", i) * 12)
        i += 1
        if i % 5 == 0:
            sys.stdout.buffer.write(struct.pack("<Qd", i, time.monotonic()))
            sys.stdout.buffer.flush()
            time.sleep(0.02)
"""


@pytest.mark.parametrize("after_s", [0.4, 1.3, 2.6])
def test_kill_9_costs_at_most_the_last_chunk(tmp_path: Path, after_s: float) -> None:
    path = tmp_path / "victim.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", VICTIM, str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    acknowledged: list[tuple[int, float]] = []
    while not acknowledged or acknowledged[-1][1] < acknowledged[0][1] + after_s:
        acknowledged.append(struct.unpack("<Qd", process.stdout.read(16)))
    process.send_signal(signal.SIGKILL)
    _, errors = process.communicate(timeout=30)
    assert errors == b""

    recording = load(path)
    assert not recording.integrity.complete
    assert recording.integrity.lost_blocks == 0
    # By the victim's own clock, so that a busy machine does not matter: at its last write, which
    # was no earlier than the last report but one, nothing older than the interval was pending.
    safe = max((i for i, at_s in acknowledged if at_s < acknowledged[-2][1] - FLUSH_S), default=0)
    if after_s > 2 * FLUSH_S:
        assert safe > 0
    for role in ROLES:
        words = recording.serial[role].data.view("<u8")
        count = len(words) // 12
        np.testing.assert_array_equal(words, np.repeat(np.arange(count), 12))
        np.testing.assert_array_equal(recording.serial[role].block_t_ns_bench, np.arange(count))
        assert count >= safe
        assert len(recording.serial[role].gap_bytes) == 0
