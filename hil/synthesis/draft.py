# SPDX-License-Identifier: Apache-2.0
"""A recording before it is bytes: frames with their times, and edges. Faults are applied here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hil.recording import Edges, ImuTruth, Integrity, SerialStream
from hil.wire.codec import encode, encode_payload
from hil.wire.frames import frame as wire_frame
from hil.wire.messages import BY_NAME

Fate = Literal["sent", "lost", "corrupted", "repeated", "cut"]

LINE_NS_PER_BYTE = 10_000
"""1 Mbaud, ten bits a byte."""


@dataclass
class Frame:
    """One frame of one node: when it was handed to the line, and what became of it there."""

    t_ns: int
    name: str
    values: dict[str, Any]
    fate: Fate = "sent"


@dataclass
class Draft:
    """Frames and text per role, edge times per channel, the IMUs' truth, integrity of the file."""

    frames: dict[str, list[Frame]] = field(default_factory=lambda: {"leader": [], "follower": []})
    raw: dict[str, list[tuple[int, bytes]]] = field(
        default_factory=lambda: {"leader": [], "follower": []}
    )
    edges: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    imu_truth: dict[str, ImuTruth] = field(default_factory=dict)
    edge_resolution_ns: float = 1000.0
    integrity: Integrity = field(default_factory=lambda: Integrity(complete=True))

    def add(self, role: str, t_ns: float, name: str, /, **values: Any) -> None:
        self.frames[role].append(Frame(int(t_ns), name, values))

    def text(self, role: str, t_ns: float, line: str) -> None:
        self.raw[role].append((int(t_ns), line.encode("ascii") + b"\r\n"))

    def of(self, role: str, name: str) -> list[Frame]:
        """The frames of one message, in the order of time."""
        return sorted((f for f in self.frames[role] if f.name == name), key=lambda f: f.t_ns)

    def each(self, role: str, name: str, change: Callable[[dict[str, Any]], None]) -> None:
        """Apply ``change`` to the values of every frame of one message."""
        for frame in self.of(role, name):
            change(frame.values)

    def remove(self, role: str, unwanted: Callable[[Frame], bool]) -> None:
        """Take frames out as if the node had never sent them."""
        self.frames[role] = [f for f in self.frames[role] if not unwanted(f)]

    def serial(self, role: str) -> SerialStream:
        """Encode one node's frames, in the order of time, with sequence numbers."""
        pieces: list[tuple[int, bytes]] = list(self.raw[role])
        for seq, frame in enumerate(sorted(self.frames[role], key=lambda f: f.t_ns)):
            if frame.fate == "lost":
                continue
            data = encode(frame.name, frame.values, seq & 0xFFFF)
            if frame.fate == "corrupted":
                data = _corrupt(data)
            elif frame.fate == "cut":
                payload = encode_payload(frame.name, frame.values)
                data = wire_frame(BY_NAME[frame.name].id, seq & 0xFFFF, payload[:-1])
            pieces += [(frame.t_ns, data)] * (2 if frame.fate == "repeated" else 1)
        pieces.sort(key=lambda piece: piece[0])
        lengths = np.array([len(data) for _, data in pieces], dtype=np.int64)
        handed = np.array([t for t, _ in pieces], dtype=np.int64)
        seen = np.maximum.accumulate(handed + lengths * LINE_NS_PER_BYTE) if handed.size else handed
        return SerialStream(
            data=np.frombuffer(b"".join(data for _, data in pieces), dtype=np.uint8),
            block_offset=np.cumsum(lengths) - lengths,
            block_t_ns_bench=seen,
        )

    def all_edges(self) -> Edges:
        """All channels in one list, ascending; a level toggles at each edge."""
        names = tuple(self.edges)
        times = [np.sort(self.edges[name]) for name in names]
        t = np.concatenate([*times, np.zeros(0, dtype=np.int64)]).astype(np.int64)
        channel = np.repeat(np.arange(len(names)), [x.size for x in times]).astype(np.uint8)
        level = np.concatenate(
            [*((np.arange(x.size) + 1) % 2 for x in times), np.zeros(0, dtype=np.int64)]
        ).astype(np.uint8)
        order = np.argsort(t, kind="stable")
        return Edges(t[order], channel[order], level[order], names, self.edge_resolution_ns)


def _corrupt(frame: bytes) -> bytes:
    """Change one byte in the middle to another that is no delimiter."""
    at = len(frame) // 2
    changed = frame[at] ^ 0x55 or 0xAA
    return frame[:at] + bytes([changed]) + frame[at + 1 :]
