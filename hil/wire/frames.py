# SPDX-License-Identifier: Apache-2.0
"""Bytes -> frames: where they are in a serial stream, and what is in them.

A *chunk* is a non-empty run of bytes between two 00. A chunk is a frame when it is the stuffed form
of a message of at least header and CRC whose CRC is right; there is no other way to be one. What
stands before the first or behind the last 00 is no chunk: a stream that was cut in the middle of a
frame can therefore not produce a wrong one.

Chunks of equal length are taken apart together, as the rows of one array; odd ones out, and those
too long for that, go one by one. Both ways give the same answer.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.wire import cobs
from hil.wire.crc import crc16, crc16_rows

HEADER_SIZE: Final = 3
"""Type u8 and seq u16 in front of a payload."""

CRC_SIZE: Final = 2

CHUNK_LIMIT: Final = 4096
"""Longer chunks are no frames. It bounds what hostile bytes can cost."""

BLOCK: Final = 16384
"""Chunks taken apart at a time: what is in work then fits a processor's cache."""

ROWS_MIN: Final = 32
"""Fewer chunks of a length than this are faster one by one."""


@dataclass(frozen=True)
class Chunks:
    """All chunks of a stream, in its order.

    Attributes:
        start: int64[n], position of each chunk's first byte.
        length: int64[n], in bytes.
        delimiters: how many 00 the stream holds.
        head_end: position of the first 00.
        tail_start: position behind the last 00. Without a 00, both are the end of the stream.
    """

    start: NDArray[np.int64]
    length: NDArray[np.int64]
    delimiters: int
    head_end: int
    tail_start: int


@dataclass(frozen=True)
class Batch:
    """Frames whose messages are equally long.

    Attributes:
        chunk: int64[n], index of each frame's chunk, ascending.
        message: uint8[n, HEADER_SIZE + payload size]: type, seq, payload; without the CRC.
    """

    chunk: NDArray[np.int64]
    message: NDArray[np.uint8]

    @cached_property
    def type(self) -> NDArray[np.uint8]:
        return self.message[:, 0].copy()

    @cached_property
    def seq(self) -> NDArray[np.uint16]:
        seq: NDArray[np.uint16] = self.message[:, 1:HEADER_SIZE].copy().view("<u2")[:, 0]
        return seq

    @property
    def payload(self) -> NDArray[np.uint8]:
        return self.message[:, HEADER_SIZE:]


def frame(type_id: int, seq: int, payload: bytes) -> bytes:
    """One whole frame, both delimiters included; ``seq`` is taken modulo 2^16."""
    message = bytes([type_id]) + (seq & 0xFFFF).to_bytes(2, "little") + payload
    return b"\0" + cobs.stuff(message + crc16(message).to_bytes(CRC_SIZE, "little")) + b"\0"


def find_chunks(data: NDArray[np.uint8]) -> Chunks:
    """Where the chunks of a stream are."""
    delimiter = np.flatnonzero(data == 0)
    gap = np.diff(delimiter)
    filled = np.flatnonzero(gap > 1)
    return Chunks(
        start=delimiter[filled] + 1,
        length=gap[filled] - 1,
        delimiters=len(delimiter),
        head_end=int(delimiter[0]) if len(delimiter) else len(data),
        tail_start=int(delimiter[-1]) + 1 if len(delimiter) else len(data),
    )


def batches(data: NDArray[np.uint8], chunks: Chunks) -> Iterator[Batch]:
    """All frames among ``chunks``: batches in no order, frames within a batch in the stream's."""
    for first in range(0, len(chunks.start), BLOCK):
        yield from _block(data, chunks, first, chunks.length[first : first + BLOCK])


def _block(
    data: NDArray[np.uint8], chunks: Chunks, first: int, length: NDArray[np.int64]
) -> Iterator[Batch]:
    """Frames among the chunks from ``first`` on, of these lengths."""
    fits = length <= cobs.ROW_LIMIT
    # A row reaches one byte past the chunk's closing 00.
    fits[-1:] &= chunks.start[first + len(length) - 1] + length[-1:] + 2 <= len(data)
    # Chunks that do not fit are put with those of no size.
    size = np.where(fits, length, 0).astype(np.uint8)
    by_size = first + np.argsort(size, kind="stable")
    singles = []
    end = 0
    for population in np.bincount(size).tolist():
        equal = by_size[end : end + population]
        end += population
        if population >= ROWS_MIN and size[equal[0] - first] > HEADER_SIZE + CRC_SIZE:
            yield _rows(data, chunks, equal)
        else:
            singles.append(equal)
    yield from _singles(data, chunks, np.sort(np.concatenate(singles)))


def _rows(data: NDArray[np.uint8], chunks: Chunks, index: NDArray[np.int64]) -> Batch:
    """Frames among chunks of one length, worked on as the rows of one array."""
    length = int(chunks.length[index[0]])
    # Zero bytes in front of the message, so that it ends on a whole 16-bit word: its code, and,
    # for an odd length, the opening 00 as well.
    zeros = 2 if length % 2 else 1
    width = zeros + length + 1
    # Row i of the window is the bytes from i on, so that one look-up copies out all rows.
    window = np.ndarray((len(data) - width + 1, width), np.uint8, data, strides=(1, 1))
    rows = window[chunks.start[index] + 1 - zeros]
    sound = cobs.unstuff_rows(rows, zeros - 1, length)
    end = zeros + length - 1
    received = rows[:, end - CRC_SIZE : end].copy().view("<u2")[:, 0]
    good = sound & (crc16_rows(rows[:, : end - CRC_SIZE], zeros) == received)
    message = rows[:, zeros : end - CRC_SIZE]
    return Batch(index, message) if good.all() else Batch(index[good], message[good])


def _singles(data: NDArray[np.uint8], chunks: Chunks, index: NDArray[np.int64]) -> Iterator[Batch]:
    """Frames among chunks that are worked on one by one."""
    equal: dict[int, list[tuple[int, bytes]]] = defaultdict(list)
    length = chunks.length[index]
    for i in index[(length > HEADER_SIZE + CRC_SIZE) & (length <= CHUNK_LIMIT)].tolist():
        start = chunks.start[i]
        message = _message(data[start : start + chunks.length[i]].tobytes())
        if message is not None:
            equal[len(message)].append((i, message))
    for size, found in equal.items():
        joined = b"".join(message for _, message in found)
        yield Batch(
            np.array([i for i, _ in found], np.int64),
            np.frombuffer(joined, np.uint8).reshape(-1, size),
        )


def _message(chunk: bytes) -> bytes | None:
    unstuffed = cobs.unstuff(chunk)
    if unstuffed is None or len(unstuffed) < HEADER_SIZE + CRC_SIZE:
        return None
    message, received = unstuffed[:-CRC_SIZE], unstuffed[-CRC_SIZE:]
    return message if crc16(message).to_bytes(CRC_SIZE, "little") == received else None
