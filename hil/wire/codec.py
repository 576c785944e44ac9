# SPDX-License-Identifier: Apache-2.0
"""The codec: values -> a frame, and a node's serial stream -> records, text and counts.

Decoding never fails on what a stream holds. Each byte belongs to exactly one of five classes:
delimiters (every 00), frames, text, noise, cut ends; :class:`Stats` counts them all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.wire.continuity import continuity
from hil.wire.frames import Chunks, frame, take_apart
from hil.wire.messages import BY_NAME, MESSAGES, Message, WireError
from hil.wire.records import Packer, Records, records_of
from hil.wire.schema import parse
from hil.wire.text import TextLine, find_text

HELLO: Final = "hello"
UPTIME: Final = "uptime_ms"


@dataclass(frozen=True)
class Stats:
    """What a stream was made of.

    Attributes:
        frames: chunks that passed their CRC, those of the next two counts included.
        unknown_types: frames of a type that the table does not have.
        bad_lengths: frames whose payload does not have the size of their message.
        crc_errors: chunks that were neither a frame nor text throughout.
        lost: frames missing in the sequence numbers, however they were lost: a damaged frame is
            one of them. :mod:`hil.wire.continuity` says what the numbers can and cannot show.
        duplicated: frames with the number of the frame before; they are kept.
        restarts: times that the node booted within the stream.
        delimiter_bytes, frame_bytes, text_bytes, noise_bytes, cut_bytes: the bytes of the stream
            by class. Cut bytes are those before the first 00 or after the last that are no text:
            what is left of a frame where the stream begins or ends within it.
    """

    frames: int = 0
    unknown_types: int = 0
    bad_lengths: int = 0
    crc_errors: int = 0
    lost: int = 0
    duplicated: int = 0
    restarts: int = 0
    delimiter_bytes: int = 0
    frame_bytes: int = 0
    text_bytes: int = 0
    noise_bytes: int = 0
    cut_bytes: int = 0

    @property
    def total_bytes(self) -> int:
        """Bytes of the stream."""
        known = self.delimiter_bytes + self.frame_bytes + self.text_bytes
        return known + self.noise_bytes + self.cut_bytes


@dataclass(frozen=True)
class Decoded:
    """A decoded stream.

    Attributes:
        messages: for each message of the table, also those that did not occur, a structured array
            of raw values in the stream's order: the fields of the table, ``seq`` u16, and
            ``offset`` i64, the position in the stream of the frame's first byte behind its 00.
        groups: for each message with a group, the rows of all its frames: the fields of the group
            and ``row`` i64, the index into ``messages`` of the record that they belong to.
        text: lines between the frames, in the stream's order.
        stats: counts.
        table: the messages that the stream was decoded by, by name.
    """

    messages: Mapping[str, Records]
    groups: Mapping[str, Records]
    text: tuple[TextLine, ...]
    stats: Stats
    table: Mapping[str, Message]


def encode_payload(name: str, values: Mapping[str, Any]) -> bytes:
    """Payload of one message from raw numbers, as they stand on the wire.

    ``values`` holds each field by name, an array as a sequence, the rows of a group as a sequence
    of mappings under the group's name; the field that counts them may be left out.

    Raises:
        WireError: no such message, or a value is missing, unknown or does not fit its type.
    """
    if name not in BY_NAME:
        raise WireError(f"no message is named {name!r}: there are {', '.join(BY_NAME)}")
    return _packer(name).pack(values)


@cache
def _packer(name: str) -> Packer:
    return Packer(BY_NAME[name])


def encode(name: str, values: Mapping[str, Any], seq: int) -> bytes:
    """One whole serial frame, both delimiters included; ``seq`` is taken modulo 2^16.

    Raises:
        WireError: as :func:`encode_payload`.
    """
    payload = encode_payload(name, values)
    return frame(BY_NAME[name].id, seq, payload)


def decode(
    data: bytes | bytearray | memoryview | NDArray[np.uint8],
    schema: Mapping[str, Any] | None = None,
) -> Decoded:
    """Takes one node's serial stream apart.

    Args:
        data: the stream, from any point on and to any point.
        schema: plain data as :func:`hil.wire.messages.schema` gives, for a stream that was made
            with another table than the present one.

    Raises:
        WireError: ``schema`` is no schema. What ``data`` holds raises nothing.
        TypeError: ``data`` is not made of bytes.
    """
    stream = _as_bytes(data)
    table = MESSAGES if schema is None else parse(schema)
    chunks, found = take_apart(stream, table)
    is_frame = chunks.seq >= 0
    records = {
        m.name: records_of(m, *of_message)
        for m, *of_message in zip(table, found.records, found.rows, strict=True)
    }
    messages = {name: of_frames for name, (of_frames, _) in records.items()}
    rest = _find_rest(stream, chunks, is_frame)
    hello, uptime_ms = _hellos(messages, chunks.start[is_frame])
    numbers = continuity(chunks.seq[is_frame].astype(np.uint16), hello, uptime_ms)
    return Decoded(
        messages=messages,
        groups={name: rows for name, (_, rows) in records.items() if rows is not None},
        text=tuple(rest.lines),
        stats=Stats(
            frames=int(np.count_nonzero(is_frame)),
            unknown_types=found.unknown_types,
            bad_lengths=found.bad_lengths,
            crc_errors=rest.broken_chunks,
            lost=numbers.lost,
            duplicated=numbers.duplicated,
            restarts=numbers.restarts,
            delimiter_bytes=chunks.delimiters,
            frame_bytes=int(chunks.length[is_frame].sum()),
            text_bytes=rest.text_bytes,
            noise_bytes=rest.noise_bytes,
            cut_bytes=rest.cut_bytes,
        ),
        table={m.name: m for m in table},
    )


def physical(
    array: Records, message: str, field: str, table: Mapping[str, Message] = BY_NAME
) -> NDArray[np.float64]:
    """``raw * scale`` of a field of records, or of the rows of their group, in the table's unit.

    Counts above 2^53 lose their last bits: take differences of raw ticks before scaling them.

    Args:
        array: ``messages[message]`` or ``groups[message]`` of a :class:`Decoded`, or part of it.
        table: the one that the array was decoded by, :attr:`Decoded.table`, when not the present.

    Raises:
        WireError: no such message or field.
    """
    if message not in table:
        raise WireError(f"no message is named {message!r}: there are {', '.join(table)}")
    entry = table[message]
    fields = (*entry.fields, *(entry.group.fields if entry.group else ()))
    found = [f for f in fields if f.name == field]
    if not found:
        raise WireError(
            f"{message} has no field {field!r}: there are {', '.join(f.name for f in fields)}"
        )
    return np.asarray(array[field], np.float64) * found[0].scale


def _as_bytes(data: bytes | bytearray | memoryview | NDArray[np.uint8]) -> NDArray[np.uint8]:
    if not isinstance(data, np.ndarray):
        return np.frombuffer(data, np.uint8)
    if data.dtype != np.uint8 or data.ndim != 1:
        raise TypeError(f"a stream is uint8[n], not {data.dtype}{list(data.shape)}")
    return np.ascontiguousarray(data)


def _hellos(
    messages: Mapping[str, Records], frame_start: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which frames are HELLO, and the uptime that each says; none in a table without uptime."""
    hello = messages.get(HELLO)
    if hello is None or UPTIME not in (hello.dtype.names or ()):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    uptime_ms = hello[UPTIME]
    if uptime_ms.ndim != 1 or uptime_ms.dtype.kind not in "iu":
        return np.empty(0, np.int64), np.empty(0, np.int64)
    return np.searchsorted(frame_start, hello["offset"]), uptime_ms.astype(np.int64)


class _Rest:
    """Lines, and bytes by class, of all that is no frame."""

    def __init__(self) -> None:
        self.lines: list[TextLine] = []
        self.text_bytes = 0
        self.noise_bytes = 0
        self.cut_bytes = 0
        self.broken_chunks = 0

    def add(self, region: bytes, offset: int, is_chunk: bool) -> None:
        lines, taken = find_text(region, offset)
        self.lines += lines
        self.text_bytes += taken
        if is_chunk:
            self.noise_bytes += len(region) - taken
            self.broken_chunks += taken < len(region)
        else:
            self.cut_bytes += len(region) - taken


def _find_rest(stream: NDArray[np.uint8], chunks: Chunks, is_frame: NDArray[np.bool_]) -> _Rest:
    rest = _Rest()
    rest.add(stream[: chunks.head_end].tobytes(), 0, is_chunk=False)
    start = chunks.start[~is_frame]
    end = start + chunks.length[~is_frame]
    if len(start):
        # Slices of a memoryview are several times cheaper than slices of an array.
        data = stream.data
        for first, behind in zip(start.tolist(), end.tolist(), strict=True):
            rest.add(bytes(data[first:behind]), first, is_chunk=True)
    rest.add(stream[chunks.tail_start :].tobytes(), chunks.tail_start, is_chunk=False)
    return rest
