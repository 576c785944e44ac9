# SPDX-License-Identifier: Apache-2.0
"""The recording format: names, limits and the byte layout of every block.

``docs/recording-format.md`` tells the same in prose. All integers are little-endian and
unaligned. Nothing here touches a file.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

FORMAT: Final = "hil-recording"
FORMAT_VERSION: Final = 1
PROFILE: Final = "hil"

TOPIC_PROVENANCE: Final = "/provenance"
TOPIC_EDGES: Final = "/edges"
TOPIC_EVENTS: Final = "/events"
TOPIC_END: Final = "/end"
TOPIC_SERIAL: Final = "/serial/"
"""Followed by the role: ``/serial/leader``."""
TOPIC_TRUTH: Final = "/truth/"
TRUTH_IMU: Final = "/imu"
"""The role stands between the two: ``/truth/leader/imu``."""

ENCODING_BLOCK: Final = "x-hil-block"
ENCODING_JSON: Final = "json"
SCHEMA_SERIAL: Final = "hil.serial_block.v1"
SCHEMA_EDGES: Final = "hil.edge_block.v1"

ROLE_PATTERN: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")
EDGE_NAME_PATTERN: Final = re.compile(r"[a-z][a-z0-9_.]{0,63}")

CHUNK_BYTES: Final = 256 * 1024
"""The writer closes a chunk when it holds this much, uncompressed."""
BLOCK_BYTES: Final = 16 * 1024
"""The writer closes a serial block when it holds this much payload."""
READ_BYTES_MAX: Final = 64 * 1024
"""A longer read is kept as several of the same time."""
EDGES_PER_BLOCK: Final = 4096
EDGE_BYTES: Final = 10
MAX_EDGE_CHANNELS: Final = 256
MAX_ROLES: Final = 16
FLUSH_S: Final = 1.0
"""Longest wall time that bytes handed to the writer wait for a chunk, while bytes arrive."""

MAX_CHUNK_BYTES: Final = 16 * 1024 * 1024
"""A chunk that claims more, compressed or not, is refused unread."""
MAX_JSON_BYTES: Final = 4 * 1024 * 1024
"""Longest single JSON block."""
MAX_ALL_JSON_BYTES: Final = 32 * 1024 * 1024
"""Most JSON in one recording, events and all: parsed, it takes some 25 times as much memory."""
MAX_TOTAL_BYTES: Final = 2 * 1024 * 1024 * 1024
"""Default limit of a whole recording, uncompressed: 11 h of two nodes at 25 kB/s."""
MAX_RECORDS: Final = 4_000_000
"""Most records in all chunks together: bounds the time that a file of tiny blocks can take."""
MAX_DESCRIPTION_BYTES: Final = 64 * 1024
"""Longest record that describes a channel or a schema."""
MAX_JSON_DEPTH: Final = 32
MAX_STREAM_BYTES: Final = 1 << 62

LAYOUT_SERIAL: Final = """\
One or more reads of one serial port, byte for byte. Little-endian, unaligned:
  u64 start_offset      bytes of this stream in all earlier blocks
  u32 reads             n
  i64 t_ns_bench[n]     when each read returned, ns since the start of the run
  u32 length[n]         bytes of each read, each at least 1
  u8  data[sum(length)]
MCAP message.sequence counts the blocks of the channel from 0."""

LAYOUT_EDGES: Final = """\
Edges seen by the logic analyser or by the simulated one. Little-endian, unaligned:
  u32 edges             n
  i64 t_ns_bench[n]     ns since the start of the run
  u8  channel[n]        index into edges.channels of the /provenance message
  u8  level[n]          level after the edge, 0 or 1
MCAP message.sequence counts the blocks of the channel from 0."""

_SERIAL_HEAD: Final = struct.Struct("<QI")
_EDGES_HEAD: Final = struct.Struct("<I")
_READ_ROW: Final = 12


def truth_topic(role: str) -> str:
    return f"{TOPIC_TRUTH}{role}{TRUTH_IMU}"


def truth_role(topic: str) -> str:
    """The role of a topic of IMU truth; empty for any other topic."""
    if not (topic.startswith(TOPIC_TRUTH) and topic.endswith(TRUTH_IMU)):
        return ""
    role = topic[len(TOPIC_TRUTH) : -len(TRUTH_IMU)]
    return role if ROLE_PATTERN.fullmatch(role) else ""


class LayoutError(ValueError):
    """A block that does not have its layout. Never leaves ``hil.recording``."""


@dataclass(frozen=True)
class SerialBlock:
    """Unpacked serial block: ``t_ns_bench`` int64[n], ``length`` int64[n], ``data`` bytes."""

    start_offset: int
    t_ns_bench: NDArray[np.int64]
    length: NDArray[np.int64]
    data: memoryview


def pack_serial(start_offset: int, t_ns_bench: list[int], reads: list[bytes]) -> bytes:
    count = len(reads)
    return b"".join(
        (
            _SERIAL_HEAD.pack(start_offset, count),
            struct.pack(f"<{count}q", *t_ns_bench),
            struct.pack(f"<{count}I", *map(len, reads)),
            *reads,
        )
    )


def unpack_serial(block: memoryview) -> SerialBlock:
    """Raises LayoutError when lengths, counts or offsets do not fit the block."""
    if len(block) < _SERIAL_HEAD.size:
        raise LayoutError(f"{len(block)} bytes are too few for a serial block")
    start_offset, count = _SERIAL_HEAD.unpack_from(block)
    first = _SERIAL_HEAD.size + _READ_ROW * count
    if count == 0 or first > len(block):
        raise LayoutError(f"{count} reads do not fit a serial block of {len(block)} bytes")
    t_ns = np.frombuffer(block, "<i8", count, _SERIAL_HEAD.size)
    length = np.frombuffer(block, "<u4", count, _SERIAL_HEAD.size + 8 * count).astype(np.int64)
    total = int(length.sum())
    if first + total != len(block) or not length.all():
        raise LayoutError(f"read lengths add up to {total}, the block holds {len(block) - first}")
    if start_offset + total > MAX_STREAM_BYTES:
        raise LayoutError(f"start offset {start_offset} is absurd")
    return SerialBlock(start_offset, t_ns, length, block[first:])


def pack_edges(
    t_ns_bench: NDArray[np.int64], channel: NDArray[np.uint8], level: NDArray[np.uint8]
) -> bytes:
    return b"".join(
        (
            _EDGES_HEAD.pack(len(t_ns_bench)),
            t_ns_bench.astype("<i8").tobytes(),
            channel.astype(np.uint8).tobytes(),
            level.astype(np.uint8).tobytes(),
        )
    )


def unpack_edges(
    block: memoryview,
) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]:
    """Times, channel indices and levels, each of shape (n,).

    Raises:
        LayoutError: sizes that do not fit, a level above 1.
    """
    if len(block) < _EDGES_HEAD.size:
        raise LayoutError(f"{len(block)} bytes are too few for an edge block")
    (count,) = _EDGES_HEAD.unpack_from(block)
    if count == 0 or _EDGES_HEAD.size + EDGE_BYTES * count != len(block):
        raise LayoutError(f"{count} edges do not fit an edge block of {len(block)} bytes")
    t_ns = np.frombuffer(block, "<i8", count, _EDGES_HEAD.size)
    channel = np.frombuffer(block, np.uint8, count, _EDGES_HEAD.size + 8 * count)
    level = np.frombuffer(block, np.uint8, count, _EDGES_HEAD.size + 9 * count)
    if int(level.max()) > 1:
        raise LayoutError(f"edge level {int(level.max())} is neither 0 nor 1")
    return t_ns, channel, level


def dump_json(value: Any) -> bytes:
    """Raises LayoutError for what :func:`parse_json` would refuse."""
    try:
        data = json.dumps(
            value, allow_nan=False, ensure_ascii=False, separators=(",", ":"), default=_plain
        )
        encoded = data.encode("utf-8")
    except (TypeError, ValueError, RecursionError) as error:
        raise LayoutError(f"not plain JSON data: {error}") from error
    parse_json(encoded)
    return encoded


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} {value!r:.60}")


def parse_json(data: bytes | memoryview) -> dict[str, Any]:
    """One JSON object, bounded: size, depth, finite numbers below 2^64, no lone surrogates.

    Raises:
        LayoutError: anything else.
    """
    if len(data) > MAX_JSON_BYTES:
        raise LayoutError(f"JSON of {len(data)} bytes, the limit is {MAX_JSON_BYTES}")
    try:
        value = json.loads(bytes(data))
    except (ValueError, RecursionError) as error:
        raise LayoutError(f"not JSON: {error}") from error
    if not isinstance(value, dict):
        raise LayoutError("JSON, but not an object")
    _check_plain(value)
    return value


def _check_plain(value: Any) -> None:
    # Iterative, because the depth is what is being checked.
    pending: list[tuple[Any, int]] = [(value, 1)]
    while pending:
        node, depth = pending.pop()
        if depth > MAX_JSON_DEPTH:
            raise LayoutError(f"JSON nested deeper than {MAX_JSON_DEPTH}")
        match node:
            case dict():
                pending.extend((child, depth + 1) for child in node)
                pending.extend((child, depth + 1) for child in node.values())
            case list():
                pending.extend((child, depth + 1) for child in node)
            case str():
                if not node.isascii():
                    _check_unicode(node)
            case float():
                if not math.isfinite(node):
                    raise LayoutError("JSON with a number that is not finite")
            case int():
                if abs(node) >= 1 << 64:
                    raise LayoutError("JSON with a number above 64 bits")


def _check_unicode(text: str) -> None:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise LayoutError("JSON with half a surrogate pair") from error
