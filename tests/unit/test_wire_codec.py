# SPDX-License-Identifier: Apache-2.0
"""The codec: round trips, hostile bytes, and another implementation on the same bytes."""

from __future__ import annotations

import binascii
import math
import random
import struct
import tracemalloc
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from cobs import cobs as other_cobs
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire import frames
from hil.wire.codec import Decoded, Stats, decode, encode, encode_payload, physical
from hil.wire.messages import BY_NAME, MESSAGES, TYPE_SIZES, Field, Message, WireError

every_message = pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.name)


def numbers(field: Field) -> st.SearchStrategy[Any]:
    """Any value that the field can hold."""
    if field.type == "f32":
        one: st.SearchStrategy[Any] = st.floats(width=32)
    else:
        bits = 8 * TYPE_SIZES[field.type]
        low = -(1 << bits - 1) if field.type.startswith("i") else 0
        one = st.integers(low, low + (1 << bits) - 1)
    return one if field.count == 1 else st.lists(one, min_size=field.count, max_size=field.count)


def any_values(message: Message) -> st.SearchStrategy[dict[str, Any]]:
    group = message.group
    fields = [f for f in message.fields if not (group and f.name == group.count_field)]
    parts = {f.name: numbers(f) for f in fields}
    if group:
        rows = st.fixed_dictionaries({f.name: numbers(f) for f in group.fields})
        parts[group.name] = st.lists(rows, max_size=group.max_count)
    return st.fixed_dictionaries(parts)


def same(found: Any, wanted: Any, type_name: str) -> bool:
    found, wanted = np.atleast_1d(found), np.atleast_1d(wanted)
    if type_name == "f32":
        return found.tobytes() == wanted.astype("<f4").tobytes()
    return found.tolist() == wanted.tolist()


def assert_record(fields: tuple[Field, ...], record: np.void, values: Mapping[str, Any]) -> None:
    for f in fields:
        if f.name in values:
            assert same(record[f.name], values[f.name], f.type), f.name


def example(message: Message, seed: int) -> dict[str, Any]:
    """Values drawn at random: small and large, so that payloads hold many zeros and few."""
    rng = random.Random(seed)

    def number(type_name: str) -> float:
        bits = 8 * TYPE_SIZES[type_name]
        if type_name == "f32":
            return struct.unpack("<f", struct.pack("<f", rng.uniform(-100, 100)))[0]
        value = rng.getrandbits(rng.choice((1, 7, bits - 1)))
        return -value if type_name.startswith("i") and rng.random() < 0.5 else value

    def row(fields: tuple[Field, ...], skip: str = "") -> dict[str, Any]:
        return {
            f.name: [number(f.type) for _ in range(f.count)] if f.count > 1 else number(f.type)
            for f in fields
            if f.name != skip
        }

    if message.group is None:
        return row(message.fields)
    values = row(message.fields, skip=message.group.count_field)
    rows = rng.randrange(message.group.max_count + 1)
    values[message.group.name] = [row(message.group.fields) for _ in range(rows)]
    return values


def mixed_stream(count: int, seed: int) -> tuple[bytes, list[tuple[Message, dict[str, Any]]]]:
    """A stream of all messages in random order, numbered from 0, and what is in it."""
    rng = random.Random(seed)
    sent = [(m, example(m, rng.getrandbits(32))) for m in rng.choices(MESSAGES, k=count)]
    for seq, (message, values) in enumerate(sent):
        if message.name == "hello":
            values["uptime_ms"] = seq
    stream = b"".join(encode(m.name, values, seq) for seq, (m, values) in enumerate(sent))
    return stream, sent


def assert_equal(one: Decoded, other: Decoded) -> None:
    assert one.stats == other.stats
    assert one.text == other.text
    for name in one.messages:
        assert one.messages[name].tobytes() == other.messages[name].tobytes(), name
    for name in one.groups:
        assert one.groups[name].tobytes() == other.groups[name].tobytes(), name


class TestRoundTrip:
    @every_message
    @settings(max_examples=50, deadline=None)
    @given(data=st.data())
    def test_any_values_come_back(self, message: Message, data: st.DataObject) -> None:
        values = data.draw(any_values(message))
        seq = data.draw(st.integers(0, 0xFFFF))
        stream = encode(message.name, values, seq)
        decoded = decode(stream)
        (record,) = decoded.messages[message.name]
        assert_record(message.fields, record, values)
        assert (record["seq"], record["offset"]) == (seq, 1)
        assert decoded.stats == Stats(frames=1, delimiter_bytes=2, frame_bytes=len(stream) - 2)
        if message.group:
            rows = values[message.group.name]
            assert record[message.group.count_field] == len(rows)
            for found, wanted in zip(decoded.groups[message.name], rows, strict=True):
                assert_record(message.group.fields, found, wanted)
                assert found["row"] == 0

    def test_stream_of_all_messages(self) -> None:
        stream, sent = mixed_stream(5000, seed=1)
        decoded = decode(stream)
        assert decoded.stats.frames == len(sent)
        assert decoded.stats.lost == decoded.stats.noise_bytes == 0
        for message in MESSAGES:
            wanted = [(s, v) for s, (m, v) in enumerate(sent) if m is message]
            records = decoded.messages[message.name]
            assert records["seq"].tolist() == [s for s, _ in wanted]
            assert np.all(np.diff(records["offset"]) > 0)
            for record, (_, values) in zip(records, wanted, strict=True):
                assert stream[record["offset"] - 1] == 0 != stream[record["offset"]]
                assert_record(message.fields, record, values)
            if message.group:
                rows = decoded.groups[message.name]
                flat = [(i, r) for i, (_, v) in enumerate(wanted) for r in v[message.group.name]]
                assert rows["row"].tolist() == [i for i, _ in flat]
                for found, (_, row) in zip(rows, flat, strict=True):
                    assert_record(message.group.fields, found, row)

    def test_all_messages_are_there_even_when_none_came(self) -> None:
        decoded = decode(b"")
        assert {name: len(array) for name, array in decoded.messages.items()} == dict.fromkeys(
            BY_NAME, 0
        )
        assert {name: len(array) for name, array in decoded.groups.items()} == {"imu_batch": 0}
        assert decoded.messages["hello"].dtype.names == (
            *(f.name for f in BY_NAME["hello"].fields),
            "seq",
            "offset",
        )

    @pytest.mark.parametrize("kind", [bytes, bytearray, memoryview, "array", "strided"])
    def test_takes_any_kind_of_bytes(self, kind: Any) -> None:
        stream, _ = mixed_stream(50, seed=2)
        if kind == "array":
            data: Any = np.frombuffer(stream, np.uint8)
        elif kind == "strided":
            data = np.repeat(np.frombuffer(stream, np.uint8), 2)[::2]
        else:
            data = kind(stream)
        assert_equal(decode(data), decode(stream))

    def test_refuses_an_array_that_is_not_bytes(self) -> None:
        with pytest.raises(TypeError, match=r"uint8\[n\], not int64\[3\]"):
            decode(np.zeros(3, np.int64))  # type: ignore[arg-type]


class TestChunks:
    """Chunks against another implementation's stuffing and CRC, one by one."""

    @pytest.mark.parametrize("seed", range(5))
    def test_a_damaged_stream_as_another_implementation_takes_it(self, seed: int) -> None:
        stream, _ = mixed_stream(3000, seed)
        data = np.frombuffer(stream, np.uint8).copy()
        rng = np.random.default_rng(seed)
        hit = rng.choice(len(data), 500, replace=False)
        data[hit] = rng.integers(0, 256, len(hit), np.uint8)
        chunks, _ = frames.take_apart(data, MESSAGES)
        found = [
            data[start : start + length].tobytes()
            for start, length in zip(chunks.start, chunks.length, strict=True)
        ]
        assert found == [c for c in data.tobytes().split(b"\0")[1:-1] if c]
        wanted = [other_seq(chunk) for chunk in found]
        assert chunks.seq.tolist() == wanted
        assert wanted.count(-1) > 100

    def test_a_chunk_that_strays_into_its_neighbours_spoils_none(self) -> None:
        """Codes that reach past the end of their chunk, among sound chunks of the same length."""
        good = [encode("attitude", example(BY_NAME["attitude"], seed), seed) for seed in range(40)]
        stray = bytearray(good[0])
        stray[1] = 0xFF
        decoded = decode(b"".join(bytes(stray) + frame for frame in good))
        assert decoded.messages["attitude"]["seq"].tolist() == list(range(40))
        assert decoded.stats.crc_errors == 40

    @pytest.mark.parametrize("size", [31, 253, 254, 255, 600])
    def test_a_chunk_that_is_not_stuffed_is_no_frame_though_its_crc_be_right(
        self, size: int
    ) -> None:
        """The CRC is that of the bytes as they stand, behind a code that reaches too far."""
        for filler in range(1, 256):
            body = bytes([filler]) * size
            crc = binascii.crc_hqx(body, 0xFFFF).to_bytes(2, "little")
            chunk = b"\xff" + body + crc
            if 0 in chunk or other_seq(chunk) >= 0:
                continue
            stats = decode(b"\0" + chunk + b"\0\0").stats
            assert (stats.frames, stats.crc_errors) == (0, 1)

    @pytest.mark.parametrize("length", [1, 2, 9, 250, 251, 252, 253, 254, 255, 256, 506, 507, 1000])
    def test_payloads_of_any_length_come_back(self, length: int) -> None:
        """Around the lengths at which groups are full, dense and sparse in zeros."""
        rng = random.Random(length)
        field = Field("bytes", "u8", "", "", count=length)
        table = (Message("any", 7, "", (field,)),)
        for zeros in (0.0, 0.01, 0.5, 1.0):
            payload = bytes(
                0 if rng.random() < zeros else rng.randrange(1, 256) for _ in range(length)
            )
            data = np.frombuffer(frames.frame(7, 9, payload), np.uint8)
            chunks, found = frames.take_apart(data, table)
            assert chunks.seq.tolist() == [9]
            assert found.records[0].tobytes() == payload + b"\x09\0" + bytes([1] + [0] * 7)


def other_seq(chunk: bytes) -> int:
    """The number of the frame that a chunk is, or -1."""
    try:
        message = other_cobs.decode(chunk)
    except other_cobs.DecodeError:
        return -1
    if len(message) < 5 or len(chunk) > frames.CHUNK_LIMIT:
        return -1
    sound = binascii.crc_hqx(message[:-2], 0xFFFF) == int.from_bytes(message[-2:], "little")
    return int.from_bytes(message[1:3], "little") if sound else -1


class TestHostileBytes:
    @settings(max_examples=300, deadline=None)
    @given(data=st.binary(max_size=600))
    def test_any_bytes_are_accounted_for(self, data: bytes) -> None:
        stats = decode(data).stats
        assert stats.total_bytes == len(data)
        assert stats.delimiter_bytes == data.count(0)

    @pytest.mark.parametrize("seed", range(20))
    def test_noise_of_every_density_of_zeros(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        data = rng.integers(0, 256, 50_000, np.uint8)
        data[rng.random(len(data)) < seed / 25] = 0
        stats = decode(data).stats
        assert stats.total_bytes == len(data)

    @pytest.mark.parametrize(
        "unit",
        [b"\0", b"\x01", b"\xff", b"A", b"\x01\0", b"\n", b"ab\r\n", b"\x80\r\n", b"\x02\x01\0"],
        ids=lambda u: u.hex(),
    )
    def test_memory_is_bounded(self, unit: bytes) -> None:
        """Bytes of working memory per byte of input; a line of text costs an object."""
        data = unit * (200_000 // len(unit))
        decode(data[:1000])
        tracemalloc.start()
        try:
            stats = decode(data).stats
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert stats.total_bytes == len(data)
        assert peak < 64 * len(data)

    def test_chunk_too_long_for_a_frame_is_none_even_if_its_crc_is_right(self) -> None:
        payload = b"\xa5" * (frames.CHUNK_LIMIT - 22)
        fits, too_long = frames.frame(99, 1, payload), frames.frame(99, 1, payload + b"\xa5")
        assert len(fits) - 2 == frames.CHUNK_LIMIT
        assert decode(fits).stats.frames == 1
        assert decode(too_long).stats.frames == 0


class TestRefusedValues:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"code": 65536}, "fault.code: 65536 is no u16"),
            ({"code": -1}, "fault.code: -1 is no u16"),
            ({"code": 1.5}, "fault.code: 1.5 is no u16"),
            ({"code": "1"}, "fault.code: '1' is no u16"),
            ({"code": None}, "fault.code: None is no u16"),
            ({"detail": [0] * 47}, "fault.detail: 47 elements, not 48"),
            ({"detail": 7}, "fault.detail: 7 is no sequence"),
            ({"colour": 1}, "fault: unknown field colour"),
        ],
    )
    def test_value(self, change: dict[str, Any], message: str) -> None:
        values = example(BY_NAME["fault"], 1) | change
        with pytest.raises(WireError, match=f"^{message}"):
            encode("fault", values, 0)

    def test_missing_field(self) -> None:
        values = example(BY_NAME["fault"], 1)
        del values["argument"]
        with pytest.raises(WireError, match=r"^fault.argument: missing"):
            encode("fault", values, 0)

    def test_too_many_rows(self) -> None:
        values = example(BY_NAME["imu_batch"], 1)
        row = {"gyro_lsb": [0, 0, 0], "accel_lsb": [0, 0, 0]}
        with pytest.raises(WireError, match=r"^imu_batch.samples: 17 rows are over 16"):
            encode("imu_batch", values | {"samples": [row] * 17}, 0)

    def test_count_that_is_not_that_of_the_rows(self) -> None:
        values = example(BY_NAME["imu_batch"], 1) | {"samples": [], "count": 1}
        with pytest.raises(WireError, match=r"^imu_batch.count: 1 is said, 0 rows are given"):
            encode("imu_batch", values, 0)

    @pytest.mark.parametrize("rows", [None, 3, [(0, 0, 0)], {"gyro_lsb": [0, 0, 0]}])
    def test_rows_that_are_none(self, rows: Any) -> None:
        values = example(BY_NAME["imu_batch"], 1) | {"samples": rows}
        with pytest.raises(WireError, match=r"^imu_batch.samples: a sequence of mappings"):
            encode("imu_batch", values, 0)

    def test_row_is_named(self) -> None:
        row = {"gyro_lsb": [0, 0, 40000], "accel_lsb": [0, 0, 0]}
        values = example(BY_NAME["imu_batch"], 1) | {"samples": [row]}
        with pytest.raises(WireError, match=r"^imu_batch.samples\[0\].gyro_lsb"):
            encode("imu_batch", values, 0)

    def test_unknown_message(self) -> None:
        with pytest.raises(WireError, match=r"^no message is named 'helo': there are hello"):
            encode_payload("helo", {})

    def test_float_too_large_for_f32(self) -> None:
        values = example(BY_NAME["attitude"], 1) | {"divergence_rad": 1e39}
        with pytest.raises(WireError, match=r"^attitude.divergence_rad: 1e\+39 is no f32"):
            encode("attitude", values, 0)

    def test_seq_is_taken_modulo_its_width(self) -> None:
        values = example(BY_NAME["fault"], 1)
        assert encode("fault", values, 0x1_0002) == encode("fault", values, 2)


class TestPhysical:
    def test_scales_fields_and_rows(self) -> None:
        row = {"gyro_lsb": [1, -2, 3], "accel_lsb": [4, 5, 6]}
        values = example(BY_NAME["imu_batch"], 1)
        values |= {"samples": [row], "temperature_cdegc": 2512, "period_ticks": 128}
        decoded = decode(encode("imu_batch", values, 0))
        records, rows = decoded.messages["imu_batch"], decoded.groups["imu_batch"]
        assert physical(records, "imu_batch", "period_ticks").tolist() == [0.5]
        (celsius,) = physical(records, "imu_batch", "temperature_cdegc")
        assert math.isclose(celsius, 25.12)
        assert physical(rows, "imu_batch", "gyro_lsb").tolist() == [[1.0, -2.0, 3.0]]

    def test_negative_extremes_do_not_wrap(self) -> None:
        values = example(BY_NAME["sync_state"], 1) | {"offset_ticks": -(2**63)}
        decoded = decode(encode("sync_state", values, 0))
        offset = physical(decoded.messages["sync_state"], "sync_state", "offset_ticks")
        assert offset.tolist() == [-(2.0**55)]

    def test_names_what_there_is(self) -> None:
        records = decode(b"").messages["attitude"]
        with pytest.raises(WireError, match="attitude has no field 'angle': there are t_ticks"):
            physical(records, "attitude", "angle")
        with pytest.raises(WireError, match="no message is named 'altitude'"):
            physical(records, "altitude", "quaternion")
