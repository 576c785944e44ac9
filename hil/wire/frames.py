# SPDX-License-Identifier: Apache-2.0
"""Bytes -> frames: where they are in a serial stream, and what is in them.

A *chunk* is a non-empty run of bytes between two 00. A chunk is a frame when it is the stuffed form
of a message of at least header and CRC whose CRC is right; there is no other way to be one. What
stands before the first or behind the last 00 is no chunk: a stream that was cut in the middle of a
frame can therefore not produce a wrong one.

The bytes are taken apart in C++ (``native/streams.cpp``), in one pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.wire import _native, cobs
from hil.wire.crc import crc16
from hil.wire.messages import Message
from hil.wire.records import layout

HEADER_SIZE: Final = 3
"""Type u8 and seq u16 in front of a payload."""

CRC_SIZE: Final = 2

CHUNK_LIMIT: Final = 4096
"""Longer chunks are no frames. It bounds what hostile bytes can cost."""


@dataclass(frozen=True)
class Chunks:
    """All chunks of a stream, in its order.

    Attributes:
        start: int64[n], position of each chunk's first byte.
        length: int64[n], in bytes.
        seq: int32[n], the frame's number; -1 for a chunk that is no frame.
        delimiters: how many 00 the stream holds.
        head_end: position of the first 00.
        tail_start: position behind the last 00. Without a 00, both are the end of the stream.
    """

    start: NDArray[np.int64]
    length: NDArray[np.int64]
    seq: NDArray[np.int32]
    delimiters: int
    head_end: int
    tail_start: int


@dataclass(frozen=True)
class Frames:
    """What the frames of a stream hold.

    Attributes:
        records, rows: for each message of the table, as :func:`hil.wire.records.records_of` takes
            them, in the stream's order.
        unknown_types: frames of a type that the table does not have.
        bad_lengths: frames whose payload does not have the size of their message.
    """

    records: tuple[NDArray[np.uint8], ...]
    rows: tuple[NDArray[np.uint8], ...]
    unknown_types: int
    bad_lengths: int


def frame(type_id: int, seq: int, payload: bytes) -> bytes:
    """One whole frame, both delimiters included; ``seq`` is taken modulo 2^16."""
    message = bytes([type_id]) + (seq & 0xFFFF).to_bytes(2, "little") + payload
    return b"\0" + cobs.stuff(message + crc16(message).to_bytes(CRC_SIZE, "little")) + b"\0"


def take_apart(data: NDArray[np.uint8], table: Sequence[Message]) -> tuple[Chunks, Frames]:
    """The chunks of a stream, and the frames among them."""
    found = _native.take_apart(data, [layout(message) for message in table])
    start, length, seq, delimiters, head_end, tail_start, unknown_types, bad_lengths, each = found
    return (
        Chunks(start, length, seq, delimiters, head_end, tail_start),
        Frames(
            tuple(records for records, _ in each),
            tuple(rows for _, rows in each),
            unknown_types,
            bad_lengths,
        ),
    )
