# SPDX-License-Identifier: Apache-2.0
"""Sound chunks out of an MCAP file that may be cut, damaged or made to hurt.

Nothing read here is believed before its checksum agrees: a chunk by its own CRC-32, the rest
of the data section by the one in DataEnd, the summary by the one in the footer. Memory stays
within a few times :data:`~hil.recording.layout.MAX_CHUNK_BYTES`, whatever the file claims.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO, Final

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from hil.errors import RecordingError, printable
from hil.recording.layout import MAX_CHUNK_BYTES, MAX_DESCRIPTION_BYTES

MAGIC: Final = MCAP0_MAGIC
BAD_RECORD: Final = (McapError, struct.error, ValueError, OverflowError)
"""All that the parsers of the ``mcap`` package raise on bytes that are not what they claim."""

_RECORD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_FOOTER: Final = struct.Struct("<BQQQI")
_DATA_END: Final = struct.Struct("<BQI")
_CHUNK_FIXED: Final = 40
_ZSTD_FIELD: Final = b"\x04\x00\x00\x00zstd"
_ZSTD_FIELD_AT: Final = _RECORD.size + 28
_WINDOW: Final = 1 << 20
_FIRST_WINDOW: Final = 1 << 12
_MAX_SUMMARY_BYTES: Final = 16 << 20
_MAX_PROBLEMS: Final = 100


class Problems:
    """Sentences about what is wrong; a flood of them is cut short and counted."""

    def __init__(self) -> None:
        self._texts: list[str] = []
        self._more = 0

    def add(self, text: str) -> None:
        text = printable(text)
        if text in self._texts:
            return
        if len(self._texts) < _MAX_PROBLEMS:
            self._texts.append(text)
        else:
            self._more += 1

    def __bool__(self) -> bool:
        return bool(self._texts)

    def texts(self) -> tuple[str, ...]:
        more = (f"and {self._more} more problems",) if self._more else ()
        return (*self._texts, *more)


@dataclass(frozen=True)
class Message:
    """One message of a sound chunk; ``data`` is a view into the chunk."""

    channel_id: int
    sequence: int
    data: memoryview


@dataclass
class Tail:
    """What the end of the file says, as far as its checksum agrees.

    ``closed``: the file ends with a footer and the magic. ``data_end``: where the data section
    ends. ``counts``: channel id -> messages, from the statistics.
    """

    closed: bool = False
    data_end: int | None = None
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: Mapping[int, int] = field(default_factory=dict)


class _DamagedError(Exception):
    """A chunk that cannot be believed; the text says why.

    ``spent``: bytes that were decompressed to find out; they count against the limit as well.
    """

    def __init__(self, text: str, spent: int = 0) -> None:
        super().__init__(text)
        self.spent = spent


def read_tail(file: BinaryIO, size: int, problems: Problems) -> Tail:
    """Footer, summary and data checksum. What is missing or damaged goes to ``problems``."""
    ending = _read(file, max(0, size - _FOOTER.size - len(MAGIC)), _FOOTER.size + len(MAGIC))
    if len(ending) < _FOOTER.size + len(MAGIC) or ending[-len(MAGIC) :] != MAGIC:
        problems.add(f"the file was cut or never closed: it ends at byte {size} without a footer")
        return Tail()
    opcode, length, summary_start, _, crc = _FOOTER.unpack(ending[: -len(MAGIC)])
    if opcode != Opcode.FOOTER or length != _FOOTER.size - _RECORD.size:
        problems.add("the footer is damaged")
        return Tail()
    tail = Tail(closed=True)
    summary_end = size - len(MAGIC) - _FOOTER.size
    if not len(MAGIC) <= summary_start <= summary_end:
        problems.add("the footer is damaged")
        return tail
    if summary_end - summary_start > _MAX_SUMMARY_BYTES:
        problems.add(f"the summary is larger than {_MAX_SUMMARY_BYTES} bytes and was not read")
        return tail
    # The checksum covers the summary and the footer up to the checksum itself.
    covered = _read(file, summary_start, size - len(MAGIC) - 4 - summary_start)
    if zlib.crc32(covered) != crc:
        problems.add("the summary is damaged (checksum)")
        return tail
    try:
        _read_summary(covered[: summary_end - summary_start], tail)
    except BAD_RECORD as error:
        problems.add(f"the summary is malformed: {error}")
    tail.data_end = _check_data_section(file, summary_start, problems)
    return tail


def _read_summary(summary: bytes, tail: Tail) -> None:
    for opcode, body in records(summary):
        match describe(opcode, body):
            case Channel() as channel:
                tail.channels[channel.id] = channel
            case Schema() as schema:
                tail.schemas[schema.id] = schema
            case Statistics() as statistics:
                tail.counts = statistics.channel_message_counts


def _check_data_section(file: BinaryIO, summary_start: int, problems: Problems) -> int | None:
    start = summary_start - _DATA_END.size
    record = _read(file, max(start, 0), _DATA_END.size)
    if start < len(MAGIC) or len(record) < _DATA_END.size:
        problems.add("the record that ends the data section is damaged")
        return None
    opcode, length, expected = _DATA_END.unpack(record)
    if opcode != Opcode.DATA_END or length != 4:
        problems.add("the record that ends the data section is damaged")
        return None
    crc, at = 0, 0
    while at < start:
        window = _read(file, at, min(_WINDOW, start - at))
        if not window:
            return None
        crc = zlib.crc32(window, crc)
        at += len(window)
    if crc != expected:
        problems.add("a byte of the data section was changed (checksum of the whole section)")
    return start


def sound_chunks(
    file: BinaryIO, size: int, tail: Tail, problems: Problems, max_bytes: int
) -> Iterator[bytes]:
    """Uncompressed contents of every chunk whose CRC agrees, in file order.

    A record that makes no sense is left by searching for the next chunk, so that one bad
    length does not cost the rest of the file.

    Raises:
        RecordingError: the chunks hold more than ``max_bytes`` together.
    """
    end = size if tail.data_end is None else tail.data_end
    # Searching may read a byte more than once. The bound keeps a file full of false chunks
    # from costing quadratic time.
    budget = 4 * size + 4 * MAX_CHUNK_BYTES
    total = 0
    at = len(MAGIC)
    search_from = at
    while at < end and budget > 0:
        header = _read(file, at, _RECORD.size)
        budget -= _RECORD.size
        opcode, length = _RECORD.unpack(header) if len(header) == _RECORD.size else (0, 0)
        after = at + _RECORD.size + length
        if opcode == 0 or after > end:
            cut = opcode and not tail.closed
            problems.add(
                f"the record at byte {at} is cut off or has a damaged length"
                if cut
                else f"damaged from byte {at}: no record begins there"
            )
            found, searched = _find_chunk(file, max(search_from, len(MAGIC)), end)
            budget -= searched
            if found is None:
                return
            at, search_from = found, found + _ZSTD_FIELD_AT + 1
            continue
        if opcode == Opcode.CHUNK:
            budget -= length
            try:
                data = _inflate(file, at, length, max_bytes - total)
            except _DamagedError as error:
                problems.add(f"the chunk at byte {at} is lost: {error}")
                search_from = at + _ZSTD_FIELD_AT + 1
                total += error.spent
            else:
                total += len(data)
                search_from = after
                yield data
        elif opcode == Opcode.MESSAGE:
            problems.add(f"the message at byte {at} is outside any chunk and was ignored")
        at = after
    if budget <= 0:
        problems.add(f"too damaged: gave up at byte {at} of {size}")


def _inflate(file: BinaryIO, at: int, length: int, room: int) -> bytes:
    if not _CHUNK_FIXED <= length <= MAX_CHUNK_BYTES + _CHUNK_FIXED:
        raise _DamagedError(f"its length of {length} bytes is outside the limits")
    body = _read(file, at + _RECORD.size, length)
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    except BAD_RECORD as error:
        raise _DamagedError("its header is malformed") from error
    if _CHUNK_FIXED + len(chunk.compression.encode()) + len(chunk.data) != length:
        raise _DamagedError("its lengths disagree")
    if chunk.compression != "zstd":
        raise _DamagedError(f"compression {chunk.compression[:20]!r} is not used by recordings")
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise _DamagedError(
            f"it claims {chunk.uncompressed_size} bytes, the limit is {MAX_CHUNK_BYTES}"
        )
    try:
        # The decompressor allocates what the frame's own header claims, so that comes first.
        if zstandard.frame_content_size(chunk.data) != chunk.uncompressed_size:
            raise _DamagedError("its uncompressed size is not what it claims")
        if chunk.uncompressed_size > room:
            raise RecordingError(
                "the recording holds more than the limit of uncompressed bytes",
                "if you trust the file, raise the limit: hil.recording.load(path, max_bytes=...)",
            )
        inflater = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
        data = inflater.decompress(chunk.data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise _DamagedError("it does not decompress") from error
    if zlib.crc32(data) != chunk.uncompressed_crc:
        raise _DamagedError("checksum", spent=len(data))
    return data


def _find_chunk(file: BinaryIO, start: int, end: int) -> tuple[int | None, int]:
    """Offset of the next thing from ``start`` that looks like a chunk, and bytes searched."""
    at, wanted = start, _FIRST_WINDOW
    read = 0
    while at < end:
        window = _read(file, at, min(wanted, end - at))
        read += len(window)
        hit = window.find(_ZSTD_FIELD)
        while hit >= 0:
            chunk = at + hit - _ZSTD_FIELD_AT
            if chunk >= start and _looks_like_chunk(file, chunk, end):
                return chunk, read
            hit = window.find(_ZSTD_FIELD, hit + 1)
        if at + len(window) >= end or not window:
            break
        at += len(window) - len(_ZSTD_FIELD) + 1
        wanted = min(2 * wanted, _WINDOW)
    return None, read


def _looks_like_chunk(file: BinaryIO, at: int, end: int) -> bool:
    head = _read(file, at, _ZSTD_FIELD_AT + len(_ZSTD_FIELD) + 8)
    if len(head) < _ZSTD_FIELD_AT + len(_ZSTD_FIELD) + 8:
        return False
    opcode, length = _RECORD.unpack_from(head)
    (data_length,) = struct.unpack_from("<Q", head, _ZSTD_FIELD_AT + len(_ZSTD_FIELD))
    return bool(
        opcode == Opcode.CHUNK
        and length == _CHUNK_FIXED + 4 + data_length
        and at + _RECORD.size + length <= end
    )


def records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Opcode and body of each record in a chunk or summary.

    Raises:
        ValueError: a record that runs over the end.
    """
    view = memoryview(data).toreadonly()
    at = 0
    while at < len(view):
        if len(view) - at < _RECORD.size:
            raise ValueError("a record is cut off")
        opcode, length = _RECORD.unpack_from(view, at)
        at += _RECORD.size
        if length > len(view) - at:
            raise ValueError(f"a record of {length} bytes is cut off")
        yield opcode, view[at : at + length]
        at += length


def describe(opcode: int, body: memoryview) -> McapRecord | None:
    """The channel, schema or statistics in ``body``; None for any other record.

    Raises:
        ValueError, or another of BAD_RECORD: malformed or absurdly long.
    """
    if opcode not in (Opcode.CHANNEL, Opcode.SCHEMA, Opcode.STATISTICS):
        return None
    if len(body) > MAX_DESCRIPTION_BYTES and opcode != Opcode.STATISTICS:
        raise ValueError(f"a description of {len(body)} bytes")
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.CHANNEL:
        channel: Channel = Channel.read(stream)
        channel.metadata = {}  # Unused, and the part of it that could be large.
        return channel
    kind = Schema if opcode == Opcode.SCHEMA else Statistics
    record: McapRecord = kind.read(stream)
    return record


def message(body: memoryview) -> Message:
    """Raises ValueError when the body is too short."""
    if len(body) < _MESSAGE.size:
        raise ValueError("a message is cut off")
    channel_id, sequence, _, _ = _MESSAGE.unpack_from(body)
    return Message(channel_id, sequence, body[_MESSAGE.size :])


def _read(file: BinaryIO, at: int, count: int) -> bytes:
    file.seek(at)
    return file.read(count)
