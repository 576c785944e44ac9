# SPDX-License-Identifier: Apache-2.0
"""From sound chunks to a recording: puts blocks in their place and counts what is missing."""

from __future__ import annotations

import json
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from hil.errors import RecordingError, printable
from hil.recording import container, imu_truth_block, json_messages, layout
from hil.recording.container import BAD_RECORD, Problems, Tail
from hil.recording.model import (
    Edges,
    Event,
    ImuTruth,
    Integrity,
    Provenance,
    Recording,
    SerialStream,
)
from hil.wire import schema as wire_schema
from hil.wire.messages import WireError, schema, schema_hash

RECORD_AGAIN: Final = "record the run again: hil record"


@dataclass
class _Track:
    """One channel as far as it was read."""

    next_sequence: int = 0
    blocks: int = 0
    expected: int | None = None

    @property
    def lost(self) -> int:
        """Blocks known to be missing, or present and not usable."""
        return max(self.expected or 0, self.next_sequence) - self.blocks


def _int64s() -> array[int]:
    # Grows in place and holds eight bytes a value, however small the blocks of a file are.
    return array("q")


@dataclass
class _Port:
    data: bytearray = field(default_factory=bytearray)
    t_ns_bench: array[int] = field(default_factory=_int64s)
    length: array[int] = field(default_factory=_int64s)
    stream_end: int = 0
    gap_offset: array[int] = field(default_factory=_int64s)
    gap_bytes: array[int] = field(default_factory=_int64s)


class Assembler:
    """Takes chunks in file order and builds the recording."""

    def __init__(self, tail: Tail, problems: Problems) -> None:
        self._tail = tail
        self._problems = problems
        self._schemas: dict[int, Schema] = dict(tail.schemas)
        self._topics: dict[int, str] = {}
        self._tracks: dict[str, _Track] = {}
        self._ports: dict[str, _Port] = {}
        self._front: dict[str, Any] | None = None
        self._front_bytes = b""
        self._truths: dict[str, imu_truth_block.Gathered] = {}
        self._edge_t_ns = _int64s()
        self._edge_channel = bytearray()
        self._edge_level = bytearray()
        self._events: list[Event] = []
        self._json_bytes = 0
        self._end: dict[str, Any] | None = None
        self._foreign: set[str] = set()
        self._records = 0
        self._sound = True
        for channel in tail.channels.values():
            self._register(channel)

    def take(self, chunk: bytes) -> None:
        try:
            for opcode, body in container.records(chunk):
                self._records += 1
                if self._records > layout.MAX_RECORDS:
                    raise RecordingError(
                        f"holds more than {layout.MAX_RECORDS} records",
                        "no run of a sensible length does; " + RECORD_AGAIN,
                    )
                if opcode == Opcode.MESSAGE:
                    self._message(container.message(body))
                    continue
                match container.describe(opcode, body):
                    case Channel() as channel:
                        self._register(channel)
                    case Schema() as described:
                        self._schemas[described.id] = described
        except BAD_RECORD as error:
            self._problems.add(f"a chunk has a sound checksum and malformed contents: {error}")

    def finish(self, path: Path) -> Recording:
        if self._front is None:
            raise self._no_provenance()
        provenance, edge_channels, resolution_ns = json_messages.read_front(self._front)
        self._check_schema(provenance)
        edges = self._edges(edge_channels, resolution_ns)
        serial = {role: self._stream(role, port) for role, port in self._ports.items()}
        truths = {role: self._truth(role, found) for role, found in self._truths.items()}
        self._expect_counts()
        self._check_end(edges, truths)
        lost = 0
        for topic, track in sorted(self._tracks.items()):
            lost += track.lost
            if track.lost:
                known = max(track.expected or 0, track.next_sequence)
                self._problems.add(f"{topic}: {track.lost} of {known} blocks lost")
        return Recording(
            provenance=provenance,
            serial=serial,
            edges=edges,
            events=tuple(self._events),
            integrity=Integrity(
                complete=self._sound and not lost and self._tail.closed,
                problems=self._problems.texts(),
                lost_blocks=lost,
                blocks=sum(track.blocks for track in self._tracks.values()),
            ),
            path=path,
            imu_truth={role: truth for role, truth in truths.items() if len(truth)},
        )

    def _check_schema(self, provenance: Provenance) -> None:
        try:
            found = _hash_of(provenance.schema)
        except WireError as error:
            self._problems.add(f"the embedded protocol table cannot be used: {error}")
        else:
            if found != provenance.schema_hash:
                self._problems.add("the embedded protocol table does not have the hash it claims")

    def _no_provenance(self) -> RecordingError:
        if self._foreign:
            topics = printable(", ".join(sorted(self._foreign)[:8]))
            return RecordingError(
                f"is an MCAP file, but not a recording of this rig: it holds {topics}",
                "name a recording made by `hil record`",
            )
        said = self._problems.texts()
        return RecordingError(
            "has no readable provenance, so nothing says what its bytes are"
            + (f" ({'; '.join(said[:3])})" if said else ""),
            "it was cut or damaged within its first chunk, or is no recording; " + RECORD_AGAIN,
        )

    def _register(self, channel: Channel) -> None:
        topic = channel.topic
        if self._topics.get(channel.id, topic) != topic:
            self._problems.add(f"channel {channel.id} is described twice, differently")
            return
        if channel.id not in self._topics and topic in self._tracks:
            self._problems.add(f"{topic[:80]!r} is described twice; the second was ignored")
            return
        role = topic.removeprefix(layout.TOPIC_SERIAL)
        truth_role = layout.truth_role(topic)
        if topic == layout.TOPIC_EDGES:
            wanted = (layout.ENCODING_BLOCK, layout.SCHEMA_EDGES)
        elif topic != role and layout.ROLE_PATTERN.fullmatch(role) and self._has_room(role):
            wanted = (layout.ENCODING_BLOCK, layout.SCHEMA_SERIAL)
        elif truth_role and self._has_truth_room(truth_role):
            wanted = (layout.ENCODING_BLOCK, imu_truth_block.SCHEMA_IMU_TRUTH)
        elif topic in (layout.TOPIC_PROVENANCE, layout.TOPIC_EVENTS, layout.TOPIC_END):
            wanted = (layout.ENCODING_JSON, "")
        else:
            self._foreign.add(topic[:80])
            return
        described = self._schemas.get(channel.schema_id)
        found = (channel.message_encoding, described.name if described and wanted[1] else "")
        if found != wanted:
            raise RecordingError(
                f"{topic} has the layout {found[0][:40]!r} {found[1][:40]!r}, "
                f"and this version of hil knows {wanted[0]!r} {wanted[1]!r}",
                "it was written by another version of hil: open it with that one",
            )
        self._topics[channel.id] = topic
        self._tracks.setdefault(topic, _Track())
        if wanted[1] == layout.SCHEMA_SERIAL:
            self._ports.setdefault(role, _Port())
        elif wanted[1] == imu_truth_block.SCHEMA_IMU_TRUTH:
            self._truths.setdefault(truth_role, imu_truth_block.Gathered())

    def _has_room(self, role: str) -> bool:
        return role in self._ports or len(self._ports) < layout.MAX_ROLES

    def _has_truth_room(self, role: str) -> bool:
        return role in self._truths or len(self._truths) < layout.MAX_ROLES

    def _message(self, message: container.Message) -> None:
        topic = self._topics.get(message.channel_id)
        if topic is None:
            named = ", ".join(sorted(self._foreign)[:8])
            self._problems.add(
                f"blocks of a channel that recordings do not have were ignored: {named}"
                if named
                else f"channel {message.channel_id} is not described; its blocks were ignored"
            )
            return
        track = self._tracks[topic]
        if message.sequence < track.next_sequence:
            self._problems.add(f"{topic}: a block is repeated or out of order and was ignored")
            return
        track.next_sequence = message.sequence + 1
        try:
            self._use(topic, message.data)
        except layout.LayoutError as error:
            self._problems.add(f"{topic}: block {message.sequence} was refused: {error}")
        else:
            track.blocks += 1

    def _use(self, topic: str, data: memoryview) -> None:
        if topic == layout.TOPIC_PROVENANCE:
            if self._front is None:
                self._front = self._json(data)
                self._front_bytes = bytes(data)
            elif data != self._front_bytes:
                raise layout.LayoutError("it differs from the first copy")
        elif topic == layout.TOPIC_EVENTS:
            self._events.append(json_messages.read_event(self._json(data)))
        elif topic == layout.TOPIC_END:
            self._end = self._json(data)
        elif topic == layout.TOPIC_EDGES:
            t_ns, index, level = layout.unpack_edges(data)
            self._edge_t_ns.frombytes(t_ns.astype(np.int64).tobytes())
            self._edge_channel += index.tobytes()
            self._edge_level += level.tobytes()
        elif role := layout.truth_role(topic):
            self._truths[role].add(imu_truth_block.unpack(data))
        else:
            self._serial(topic, layout.unpack_serial(data))

    def _json(self, data: memoryview) -> dict[str, Any]:
        self._json_bytes += len(data)
        if self._json_bytes > layout.MAX_ALL_JSON_BYTES:
            raise layout.LayoutError(f"more than {layout.MAX_ALL_JSON_BYTES} bytes of JSON in all")
        return layout.parse_json(data)

    def _serial(self, topic: str, block: layout.SerialBlock) -> None:
        port = self._ports[topic.removeprefix(layout.TOPIC_SERIAL)]
        missing = block.start_offset - port.stream_end
        if missing < 0:
            raise layout.LayoutError("it overlaps the block before it")
        if missing:
            port.gap_offset.append(len(port.data))
            port.gap_bytes.append(missing)
            self._problems.add(
                f"{topic}: {missing} bytes lost after byte {port.stream_end} of the stream"
            )
        port.data += block.data
        port.t_ns_bench.frombytes(block.t_ns_bench.astype(np.int64).tobytes())
        port.length.frombytes(block.length.tobytes())
        port.stream_end = block.start_offset + len(block.data)

    def _stream(self, role: str, port: _Port) -> SerialStream:
        t_ns, length = _array(port.t_ns_bench), _array(port.length)
        back = int(np.count_nonzero(t_ns[1:] < t_ns[:-1]))
        if back:
            self._problems.add(f"{layout.TOPIC_SERIAL}{role}: time goes back {back} times")
        return SerialStream(
            # A read-only buffer, so that nobody can turn writing back on.
            data=np.frombuffer(memoryview(port.data).toreadonly(), np.uint8),
            block_offset=np.cumsum(length) - length,
            block_t_ns_bench=t_ns,
            gap_offset=_array(port.gap_offset),
            gap_bytes=_array(port.gap_bytes),
        )

    def _truth(self, role: str, found: imu_truth_block.Gathered) -> ImuTruth:
        s = found.slots()
        number = s.run.astype(np.int64) << 32 | s.slot
        back = (s.t_us_true[1:] < s.t_us_true[:-1]) | (number[1:] <= number[:-1])
        if np.any(back):
            times = int(np.count_nonzero(back))
            self._problems.add(f"{layout.truth_topic(role)}: time or slot goes back {times} times")
        return ImuTruth(s.run, s.slot, s.t_us_true, s.counts, s.flags)

    def _edges(self, channels: tuple[str, ...], resolution_ns: float) -> Edges:
        t_ns = _array(self._edge_t_ns)
        index = np.frombuffer(memoryview(self._edge_channel).toreadonly(), np.uint8)
        level = np.frombuffer(memoryview(self._edge_level).toreadonly(), np.uint8)
        known = index < len(channels)
        if not known.all():
            stray = int(np.count_nonzero(~known))
            self._problems.add(f"{layout.TOPIC_EDGES}: {stray} edges of channels without a name")
            self._sound = False
            t_ns, index, level = t_ns[known], index[known], level[known]
        if np.any(t_ns[1:] < t_ns[:-1]):
            # Channels may be written one after the other; within one, time must not go back.
            for number, name in enumerate(channels):
                own = t_ns[index == number]
                back = int(np.count_nonzero(own[1:] < own[:-1]))
                if back:
                    self._problems.add(
                        f"{layout.TOPIC_EDGES}: time of {name} goes back {back} times"
                    )
            # Stable: edges of one instant keep the order they were seen in.
            order = np.argsort(t_ns, kind="stable")
            t_ns, index, level = t_ns[order], index[order], level[order]
        return Edges(t_ns, index, level, channels, resolution_ns)

    def _expect_counts(self) -> None:
        """How many blocks there were, from the end message or else from the statistics."""
        if self._end is None:
            self._problems.add("the message that ends a recording is missing")
            self._sound = False
            counts: dict[Any, Any] = {
                self._topics[i]: n for i, n in self._tail.counts.items() if i in self._topics
            }
        else:
            counts = {**json_messages.mapping(self._end, "blocks"), layout.TOPIC_END: 1}
        for topic, track in self._tracks.items():
            count = counts.get(topic)
            track.expected = count if json_messages.is_count(count) else None
            unproven = track.expected is None or track.next_sequence > track.expected
            if self._end is not None and unproven:
                self._problems.add(f"{topic}: the message that ends the recording counts wrongly")
                self._sound = False

    def _check_end(self, edges: Edges, truths: Mapping[str, ImuTruth]) -> None:
        """Compare contents with the end message."""
        if self._end is None:
            return
        lengths = json_messages.mapping(self._end, "bytes")
        for role, port in self._ports.items():
            self._compare(
                f"{layout.TOPIC_SERIAL}{role}", "bytes", len(port.data), lengths.get(role)
            )
        self._compare(layout.TOPIC_EDGES, "edges", len(edges.t_ns_bench), self._end.get("edges"))
        slots = json_messages.mapping(self._end, "truth")
        for role, truth in truths.items():
            self._compare(layout.truth_topic(role), "slots", len(truth), slots.get(role))
        aborted = self._end.get("aborted")
        if aborted:
            self._problems.add(f"the run was aborted: {str(aborted)[:500]}")
            self._sound = False

    def _compare(self, topic: str, what: str, found: int, written: Any) -> None:
        if found != written:
            self._problems.add(f"{topic}: {found} of {str(written)[:20]} {what} are here")
            self._sound = False


@cache
def _present_table() -> tuple[Mapping[str, Any], str]:
    return json.loads(json.dumps(schema())), f"{schema_hash():016x}"


def _hash_of(table: Mapping[str, Any]) -> str:
    """Raises WireError when it is no protocol table."""
    present, present_hash = _present_table()
    # Nearly every recording holds the present table; comparing is much faster than hashing.
    if table == present:
        return present_hash
    return f"{schema_hash(wire_schema.parse(table)):016x}"


def _array(values: array[int]) -> NDArray[np.int64]:
    return np.frombuffer(memoryview(values).toreadonly(), np.int64)
