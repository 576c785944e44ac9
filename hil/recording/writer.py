# SPDX-License-Identifier: Apache-2.0
"""Writing a recording while the run goes on, so that a crash costs at most the last chunk."""

from __future__ import annotations

import os
import secrets
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import mcap.writer
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.atomic import take_name
from hil.errors import RecordingError
from hil.recording import imu_truth_block, json_messages, layout
from hil.recording.model import EDGE_CHANNELS, Event, Provenance
from hil.wire.messages import ROLES

_EdgeArrays = tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]


@dataclass
class _Channel:
    id: int
    blocks: int = 0


@dataclass
class _Port:
    """One serial stream: where it stands and the reads not yet in a block."""

    written: int = 0
    pending: int = 0
    t_ns_bench: list[int] = field(default_factory=list)
    reads: list[bytes] = field(default_factory=list)


class Writer:
    """Writes one recording; a context manager.

    Leaving the context after an exception closes the file properly and marks the run as
    aborted. Every method may be called from any thread.

    Args:
        path: the ``.mcap`` to create; an existing file is never overwritten.
        provenance: written at once, and again at the end as a spare copy.
        roles: whose serial ports are recorded.
        edge_channels: what the channel indices of :meth:`write_edges` mean.
        edge_resolution_ns: width of the grid the edge times lie on; the default is the
            microsecond of the simulated bench.

    Raises:
        RecordingError: from every method: the file exists or cannot be written, or an
            argument cannot be recorded. After a failed write the file keeps what was in it.
    """

    def __init__(
        self,
        path: Path | str,
        provenance: Provenance,
        *,
        roles: Sequence[str] = tuple(ROLES),
        edge_channels: Sequence[str] = EDGE_CHANNELS,
        edge_resolution_ns: float = 1000.0,
    ) -> None:
        self.path = Path(path)
        if len(roles) > layout.MAX_ROLES:
            raise RecordingError(f"more than {layout.MAX_ROLES} serial ports in one recording")
        for role in roles:
            if not layout.ROLE_PATTERN.fullmatch(role):
                raise RecordingError(f"{role!r} cannot be a role", "use lower-case letters")
        if not json_messages.are_edge_channels(edge_channels):
            raise RecordingError(
                "an edge channel has no usable name, or there are too many",
                f"up to {layout.MAX_EDGE_CHANNELS} names such as leader.pulse",
            )
        if not json_messages.is_resolution(edge_resolution_ns):
            raise RecordingError(f"an edge resolution of {edge_resolution_ns!r} ns is none")
        self._lock = threading.RLock()
        self._closed = False
        self._broken = False
        self._unflushed = 0
        self._chunks = 0
        self._flushed_s = time.monotonic()
        self._ports = {role: _Port() for role in roles}
        self._edge_channels = tuple(edge_channels)
        self._edges: list[_EdgeArrays] = []
        self._edges_pending = 0
        self._edges_written = 0
        self._truths = {role: imu_truth_block.Pending() for role in roles}
        self._front = self._json(json_messages.front(provenance, edge_channels, edge_resolution_ns))
        self._open()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close(aborted="" if kind is None else f"{kind.__name__}: {error}"[:500])

    def write_serial(self, role: str, t_ns_bench: int, data: bytes) -> None:
        """Append what one read of the port of ``role`` returned at ``t_ns_bench``."""
        with self._lock:
            self._check_open()
            port = self._ports.get(role)
            if port is None:
                raise RecordingError(
                    f"{self.path}: not recording the serial port of '{role}'",
                    "roles: " + ", ".join(self._ports),
                )
            t_ns_bench = json_messages.time_ns(t_ns_bench)
            for start in range(0, len(data), layout.READ_BYTES_MAX):
                piece = bytes(data[start : start + layout.READ_BYTES_MAX])
                port.t_ns_bench.append(t_ns_bench)
                port.reads.append(piece)
                port.pending += len(piece)
                self._unflushed += len(piece)
                if port.pending >= layout.BLOCK_BYTES:
                    self._close_serial_block(role, port)
                # In the loop: a chunk must stay below what the reader accepts.
                self._flush_when_due()

    def write_edges(self, t_ns_bench: ArrayLike, channel: ArrayLike, level: ArrayLike) -> None:
        """Append edges: times in ns, indices into ``edge_channels``, levels after; shape (n,)."""
        try:
            t_ns, index, high = map(_whole, (t_ns_bench, channel, level))
        except (TypeError, ValueError, OverflowError) as error:
            raise RecordingError(f"edges are not arrays of whole numbers: {error}") from error
        if not t_ns.shape == index.shape == high.shape or t_ns.ndim != 1:
            raise RecordingError("edges need three arrays of one length")
        if not len(t_ns):
            return
        if index.min() < 0 or index.max() >= len(self._edge_channels):
            raise RecordingError(
                f"edge channel index outside 0..{len(self._edge_channels) - 1}",
                "channels: " + ", ".join(self._edge_channels),
            )
        if high.min() < 0 or high.max() > 1:
            raise RecordingError("an edge level is neither 0 nor 1")
        with self._lock:
            self._check_open()
            for start in range(0, len(t_ns), layout.EDGES_PER_BLOCK):
                part = slice(start, start + layout.EDGES_PER_BLOCK)
                piece = (t_ns[part], index[part].astype(np.uint8), high[part].astype(np.uint8))
                self._edges.append(piece)
                self._edges_pending += len(piece[0])
                self._unflushed += layout.EDGE_BYTES * len(piece[0])
                if self._edges_pending >= layout.EDGES_PER_BLOCK:
                    self._close_edge_block()
                self._flush_when_due()
            self._edges_written += len(t_ns)

    def write_imu_truth(  # noqa: PLR0917 (the columns of ImuTruth, in its order)
        self,
        role: str,
        run: ArrayLike,
        slot: ArrayLike,
        t_us_true: ArrayLike,
        counts: ArrayLike,
        flags: ArrayLike,
    ) -> None:
        """Append slots of the simulated IMU of ``role``, as :class:`ImuTruth` describes them.

        ``counts`` has shape (n, 6), the others (n,); an empty piece is no error. Times are kept
        to 1 ns.
        """
        try:
            taken = imu_truth_block.slots(run, slot, t_us_true, counts, flags)
        except (TypeError, ValueError, OverflowError) as error:
            raise RecordingError(f"the truth of an IMU cannot be recorded: {error}") from error
        with self._lock:
            self._check_open()
            pending = self._truths.get(role)
            if pending is None:
                raise RecordingError(
                    f"{self.path}: not recording the IMU of '{role}'",
                    "roles: " + ", ".join(self._truths),
                )
            size = imu_truth_block.SLOTS_PER_BLOCK
            for start in range(0, len(taken), size):
                piece = taken.part(start, start + size)
                pending.add(piece)
                self._unflushed += imu_truth_block.SLOT_BYTES * len(piece)
                if pending.size >= size:
                    self._close_truth_blocks(role, pending)
                # In the loop: a chunk must stay below what the reader accepts.
                self._flush_when_due()

    def write_event(self, event: Event) -> None:
        """Append one event; its ``data`` must be plain JSON data."""
        body = self._json(json_messages.event(event))
        with self._lock:
            self._check_open()
            self._add(layout.TOPIC_EVENTS, int(event.t_ns_bench), body)
            self._unflushed += len(body)
            self._flush_when_due()

    @property
    def chunks(self) -> int:
        """Closed so far; the file's index grows by an entry with each."""
        return self._chunks

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the operating system.

        Called by the writer itself after 256 KiB, and after a second while bytes arrive; a
        capture loop that goes idle calls it to have the last bytes safe.
        """
        with self._lock:
            self._check_open()
            self._flush()

    def close(self, aborted: str = "") -> None:
        """Write what makes the recording provably complete, and close. Safe to repeat.

        Args:
            aborted: why the run ended early; such a recording never counts as complete.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
            try:
                if not self._broken:
                    self._finish(aborted)
            finally:
                self._close_file()

    def _close_file(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            # After a failed write the buffer cannot be flushed either; that was reported then.
            if not self._broken:
                raise self._cannot_write(error) from error

    def _open(self) -> None:
        """Make the file; it gets its name when it holds its first chunk, and can be read."""
        if os.path.lexists(self.path):
            raise self._exists()
        unnamed = self.path.parent / f".{self.path.name}.{secrets.token_hex(4)}"
        try:
            try:
                self._file = unnamed.open("xb")
            except (OSError, ValueError) as error:
                raise self._cannot_write(error) from error
            self._begin()
            try:
                take_name(unnamed, self.path)
            except FileExistsError as error:
                self._close_file()
                raise self._exists() from error
            except OSError as error:
                self._close_file()
                raise self._cannot_write(error) from error
        finally:
            with suppress(OSError, ValueError):
                unnamed.unlink(missing_ok=True)

    def _begin(self) -> None:
        try:
            with self._mending():
                self._mcap = mcap.writer.Writer(
                    # Chunks are closed by _flush, which also empties the file's buffer.
                    self._file,
                    chunk_size=1 << 40,
                    enable_data_crcs=True,
                )
                self._mcap.start(profile=layout.PROFILE, library="hil")
                self._channels = self._register()
            self._add(layout.TOPIC_PROVENANCE, 0, self._front)
            self._flush()
        except RecordingError:
            self._close_file()
            raise

    def _register(self) -> dict[str, _Channel]:
        """All channels at once, so that the first chunk describes the whole file."""

        def schema(name: str, encoding: str, text: str) -> int:
            return int(self._mcap.register_schema(name, encoding, text.encode()))

        json_id = schema("hil.json.v1", "jsonschema", '{"type":"object"}')
        serial_id = schema(layout.SCHEMA_SERIAL, "x-hil-layout", layout.LAYOUT_SERIAL)
        edges_id = schema(layout.SCHEMA_EDGES, "x-hil-layout", layout.LAYOUT_EDGES)
        truth_id = schema(
            imu_truth_block.SCHEMA_IMU_TRUTH, "x-hil-layout", imu_truth_block.LAYOUT_IMU_TRUTH
        )
        topics = {
            layout.TOPIC_PROVENANCE: (layout.ENCODING_JSON, json_id),
            layout.TOPIC_EDGES: (layout.ENCODING_BLOCK, edges_id),
            layout.TOPIC_EVENTS: (layout.ENCODING_JSON, json_id),
            layout.TOPIC_END: (layout.ENCODING_JSON, json_id),
        }
        for role in self._ports:
            topics[layout.TOPIC_SERIAL + role] = (layout.ENCODING_BLOCK, serial_id)
            topics[layout.truth_topic(role)] = (layout.ENCODING_BLOCK, truth_id)
        return {
            topic: _Channel(self._mcap.register_channel(topic, encoding, schema_id))
            for topic, (encoding, schema_id) in topics.items()
        }

    def _add(self, topic: str, t_ns_bench: int, block: bytes) -> None:
        channel = self._channels[topic]
        # MCAP times are unsigned; the block itself keeps a time before the start of the run.
        log_time = max(t_ns_bench, 0)
        self._mcap.add_message(channel.id, log_time, block, log_time, channel.blocks)
        channel.blocks += 1

    def _close_serial_block(self, role: str, port: _Port) -> None:
        if not port.reads:
            return
        block = layout.pack_serial(port.written, port.t_ns_bench, port.reads)
        self._add(layout.TOPIC_SERIAL + role, port.t_ns_bench[0], block)
        port.written += port.pending
        port.pending = 0
        port.t_ns_bench.clear()
        port.reads.clear()

    def _close_edge_block(self) -> None:
        if not self._edges:
            return
        t_ns, index, level = (np.concatenate(column) for column in zip(*self._edges, strict=True))
        self._add(layout.TOPIC_EDGES, int(t_ns[0]), layout.pack_edges(t_ns, index, level))
        self._edges.clear()
        self._edges_pending = 0

    def _close_truth_blocks(self, role: str, pending: imu_truth_block.Pending) -> None:
        for t_us_true, block in pending.take():
            self._add(layout.truth_topic(role), round(1e3 * t_us_true), block)

    def _flush_when_due(self) -> None:
        if self._unflushed < layout.CHUNK_BYTES:
            late = time.monotonic() - self._flushed_s >= layout.FLUSH_S
            if not (late and self._unflushed):
                return
        self._flush()

    def _flush(self) -> None:
        for role, port in self._ports.items():
            self._close_serial_block(role, port)
        self._close_edge_block()
        for role, pending in self._truths.items():
            self._close_truth_blocks(role, pending)
        with self._mending():
            self._mcap.flush()  # type: ignore[no-untyped-call]
        self._chunks += 1
        self._unflushed = 0
        self._flushed_s = time.monotonic()

    def _finish(self, aborted: str) -> None:
        self._flush()
        # Chunks of their own: one bad sector cannot take the data and its proof.
        self._add(layout.TOPIC_PROVENANCE, 0, self._front)
        self._flush()
        end = {
            "blocks": {
                topic: channel.blocks
                for topic, channel in self._channels.items()
                if topic != layout.TOPIC_END
            },
            "bytes": {role: port.written for role, port in self._ports.items()},
            "edges": self._edges_written,
            "truth": {role: pending.written for role, pending in self._truths.items()},
            "aborted": aborted.encode("utf-8", "replace").decode(),
        }
        self._add(layout.TOPIC_END, 0, self._json(end))
        with self._mending():
            self._mcap.finish()  # type: ignore[no-untyped-call]
            self._file.flush()
            os.fsync(self._file.fileno())

    def _check_open(self) -> None:
        if self._closed or self._broken:
            state = "closed" if self._closed else "unusable after a failed write"
            raise RecordingError(f"{self.path}: the recording is {state}")

    @contextmanager
    def _mending(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._broken = True
            raise self._cannot_write(error) from error

    def _exists(self) -> RecordingError:
        return RecordingError(
            f"{self.path}: exists already, and a recording is never overwritten",
            "choose another name, or remove the file first",
        )

    def _cannot_write(self, error: OSError | ValueError) -> RecordingError:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        return RecordingError(
            f"{self.path}: cannot be written: {reason}",
            "see that the folder exists, is writable and has room",
        )

    def _json(self, value: dict[str, Any]) -> bytes:
        try:
            return layout.dump_json(value)
        except layout.LayoutError as error:
            raise RecordingError(f"{self.path}: cannot be recorded: {error}") from error


def _whole(values: ArrayLike) -> NDArray[np.int64]:
    """Raises TypeError or OverflowError instead of rounding or wrapping."""
    array = np.atleast_1d(np.asarray(values))
    if array.dtype == np.uint64 and array.size and int(array.max()) >= 1 << 63:
        raise OverflowError("a time above 63 bits")
    return array.astype(np.int64, casting="same_kind" if array.size else "unsafe")
