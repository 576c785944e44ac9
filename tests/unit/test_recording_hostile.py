# SPDX-License-Identifier: Apache-2.0
"""Files made to hurt, and files that never were recordings: bounded memory, one clear error.

Hostile chunks carry correct checksums: whoever makes them can compute a CRC.
"""

from __future__ import annotations

import json
import os
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import mcap.reader
import mcap.writer
import numpy as np
import pytest
import zstandard

from hil.errors import RecordingError
from hil.recording import Event, Provenance, Recording, Writer, container, layout, load
from hil.wire.messages import schema

MAGIC = b"\x89MCAP0\r\n"
MEMORY_LIMIT = 100 * 1024 * 1024


class Genuine:
    """A genuine recording, to take parts of: its first chunk, its channel ids, its messages."""

    def __init__(self, path: Path) -> None:
        with Writer(path, Provenance("synthetic", "", scenario={"name": "genuine"})) as writer:
            for i in range(20):
                writer.write_serial("leader", i, b"leader,%d\r\n" % i)
                writer.write_edges([i], [1], [i % 2])
            writer.write_event(Event(3, "note", "leader", {"a": [1]}))
            writer.write_imu_truth("leader", [1, 1], [4, 5], [2.0, 3.0], [[7] * 6] * 2, [8, 9])
        self.bytes = path.read_bytes()
        with path.open("rb") as file:
            reader = mcap.reader.make_reader(file)
            summary = reader.get_summary()
            assert summary is not None
            self.ids = {channel.topic: channel.id for channel in summary.channels.values()}
            self.messages = [
                (channel.topic, message.sequence, message.data)
                for _, channel, message in reader.iter_messages()
            ]
        index = summary.chunk_indexes[0]
        self.front = self.bytes[: index.chunk_start_offset + index.chunk_length]
        self.end_id = self.ids["/end"]


@pytest.fixture(scope="module")
def genuine(tmp_path_factory: pytest.TempPathFactory) -> Genuine:
    return Genuine(tmp_path_factory.mktemp("genuine") / "genuine.mcap")


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def message(channel: int, sequence: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, sequence, 0, 0) + data)


def chunk(contents: bytes, packed: bytes | None = None, **lies: Any) -> bytes:
    """A chunk record; ``lies`` replaces any of its header fields."""
    packed = zstandard.compress(contents) if packed is None else packed
    size = lies.get("size", len(contents))
    crc = lies.get("crc", zlib.crc32(contents))
    compression = lies.get("compression", b"zstd")
    body = struct.pack("<QQQII", 0, 0, size, crc, len(compression)) + compression
    body += struct.pack("<Q", lies.get("data_length", len(packed))) + packed
    return struct.pack("<BQ", 6, lies.get("length", len(body))) + body


def opened(path: Path, data: bytes, **options: Any) -> Recording:
    """Load ``data`` within the memory limit."""
    path.write_bytes(data)
    tracemalloc.start()
    try:
        return load(path, **options)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < MEMORY_LIMIT


def problems(path: Path, data: bytes) -> str:
    recording = opened(path, data)
    assert not recording.integrity.complete
    return "\n".join(recording.integrity.problems)


def serial_block(offset: int, reads: list[tuple[int, int]], data: bytes) -> bytes:
    """``reads`` as (time, length), true or not."""
    block = struct.pack("<QI", offset, len(reads))
    block += struct.pack(f"<{len(reads)}q", *(t for t, _ in reads))
    return block + struct.pack(f"<{len(reads)}I", *(n for _, n in reads)) + data


# --- not a recording ---------------------------------------------------------------------


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "hostile.mcap"


def foreign(library_chunks: bool, path: Path) -> None:
    """Somebody else's MCAP file."""
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file, use_chunking=library_chunks)
        writer.start()
        schema_id = writer.register_schema("Imu", "ros1msg", b"float64 x")
        channel = writer.register_channel("/camera/\x1b[2Jimage", "ros1", schema_id)
        for i in range(10):
            writer.add_message(channel, i, b"x" * 100, i)
        writer.finish()


@pytest.mark.parametrize(
    ("make", "said", "mend"),
    [
        (lambda p: None, "No such file", "hil record"),
        (lambda p: p.mkdir(), "is a folder", "name the .mcap file itself"),
        (lambda p: p.touch(), "is empty", "record the run again"),
        (lambda p: p.write_text("time,volt\n0,1\n"), "begins with b'time,volt", "imported"),
        (lambda p: p.write_bytes(b"MZ"), "not an MCAP file", "imported"),
        (lambda p: p.write_bytes(bytes(4096)), "not an MCAP file", "imported"),
        (lambda p: p.write_text("version https://git-lfs.github.com/x\n"), "LFS", "git lfs pull"),
        (lambda p: p.write_bytes(MAGIC), "no readable provenance", "record the run again"),
        (
            lambda p: p.write_bytes(MAGIC + np.random.default_rng(9).bytes(50_000)),
            "no readable prov",
            "record the run",
        ),
        (lambda p: foreign(True, p), "holds /camera/?[2Jimage", "hil record"),
        (lambda p: foreign(False, p), "holds /camera/?[2Jimage", "hil record"),
        (os.mkfifo, "not a regular file", "name the .mcap"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_recording(
    path: Path, make: Callable[[Path], object], said: str, mend: str
) -> None:
    make(path)
    with pytest.raises(RecordingError) as caught:
        load(path)
    assert said in caught.value.message
    assert str(path) in caught.value.message
    assert mend in caught.value.mend


def test_a_folder_with_one_recording_is_told_from_it(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").touch()
    with pytest.raises(RecordingError) as caught:
        load(tmp_path)
    assert caught.value.mend == f"did you mean {tmp_path / 'run.mcap'}?"


def test_a_path_that_no_file_can_have() -> None:
    for name in ("a\0b", "x" * 5000):
        with pytest.raises(RecordingError, match="cannot be opened"):
            load(name)


# --- bombs -------------------------------------------------------------------------------


def test_a_chunk_that_claims_too_much_is_refused_unread(path: Path, genuine: Genuine) -> None:
    for size in (layout.MAX_CHUNK_BYTES + 1, 1 << 40, (1 << 64) - 1):
        text = problems(path, genuine.front + chunk(b"abc", size=size))
        assert f"it claims {size} bytes, the limit is {layout.MAX_CHUNK_BYTES}" in text


def test_a_zstd_bomb(path: Path, genuine: Genuine) -> None:
    compressor = zstandard.ZstdCompressor(level=1).compressobj(size=1 << 30)
    zeros = bytes(1 << 20)
    bomb = b"".join(compressor.compress(zeros) for _ in range(1 << 10)) + compressor.flush()
    assert len(bomb) < 200_000
    assert "it claims" in problems(path, genuine.front + chunk(b"", bomb, size=1 << 30))
    for size in (1000, layout.MAX_CHUNK_BYTES):
        text = problems(path, genuine.front + chunk(b"", bomb, size=size))
        assert "its uncompressed size is not what it claims" in text


def test_a_zstd_bomb_without_a_size(path: Path, genuine: Genuine) -> None:
    compressor = zstandard.ZstdCompressor(level=1, write_content_size=False).compressobj()
    bomb = compressor.compress(bytes(64 << 20)) + compressor.flush()
    assert "not what it claims" in problems(path, genuine.front + chunk(b"", bomb, size=1000))


def test_a_frame_that_lies_about_its_size(path: Path, genuine: Genuine) -> None:
    """Frame header and chunk agree on 1000 bytes; the blocks inside hold a megabyte."""
    frame = bytearray(zstandard.compress(bytes(1 << 20)))
    assert zstandard.frame_content_size(bytes(frame)) == 1 << 20
    at = bytes(frame).index(struct.pack("<I", 1 << 20))
    frame[at : at + 4] = struct.pack("<I", 1000)
    text = problems(path, genuine.front + chunk(b"", bytes(frame), size=1000))
    assert "it does not decompress" in text


def test_many_chunks_within_the_limit_meet_the_limit_of_the_whole(
    path: Path, genuine: Genuine
) -> None:
    leader = genuine.ids["/serial/leader"]
    data = bytes(15 << 20)
    chunks = [
        chunk(message(leader, i, serial_block(i * len(data), [(0, len(data))], data)))
        for i in range(20)
    ]
    false = chunk(data, crc=1)
    assert len(false) + sum(map(len, chunks)) < 1_000_000
    for bomb in (b"".join(chunks), false * 20):
        with pytest.raises(RecordingError, match="more than the limit") as caught:
            opened(path, genuine.front + bomb, max_bytes=40 << 20)
        assert "max_bytes" in caught.value.mend


def test_a_flood_of_tiny_records(
    path: Path, genuine: Genuine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(layout, "MAX_RECORDS", 10_000)
    flood = b"".join(message(99, i, b"") for i in range(10_001))
    with pytest.raises(RecordingError, match="more than 10000 records"):
        opened(path, genuine.front + chunk(flood))


def test_a_flood_of_json(path: Path, genuine: Genuine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout, "MAX_ALL_JSON_BYTES", 100_000)
    events = genuine.ids["/events"]
    body = json.dumps({"t_ns_bench": 1, "kind": "k", "node": "n", "data": {"x": "y" * 1000}})
    flood = b"".join(message(events, i, body.encode()) for i in range(200))
    path.write_bytes(genuine.front + chunk(flood))
    recording = load(path)
    assert 70 < len(recording.events) < 100
    assert any("100000 bytes of JSON in all" in text for text in recording.integrity.problems)
    assert recording.integrity.lost_blocks == 200 - len(recording.events)


def test_one_huge_json(path: Path, genuine: Genuine) -> None:
    body = b'{"x":"' + b"y" * layout.MAX_JSON_BYTES + b'"}'
    text = problems(path, genuine.front + chunk(message(genuine.ids["/events"], 0, body)))
    assert f"the limit is {layout.MAX_JSON_BYTES}" in text


@pytest.mark.parametrize("length", [1 << 63, (1 << 64) - 1, 1 << 40, 10**6])
@pytest.mark.parametrize("opcode", [1, 3, 4, 6, 8, 9, 12, 200])
def test_absurd_record_lengths(path: Path, genuine: Genuine, opcode: int, length: int) -> None:
    leader = genuine.ids["/serial/leader"]
    good = chunk(message(leader, 0, serial_block(0, [(1, 3)], b"abc")))
    bad = struct.pack("<BQ", opcode, length) + b"some bytes"
    recording = opened(path, genuine.front + bad + good)
    # The chunk behind the nonsense is found again.
    assert recording.serial["leader"].data.tobytes() == b"abc"
    assert any(f"byte {len(genuine.front)}" in text for text in recording.integrity.problems)


@pytest.mark.parametrize(
    "lies",
    [
        {"data_length": (1 << 64) - 1},
        {"data_length": 0},
        {"compression": b""},
        {"compression": b"lz4"},
        {"compression": b"\xff\xfe"},
        {"crc": 0},
        {"size": 0},
    ],
)
def test_lying_chunk_headers(path: Path, genuine: Genuine, lies: dict[str, Any]) -> None:
    leader = genuine.ids["/serial/leader"]
    contents = message(leader, 0, serial_block(0, [(1, 3)], b"abc"))
    text = problems(path, genuine.front + chunk(contents, **lies))
    assert f"the chunk at byte {len(genuine.front)} is lost" in text


def test_a_file_full_of_false_chunks_takes_bounded_work(genuine: Genuine) -> None:
    """Each false chunk claims to reach the end of the file, which invites quadratic reading."""
    count, step = 20_000, 53
    parts = []
    for i in range(count):
        rest = (count - i) * step
        parts.append(chunk(b"", b"", length=rest - 9, data_length=rest - step).ljust(step, b"\0"))
    # The junk at the end sends the search back to just behind the chunk that failed.
    data = genuine.front + b"".join(parts) + b"\xff" * 20
    reads: list[int] = []

    class Counting(BytesIO):
        def read(self, size: int | None = -1, /) -> bytes:
            data = super().read(size)
            reads.append(len(data))
            return data

    found = container.Problems()
    chunks = list(
        container.sound_chunks(Counting(data), len(data), container.Tail(), found, 1 << 30)
    )
    assert len(chunks) == 1
    assert "gave up" in found.texts()[-1]
    assert sum(reads) < 8 * len(data) + 8 * layout.MAX_CHUNK_BYTES


def test_a_flood_of_problems_is_cut_short(path: Path, genuine: Genuine) -> None:
    bad = chunk(b"abc", crc=1)
    recording = opened(path, genuine.front + bad * 500)
    assert len(recording.integrity.problems) < 110
    assert "more problems" in recording.integrity.problems[-1]


def test_a_chunk_within_the_data_of_a_chunk_is_not_found(path: Path, genuine: Genuine) -> None:
    """A port may say anything, also what a chunk looks like; it stays data."""
    leader, follower = genuine.ids["/serial/leader"], genuine.ids["/serial/follower"]
    inner = chunk(message(follower, 0, serial_block(0, [(1, 4)], b"fake")))
    data = b"before" + inner + b"after"
    contents = message(leader, 0, serial_block(0, [(1, len(data))], data))
    # RFC 8878: one segment, content size in four bytes, then a last block that is stored raw.
    frame = b"\x28\xb5\x2f\xfd\xa0" + struct.pack("<I", len(contents))
    outer = chunk(contents, frame + struct.pack("<I", len(contents) << 3 | 1)[:3] + contents)
    assert inner in outer
    recording = opened(path, genuine.front + outer + b"\xff" * 20)
    assert recording.serial["leader"].data.tobytes() == data
    assert len(recording.serial["follower"].data) == 0


# --- blocks that lie ---------------------------------------------------------------------

I63 = 1 << 63


@pytest.mark.parametrize(
    "block",
    [
        b"",
        b"\0" * 11,
        serial_block(0, [], b""),
        serial_block(0, [(1, 4)], b"abc"),
        serial_block(0, [(1, 2)], b"abc"),
        serial_block(0, [(1, 0), (1, 3)], b"abc"),
        serial_block(0, [(1, 0xFFFFFFFF), (1, 4)], b"abc"),
        serial_block(I63, [(1, 3)], b"abc"),
        serial_block((1 << 64) - 3, [(1, 3)], b"abc"),
        struct.pack("<QI", 0, 0xFFFFFFFF) + b"abc",
        struct.pack("<QI", 0, 0x40000000) + b"abc",
    ],
)
def test_serial_blocks_that_lie(path: Path, genuine: Genuine, block: bytes) -> None:
    leader = genuine.ids["/serial/leader"]
    good = serial_block(0, [(-I63, 1), (I63 - 1, 2)], b"abc")
    contents = message(leader, 0, block) + message(leader, 1, good)
    recording = opened(path, genuine.front + chunk(contents))
    assert recording.serial["leader"].data.tobytes() == b"abc"
    np.testing.assert_array_equal(recording.serial["leader"].block_t_ns_bench, [-I63, I63 - 1])
    assert recording.integrity.lost_blocks == 1
    text = "\n".join(recording.integrity.problems)
    assert "/serial/leader: block 0 was refused" in text


def test_serial_blocks_that_overlap_or_leave_gaps(path: Path, genuine: Genuine) -> None:
    leader = genuine.ids["/serial/leader"]
    contents = (
        message(leader, 0, serial_block(0, [(1, 3)], b"abc"))
        + message(leader, 1, serial_block(2, [(2, 3)], b"xyz"))
        + message(leader, 2, serial_block(1 << 61, [(3, 2)], b"de"))
    )
    recording = opened(path, genuine.front + chunk(contents))
    stream = recording.serial["leader"]
    assert stream.data.tobytes() == b"abcde"
    assert (stream.gap_offset.tolist(), stream.gap_bytes.tolist()) == ([3], [(1 << 61) - 3])
    text = "\n".join(recording.integrity.problems)
    assert "overlaps" in text
    assert f"{(1 << 61) - 3} bytes lost after byte 3" in text


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (b"", "too few"),
        (struct.pack("<I", 0), "0 edges do not fit"),
        (struct.pack("<I", 0xFFFFFFFF), "do not fit"),
        (struct.pack("<IqBB", 1, 5, 0, 2), "level 2"),
        (struct.pack("<IqBB", 1, 5, 6, 1), "1 edges of channels without a name"),
        (struct.pack("<IqBBB", 1, 5, 0, 1, 1), "do not fit"),
    ],
)
def test_edge_blocks_that_lie(path: Path, genuine: Genuine, block: bytes, said: str) -> None:
    recording = opened(path, genuine.front + chunk(message(genuine.ids["/edges"], 0, block)))
    assert len(recording.edges.t_ns_bench) == 0
    assert said in "\n".join(recording.integrity.problems)


def truth_block(slots: int, first: int, t_us: tuple[float, float], body: int) -> bytes:
    return struct.pack("<IIIdd", slots, 1, first, *t_us) + bytes(body)


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (b"", "too few"),
        (truth_block(0, 0, (0, 0), 0), "0 slots do not fit"),
        (truth_block(0xFFFFFFFF, 0, (0, 0), 13), "do not fit"),
        (truth_block(1, 0, (0, 0), 14), "1 slots do not fit"),
        (truth_block(2, 0xFFFFFFFF, (0, 1), 26), "leave 32 bits"),
        (truth_block(2, 0, (0, float("nan")), 26), "not finite"),
        (truth_block(2, 0, (float("-inf"), 0), 26), "not finite"),
        (truth_block(2, 0, (0, 1e300), 26), "beyond 35 years"),
        (truth_block(2, 0, (1, 0), 26), "does not fit its first"),
        (truth_block(1, 0, (0, 1), 13), "does not fit its first"),
    ],
)
def test_blocks_of_imu_truth_that_lie(
    path: Path, genuine: Genuine, block: bytes, said: str
) -> None:
    topic = genuine.ids["/truth/leader/imu"]
    recording = opened(path, genuine.front + chunk(message(topic, 0, block)))
    assert recording.imu_truth == {}
    assert said in "\n".join(recording.integrity.problems)


def test_a_flood_of_tiny_truth_stays_within_memory(path: Path, genuine: Genuine) -> None:
    """Blocks of one slot each, the costliest there are."""
    topic = genuine.ids["/truth/leader/imu"]
    count = 4000
    block = truth_block(1, 0, (0, 0), 13)
    contents = b"".join(message(topic, number, block) for number in range(count))
    recording = opened(path, genuine.front + chunk(contents))
    assert len(recording.imu_truth["leader"]) == count
    assert "goes back" in "\n".join(recording.integrity.problems)


EVENT = '{"t_ns_bench":%s,"kind":"k","node":"n","data":%s}'


@pytest.mark.parametrize(
    "body",
    [
        "",
        "[]",
        "nonsense",
        "\ufeff{}",
        EVENT % (1, "NaN"),
        EVENT % (1, '{"x":NaN}'),
        EVENT % (1, '{"x":Infinity}'),
        EVENT % (1, '{"x":1e999}'),
        EVENT % (1, '{"x":"\\ud800"}'),
        EVENT % (1, '{"\\ud800":1}'),
        EVENT % (1, '{"x":%s}' % ("9" * 100)),
        EVENT % (1, '{"x":%s}' % ("9" * 100_000)),
        EVENT % (1, '{"x":%s}' % ("[" * 100_000)),
        EVENT % (1, '{"x":' + "[" * 40 + "]" * 40 + "}"),
        EVENT % (1, "3"),
        EVENT % ("1.5", "{}"),
        EVENT % ("true", "{}"),
        EVENT % (2**63, "{}"),
        EVENT % ('"1"', "{}"),
        '{"t_ns_bench":1,"kind":1,"node":"n","data":{}}',
        '{"t_ns_bench":1}',
    ],
    ids=lambda body: body[:40],
)
def test_events_that_are_none(path: Path, genuine: Genuine, body: str) -> None:
    events = genuine.ids["/events"]
    good = (EVENT % (7, "{}")).encode()
    contents = message(events, 0, body.encode()) + message(events, 1, good)
    recording = opened(path, genuine.front + chunk(contents))
    assert recording.events == (Event(7, "k", "n", {}),)
    assert recording.integrity.lost_blocks == 1
    assert "/events: block 0 was refused" in "\n".join(recording.integrity.problems)


def test_invalid_utf8_is_no_event(path: Path, genuine: Genuine) -> None:
    contents = message(genuine.ids["/events"], 0, b'{"\xff":1}')
    assert "not JSON" in problems(path, genuine.front + chunk(contents))


def test_unknown_channels_and_sequence_jumps(path: Path, genuine: Genuine) -> None:
    leader = genuine.ids["/serial/leader"]
    contents = (
        message(999, 0, b"?")
        + message(leader, 0xFFFFFFFE, serial_block(0, [(1, 3)], b"abc"))
        + message(leader, 0xFFFFFFFE, serial_block(3, [(1, 3)], b"abc"))
        + record(77, b"unknown record")
    )
    recording = opened(path, genuine.front + chunk(contents))
    text = "\n".join(recording.integrity.problems)
    assert "channel 999 is not described" in text
    assert "4294967294 of 4294967295 blocks lost" in text
    assert "repeated or out of order" in text
    assert recording.serial["leader"].data.tobytes() == b"abc"


@pytest.mark.parametrize(
    "contents",
    [b"\x05", b"\x05\xff", record(5, b"short"), record(4, b"\xff" * 20), record(3, b"x" * 70_000)],
)
def test_chunks_with_sound_checksum_and_no_sense(
    path: Path, genuine: Genuine, contents: bytes
) -> None:
    text = problems(path, genuine.front + chunk(contents))
    assert "sound checksum and malformed contents" in text


def test_messages_outside_chunks_are_not_believed(path: Path, genuine: Genuine) -> None:
    leader = genuine.ids["/serial/leader"]
    data = genuine.front + message(leader, 0, serial_block(0, [(1, 3)], b"abc"))
    recording = opened(path, data)
    assert len(recording.serial["leader"].data) == 0
    assert "outside any chunk" in "\n".join(recording.integrity.problems)


# --- an end that lies --------------------------------------------------------------------


def with_end(genuine: Genuine, **changes: Any) -> bytes:
    """The genuine recording with another end message, every checksum correct."""
    out = BytesIO()
    writer = mcap.writer.Writer(out, enable_data_crcs=True)
    writer.start(profile="hil")
    with BytesIO(genuine.bytes) as file:
        reader = mcap.reader.make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        for described in sorted(summary.schemas.values(), key=lambda s: s.id):
            writer.register_schema(described.name, described.encoding, described.data)
        for channel in sorted(summary.channels.values(), key=lambda c: c.id):
            writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id)
        for _, channel, item in reader.iter_messages():
            data = item.data
            if channel.topic == "/end":
                data = json.dumps({**json.loads(data), **changes}).encode()
            writer.add_message(channel.id, 0, data, 0, item.sequence)
    writer.finish()
    return out.getvalue()


def test_the_rewritten_recording_is_complete(path: Path, genuine: Genuine) -> None:
    recording = opened(path, with_end(genuine))
    assert recording.integrity.complete
    assert recording.integrity.problems == ()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"blocks": {}}, "counts wrongly"),
        ({"blocks": []}, "counts wrongly"),
        ({"blocks": {"/serial/leader": -1}}, "counts wrongly"),
        ({"blocks": {"/serial/leader": True}}, "counts wrongly"),
        ({"blocks": {"/serial/leader": "1"}}, "counts wrongly"),
        ({"blocks": {"/serial/leader": 2**63}}, "of 9223372036854775808 blocks lost"),
        ({"bytes": {}}, "bytes are here"),
        ({"bytes": 7}, "bytes are here"),
        ({"edges": 19}, "20 of 19 edges are here"),
        ({"edges": None}, "20 of None edges are here"),
        ({"aborted": "power\ncut"}, "the run was aborted: power?cut"),
    ],
)
def test_an_end_that_disagrees(
    path: Path, genuine: Genuine, changes: dict[str, Any], said: str
) -> None:
    assert said in problems(path, with_end(genuine, **changes))


# --- provenance --------------------------------------------------------------------------


def with_front(genuine: Genuine, change: Callable[[dict[str, Any]], object]) -> bytes:
    """Header and first chunk with the provenance message changed, checksum correct."""
    at = genuine.bytes.index(b"\x06", 8 + 9)
    contents = next(
        container.sound_chunks(
            BytesIO(genuine.front),
            len(genuine.front),
            container.Tail(),
            container.Problems(),
            1 << 24,
        )
    )
    out = b""
    for opcode, body in container.records(contents):
        if opcode == 5:
            front = json.loads(bytes(body[22:]))
            change(front)
            out += message(genuine.ids["/provenance"], 0, json.dumps(front).encode())
        else:
            out += record(opcode, bytes(body))
    return genuine.bytes[:at] + chunk(out)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.update(format="other"), "not that of a recording"),
        (lambda f: f.pop("format"), "not that of a recording"),
        (lambda f: f.update(version=2), "format version '2'; this hil reads 1"),
        (lambda f: f.update(version=[1]), "format version"),
        (lambda f: f.pop("edges"), "edge channels"),
        (lambda f: f["edges"].update(channels=["a"] * 300), "edge channels"),
        (lambda f: f["edges"].update(channels=[3]), "edge channels"),
        (lambda f: f["edges"].update(channels=["\x1b[2J"]), "edge channels"),
        (lambda f: f["edges"].update(resolution_ns=-1), "resolution"),
        (lambda f: f["edges"].update(resolution_ns="1"), "resolution"),
        (lambda f: f.pop("provenance"), "missing source"),
        (lambda f: f["provenance"].pop("schema"), "missing schema"),
        (lambda f: f["provenance"].update(source="dream"), "'dream' is unknown"),
        (lambda f: f["provenance"].update(source=3), "'source' is not text"),
        (lambda f: f["provenance"].update(scenario=[]), "'scenario' is not a mapping"),
        (lambda f: f["provenance"].update(manifests={"leader": 1}), "manifest"),
    ],
)
def test_provenance_that_lies(
    path: Path, genuine: Genuine, change: Callable[[dict[str, Any]], object], said: str
) -> None:
    with pytest.raises(RecordingError) as caught:
        opened(path, with_front(genuine, change))
    assert said in caught.value.message
    assert str(path) in caught.value.message
    assert caught.value.mend


def test_a_foreign_table_is_named_and_does_not_stop_the_rest(path: Path, genuine: Genuine) -> None:
    def break_table(front: dict[str, Any]) -> None:
        front["provenance"]["schema"] = {"protocol_version": 1, "messages": "all"}

    def other_hash(front: dict[str, Any]) -> None:
        front["provenance"]["schema_hash"] = "0" * 16

    def other_table(front: dict[str, Any]) -> None:
        front["provenance"]["schema"]["messages"].pop()

    recording = opened(path, with_front(genuine, break_table))
    assert "table cannot be used" in "\n".join(recording.integrity.problems)
    with pytest.raises(RecordingError, match="table cannot be used"):
        recording.decoded("leader")
    for change in (other_hash, other_table):
        assert "hash it claims" in problems(path, with_front(genuine, change))


def test_a_key_of_a_later_version_is_left_out(path: Path, genuine: Genuine) -> None:
    data = with_front(genuine, lambda f: f["provenance"].update(weather="fine"))
    assert opened(path, data).provenance.scenario == {"name": "genuine"}


def test_a_second_copy_that_disagrees_is_refused(path: Path, genuine: Genuine) -> None:
    front = next(data for topic, _, data in genuine.messages if topic == "/provenance")
    for copy, refused in ((front, 0), (front.replace(b"genuine", b"changed"), 1)):
        contents = message(genuine.ids["/provenance"], 1, copy)
        recording = opened(path, genuine.front + chunk(contents))
        assert recording.provenance.scenario == {"name": "genuine"}
        assert recording.integrity.lost_blocks == refused


def test_a_flood_of_ports(path: Path, genuine: Genuine) -> None:
    def described(number: int) -> bytes:
        texts = (b"/serial/port%d" % number, b"x-hil-block")
        packed = b"".join(struct.pack("<I", len(text)) + text for text in texts)
        return record(4, struct.pack("<HH", number, 2) + packed + bytes(4))

    flood = b"".join(described(number) for number in range(100, 400))
    recording = opened(path, genuine.front + chunk(flood))
    assert len(recording.roles) == layout.MAX_ROLES


def test_channels_of_another_layout(path: Path, genuine: Genuine) -> None:
    text = b"hil.serial_block.v1"
    contents = b"".join(
        record(opcode, bytes(body).replace(text, b"hil.serial_block.v2"))
        for opcode, body in container.records(
            next(
                container.sound_chunks(
                    BytesIO(genuine.front),
                    len(genuine.front),
                    container.Tail(),
                    container.Problems(),
                    1 << 24,
                )
            )
        )
    )
    with pytest.raises(RecordingError, match=r"hil\.serial_block\.v2") as caught:
        opened(path, MAGIC + chunk(contents))
    assert "another version" in caught.value.mend


# --- whatever else -----------------------------------------------------------------------


def use_everything(recording: Recording) -> None:
    """What a check would do with it; hostile contents may only raise RecordingError."""
    for role in recording.roles:
        stream = recording.serial[role]
        if len(stream.data):
            stream.t_ns_bench([0, len(stream.data) - 1])
        try:
            recording.decoded(role)
        except RecordingError:
            assert any("table" in text for text in recording.integrity.problems)
    for name in recording.edges.channels:
        recording.edges.select(name)
    try:
        _ = recording.truth
    except RecordingError as error:
        assert "clock model" in error.message or "nodes" in error.message  # noqa: PT017
    json.dumps(recording.provenance.to_mapping(), allow_nan=False)
    str(recording.name), recording.integrity


def test_mutations_behind_correct_checksums(path: Path, genuine: Genuine) -> None:
    """Bytes changed inside the chunks, then sealed again: accepted or refused, never a crash."""
    rng = np.random.default_rng(31)
    size = len(genuine.bytes)
    tail = container.Tail()
    contents = list(
        container.sound_chunks(BytesIO(genuine.bytes), size, tail, container.Problems(), 1 << 24)
    )
    assert len(contents) == 4
    opened_count = 0
    for _ in range(400):
        mutated = []
        for part in contents:
            data = bytearray(part)
            for _ in range(int(rng.integers(0, 4))):
                at = int(rng.integers(0, len(data)))
                match int(rng.integers(0, 4)):
                    case 0:
                        data[at] = int(rng.integers(0, 256))
                    case 1:
                        data[at : at + 4] = int(rng.choice([0, 2**31, 2**32 - 1])).to_bytes(
                            4, "little"
                        )
                    case 2:
                        del data[at : at + int(rng.integers(1, 40))]
                    case _:
                        data[at:at] = rng.bytes(int(rng.integers(1, 40)))
            mutated.append(chunk(bytes(data)))
        path.write_bytes(MAGIC + b"".join(mutated))
        try:
            recording = load(path)
        except RecordingError as error:
            assert error.mend  # noqa: PT017
            continue
        opened_count += 1
        assert not recording.integrity.complete
        use_everything(recording)
    assert opened_count > 50


def test_a_scenario_that_is_none_shows_when_it_is_used(path: Path, genuine: Genuine) -> None:
    def change(front: dict[str, Any]) -> None:
        front["provenance"]["scenario"] = {"nodes": {"leader": {"drift_ppm": "fast"}}}

    recording = opened(path, with_front(genuine, change))
    with pytest.raises(RecordingError, match="clock model"):
        _ = recording.truth


def test_the_embedded_table_is_the_one_of_this_version(genuine: Genuine) -> None:
    front = json.loads(next(data for topic, _, data in genuine.messages if topic == "/provenance"))
    assert front["provenance"]["schema"] == json.loads(json.dumps(schema()))
