# SPDX-License-Identifier: Apache-2.0
"""The golden vectors, run through the Python codec and through the C library as C11 and C++17.

Needs a C and a C++ compiler; ``CC`` and ``CXX`` name others than ``cc`` and ``c++``.
"""

from __future__ import annotations

import binascii
import ctypes
import json
import os
import struct
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cobs import cobs

from hil.wire.codec import decode, encode, encode_payload
from hil.wire.frames import frame, take_apart
from hil.wire.messages import BY_NAME, MESSAGES, Field, Message, schema_hash

ROOT = Path(__file__).parents[2]
WIRE = ROOT / "firmware" / "lib" / "wire"
GOLDEN = json.loads((ROOT / "fixtures" / "wire" / "golden.json").read_text(encoding="utf-8"))
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wpedantic", "-Werror")
LONGEST_PAYLOAD = 1024

Frame = tuple[int, int, bytes]


def joined(pieces: list[list[str]]) -> bytes:
    return bytes.fromhex("".join(piece for piece, _ in pieces))


def raw_numbers(fields: tuple[Field, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """The vector's values as numbers: hex strings as int, names of floats as float."""

    def number(value: Any, type_name: str) -> Any:
        if not isinstance(value, str):
            return value
        if type_name == "f32":
            return float.fromhex(value)
        return int(value, 16)

    return {
        f.name: [number(v, f.type) for v in values[f.name]]
        if f.count > 1
        else number(values[f.name], f.type)
        for f in fields
    }


def message_values(message: Message, values: Mapping[str, Any]) -> dict[str, Any]:
    numbers = raw_numbers(message.fields, values)
    if message.group:
        rows = values[message.group.name]
        numbers[message.group.name] = [raw_numbers(message.group.fields, row) for row in rows]
    return numbers


def bits(fields: tuple[Field, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """Values with each float as its bits, so that NaN and -0 compare."""

    def plain(value: Any, type_name: str) -> int:
        if type_name == "f32":
            return int.from_bytes(struct.pack("<f", value), "little")
        return int(value)

    return {
        f.name: [plain(v, f.type) for v in values[f.name]]
        if f.count > 1
        else plain(values[f.name], f.type)
        for f in fields
    }


def message_bits(message: Message, values: Mapping[str, Any]) -> dict[str, Any]:
    found = bits(message.fields, values)
    if message.group:
        rows = values[message.group.name]
        found[message.group.name] = [bits(message.group.fields, row) for row in rows]
    return found


class Implementation(ABC):
    """What a vector is run through."""

    @abstractmethod
    def put(self, message: Message, values: Mapping[str, Any]) -> bytes:
        """Payload of raw numbers."""

    @abstractmethod
    def get(self, message: Message, payload: bytes) -> Mapping[str, Any] | None:
        """Raw numbers of a payload; ``None`` when it is refused."""

    @abstractmethod
    def frame(self, type_id: int, seq: int, payload: bytes) -> bytes: ...

    @abstractmethod
    def receive(self, stream: bytes) -> list[Frame]: ...


class Python(Implementation):
    def put(self, message: Message, values: Mapping[str, Any]) -> bytes:
        return encode_payload(message.name, values)

    def get(self, message: Message, payload: bytes) -> Mapping[str, Any] | None:
        decoded = decode(frame(message.id, 0, payload))
        records = decoded.messages[message.name]
        if not len(records):
            return None
        values = {name: records[name][0] for name in records.dtype.names or ()}
        if message.group:
            values[message.group.name] = list(decoded.groups[message.name])
        return values

    def frame(self, type_id: int, seq: int, payload: bytes) -> bytes:
        return frame(type_id, seq, payload)

    def receive(self, stream: bytes) -> list[Frame]:
        data = np.frombuffer(stream, np.uint8)
        chunks, _ = take_apart(data, MESSAGES)
        found = []
        for start, length, seq in zip(chunks.start, chunks.length, chunks.seq, strict=True):
            if seq >= 0:
                message = cobs.decode(stream[start : start + length])
                found.append((message[0], int(seq), message[3:-2]))
        return found


C_NUMBERS = {
    "u8": ctypes.c_uint8,
    "i8": ctypes.c_int8,
    "u16": ctypes.c_uint16,
    "i16": ctypes.c_int16,
    "u32": ctypes.c_uint32,
    "i32": ctypes.c_int32,
    "f32": ctypes.c_float,
    "u64": ctypes.c_uint64,
    "i64": ctypes.c_int64,
}


def c_members(fields: tuple[Field, ...]) -> list[tuple[str, Any]]:
    return [
        (f.name, C_NUMBERS[f.type] * f.count if f.count > 1 else C_NUMBERS[f.type]) for f in fields
    ]


def c_structure(message: Message) -> type[ctypes.Structure]:
    """``struct wire_<message>`` as the table implies it."""
    members = c_members(message.fields)
    if message.group:
        row = type("Row", (ctypes.Structure,), {"_fields_": c_members(message.group.fields)})
        members.append((message.group.name, row * message.group.max_count))
    return type(message.name, (ctypes.Structure,), {"_fields_": members})


class Counts(ctypes.Structure):
    _fields_ = (("frames", ctypes.c_uint32), ("rejected", ctypes.c_uint32))


REPORT = ctypes.CFUNCTYPE(
    None, ctypes.c_uint8, ctypes.c_uint16, ctypes.POINTER(ctypes.c_uint8), ctypes.c_size_t
)


class C(Implementation):
    def __init__(self, library: Path) -> None:
        self.library = ctypes.CDLL(str(library))
        self.library.shim_message_names.restype = ctypes.c_char_p
        self.library.shim_schema_hash.restype = ctypes.c_uint64
        self.library.shim_receive.restype = Counts
        for name in ("shim_frame_max", "wire_frame"):
            getattr(self.library, name).restype = ctypes.c_size_t
        for m in MESSAGES:
            self.function(m, "put").restype = ctypes.c_size_t
            self.function(m, "size").restype = ctypes.c_size_t
            self.function(m, "get").restype = ctypes.c_bool

    def function(self, message: Message, name: str) -> Any:
        return getattr(self.library, f"shim_{message.name}_{name}")

    def put(self, message: Message, values: Mapping[str, Any]) -> bytes:
        structure = c_structure(message)()
        self.fill(structure, message.fields, values)
        if message.group:
            rows = getattr(structure, message.group.name)
            for row, given in zip(rows, values[message.group.name], strict=False):
                self.fill(row, message.group.fields, given)
        buffer = ctypes.create_string_buffer(message.max_size)
        size = self.function(message, "put")(buffer, ctypes.byref(structure))
        return buffer.raw[:size]

    @staticmethod
    def fill(
        structure: ctypes.Structure, fields: tuple[Field, ...], values: Mapping[str, Any]
    ) -> None:
        for f in fields:
            value = values[f.name]
            array = C_NUMBERS[f.type] * f.count
            setattr(structure, f.name, array(*value) if f.count > 1 else value)

    def get(self, message: Message, payload: bytes) -> Mapping[str, Any] | None:
        structure = c_structure(message)()
        taken = self.function(message, "get")(
            ctypes.byref(structure), payload, ctypes.c_size_t(len(payload))
        )
        if not taken:
            return None
        values = {f.name: getattr(structure, f.name) for f in message.fields}
        if message.group:
            rows = getattr(structure, message.group.name)[: values[message.group.count_field]]
            names = [f.name for f in message.group.fields]
            values[message.group.name] = [{n: getattr(row, n) for n in names} for row in rows]
        return values

    def frame(self, type_id: int, seq: int, payload: bytes) -> bytes:
        room = self.library.shim_frame_max(ctypes.c_size_t(len(payload)))
        return self.frame_in(room, type_id, seq, payload)

    def frame_in(self, room: int, type_id: int, seq: int, payload: bytes) -> bytes:
        buffer = ctypes.create_string_buffer(room)
        size = self.library.wire_frame(
            buffer,
            ctypes.c_size_t(room),
            ctypes.c_uint8(type_id),
            ctypes.c_uint16(seq),
            payload,
            ctypes.c_size_t(len(payload)),
        )
        return buffer.raw[:size]

    def receive(self, stream: bytes) -> list[Frame]:
        return self.receive_counted(stream)[0]

    def receive_counted(self, stream: bytes) -> tuple[list[Frame], Counts]:
        frames: list[Frame] = []

        def report(type_id: int, seq: int, payload: Any, size: int) -> None:
            frames.append((type_id, seq, bytes(payload[:size])))

        counts = self.library.shim_receive(stream, ctypes.c_size_t(len(stream)), REPORT(report))
        return frames, counts


def build(output: Path, language: str) -> Path:
    compiler = {
        "c11": [os.environ.get("CC", "cc"), "-std=c11"],
        "c++17": [os.environ.get("CXX", "c++"), "-std=c++17", "-x", "c++"],
    }[language]
    library = output / "libwire.so"
    subprocess.run(
        [
            *compiler,
            *STRICT,
            "-O1",
            "-shared",
            "-fPIC",
            f"-DWIRE_RX_PAYLOAD_MAX={LONGEST_PAYLOAD}u",
            f"-I{WIRE}",
            str(ROOT / "tests" / "unit" / "c" / "wire_shim.c"),
            str(WIRE / "framing.c"),
            "-o",
            str(library),
        ],
        check=True,
    )
    return library


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, C]:
    return {
        language: C(build(tmp_path_factory.mktemp("wire"), language))
        for language in ("c11", "c++17")
    }


@pytest.fixture(params=["c11", "c++17"])
def c(request: pytest.FixtureRequest, libraries: Mapping[str, C]) -> C:
    return libraries[request.param]


@pytest.fixture(params=["python", "c11", "c++17"])
def implementation(request: pytest.FixtureRequest, libraries: Mapping[str, C]) -> Implementation:
    return Python() if request.param == "python" else libraries[request.param]


messages = pytest.mark.parametrize("vector", GOLDEN["messages"], ids=lambda v: v["name"])
streams = pytest.mark.parametrize("vector", GOLDEN["streams"], ids=lambda v: v["name"])


class TestVectors:
    """The file itself, held against implementations that are not ours."""

    @messages
    def test_frame_is_what_others_make_of_the_payload(self, vector: dict[str, Any]) -> None:
        seq = vector["seq"].to_bytes(2, "little")
        message = bytes([vector["type"]]) + seq + joined(vector["payload"])
        crc = binascii.crc_hqx(message, 0xFFFF)
        assert crc == int(vector["crc"], 16)
        stuffed = cobs.encode(message + crc.to_bytes(2, "little"))
        assert b"\0" + stuffed + b"\0" == bytes.fromhex(vector["frame"])

    @streams
    def test_every_byte_of_a_stream_is_in_one_class(self, vector: dict[str, Any]) -> None:
        classes = [n for name, n in vector["counts"].items() if name.endswith("_bytes")]
        assert sum(classes) == len(joined(vector["bytes"]))
        assert vector["counts"]["frames"] == len(vector["frames"])

    def test_every_message_is_there(self) -> None:
        assert {v["message"] for v in GOLDEN["messages"]} == set(BY_NAME)


class TestMessages:
    @messages
    def test_values_make_the_payload(
        self, implementation: Implementation, vector: dict[str, Any]
    ) -> None:
        message = BY_NAME[vector["message"]]
        values = message_values(message, vector["values"])
        assert implementation.put(message, values).hex() == joined(vector["payload"]).hex()

    @messages
    def test_payload_gives_the_values(
        self, implementation: Implementation, vector: dict[str, Any]
    ) -> None:
        message = BY_NAME[vector["message"]]
        found = implementation.get(message, joined(vector["payload"]))
        assert found is not None
        wanted = message_values(message, vector["values"])
        assert message_bits(message, found) == message_bits(message, wanted)

    @messages
    def test_payload_makes_the_frame(
        self, implementation: Implementation, vector: dict[str, Any]
    ) -> None:
        made = implementation.frame(vector["type"], vector["seq"], joined(vector["payload"]))
        assert made.hex() == vector["frame"].lower()

    @messages
    def test_frame_gives_the_payload(
        self, implementation: Implementation, vector: dict[str, Any]
    ) -> None:
        found = implementation.receive(bytes.fromhex(vector["frame"]))
        assert found == [(vector["type"], vector["seq"], joined(vector["payload"]))]

    @messages
    def test_truncated_or_overlong_payload_is_refused(
        self, implementation: Implementation, vector: dict[str, Any]
    ) -> None:
        message = BY_NAME[vector["message"]]
        payload = joined(vector["payload"])
        for size in range(len(payload)):
            assert implementation.get(message, payload[:size]) is None, f"{size} bytes"
        assert implementation.get(message, payload + b"\0") is None

    @messages
    def test_encode_makes_the_frame(self, vector: dict[str, Any]) -> None:
        values = message_values(BY_NAME[vector["message"]], vector["values"])
        made = encode(vector["message"], values, vector["seq"])
        assert made.hex() == vector["frame"].lower()


class TestStreams:
    @streams
    def test_frames(self, implementation: Implementation, vector: dict[str, Any]) -> None:
        wanted = [(f["type"], f["seq"], bytes.fromhex(f["payload"])) for f in vector["frames"]]
        assert implementation.receive(joined(vector["bytes"])) == wanted

    @streams
    def test_counts_and_text(self, vector: dict[str, Any]) -> None:
        decoded = decode(joined(vector["bytes"]))
        assert asdict(decoded.stats) == vector["counts"]
        assert [list(line) for line in decoded.text] == vector["text"]

    @streams
    def test_receiver_counts(self, c: C, vector: dict[str, Any]) -> None:
        _, counts = c.receive_counted(joined(vector["bytes"]))
        assert (counts.frames, counts.rejected) == (len(vector["frames"]), vector["rejected"])


class TestLibrary:
    """What the C library promises beyond the vectors."""

    def test_exports_every_message(self, c: C) -> None:
        names = c.library.shim_message_names().decode().split()
        assert names == [m.name for m in MESSAGES]

    def test_says_the_schema_hash(self, c: C) -> None:
        assert c.library.shim_schema_hash() == schema_hash()

    @pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.name)
    def test_structure_has_the_members_of_the_table(self, c: C, message: Message) -> None:
        assert c.function(message, "id")() == message.id
        assert c.function(message, "size")() == ctypes.sizeof(c_structure(message))

    def test_too_many_rows_are_not_put(self, c: C) -> None:
        message = BY_NAME["imu_batch"]
        structure = c_structure(message)()
        structure.count = 17
        buffer = ctypes.create_string_buffer(message.max_size)
        assert c.function(message, "put")(buffer, ctypes.byref(structure)) == 0
        assert buffer.raw == bytes(message.max_size)

    @pytest.mark.parametrize("size", [0, 1, 216, 248, 249, 250, 502, 503, 504, LONGEST_PAYLOAD])
    def test_frame_fits_its_bound_exactly(self, c: C, size: int) -> None:
        payload = b"\xa5" * size
        room = c.library.shim_frame_max(ctypes.c_size_t(size))
        assert c.frame_in(room, 1, 0x0101, payload) == frame(1, 0x0101, payload)
        assert c.frame_in(room - 1, 1, 0x0101, payload) == b""

    def test_longest_frame_is_received_and_a_longer_one_is_not(self, c: C) -> None:
        fits = frame(1, 1, b"\xa5" * LONGEST_PAYLOAD)
        too_long = frame(1, 2, b"\xa5" * (LONGEST_PAYLOAD + 1))
        frames, counts = c.receive_counted(fits + too_long + fits)
        assert [len(payload) for _, _, payload in frames] == [LONGEST_PAYLOAD] * 2
        assert (counts.frames, counts.rejected) == (2, 1)
