# SPDX-License-Identifier: Apache-2.0
"""What a port has said so far, counted while it comes in; bounded memory, nothing ever raised."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hil.bench.listen import fields
from hil.wire.codec import Decoded
from hil.wire.continuity import continuity
from hil.wire.live import LiveStream
from hil.wire.messages import ROLES, schema_hash

NS_PER_S: Final = 1_000_000_000
RATE_SPAN_NS: Final = 2 * NS_PER_S
"""Rates are means over the last so long."""
SILENT_S: Final = 3.0
"""HELLO comes every two seconds: a node's port that says nothing for longer is the wrong one."""
TAIL_MAX: Final = 1024
SHOWN_MAX: Final = 160


@dataclass(frozen=True)
class Rates:
    """Per second, over the last :data:`RATE_SPAN_NS`."""

    bytes: float
    frames: float
    lines: float


class Meter:
    """Counts of one port.

    Attributes:
        bytes, frames, lines, damaged, lost, restarts: since the start.
        damaged_are, lost_are: what these two count.
        messages: name -> frames.
        last_line: the last line of text.
        hello: fields of the last HELLO, raw.
    """

    damaged_are: str = "CRC errors"
    lost_are: str = "frames lost"
    wrong_port: str = (
        "a DK has two ports, the other is the one next to it (vcom in the bench file); "
        "is the board switched on?"
    )

    def __init__(self, role: str, t_ns: int) -> None:
        self.role = role
        self.bytes = self.frames = self.lines = 0
        self.damaged = self.lost = self.restarts = 0
        self.messages: Counter[str] = Counter()
        self.last_line = ""
        self.hello: Mapping[str, Any] | None = None
        self._stream = LiveStream()
        self._delimited = False
        self._tail = b""
        self._last: tuple[int, int] | None = None
        self._heard_ns = t_ns
        self._past: deque[tuple[int, int, int, int]] = deque([(t_ns, 0, 0, 0)])

    def feed(self, t_ns: int, data: bytes) -> None:
        """Take what one read brought at ``t_ns``."""
        self.bytes += len(data)
        self._heard_ns = t_ns
        if not self._delimited:
            # Without any 00 there are no frames: lines end where their line ends.
            text, zero, rest = data.partition(b"\0")
            self._read_lines(text)
            self._delimited = bool(zero)
            data = zero + rest
        if self._delimited:
            self._count(self._stream.feed(data))

    def interrupted(self) -> None:
        """The port was gone: what comes next does not follow what came before."""
        self._stream = LiveStream()
        self._delimited = False
        self._tail = b""

    def rates(self, t_ns: int) -> Rates:
        """Rates up to ``t_ns``; to be asked a few times a second."""
        self._past.append((t_ns, self.bytes, self.frames, self.lines))
        while len(self._past) > 2 and self._past[1][0] <= t_ns - RATE_SPAN_NS:
            self._past.popleft()
        then = self._past[0]
        span_s = max(t_ns - then[0], 1) / NS_PER_S
        counts = (self.bytes - then[1], self.frames - then[2], self.lines - then[3])
        return Rates(*(count / span_s for count in counts))

    def hint(self, t_ns: int) -> str:
        """What may be wrong with the port; empty when it speaks as a node does."""
        silent_s = (t_ns - self._heard_ns) / NS_PER_S
        if silent_s > SILENT_S:
            since = f"silent for {silent_s:.0f} s"
            return f"{since}: {self.wrong_port}" if not self.bytes else since
        if self.bytes > 1000 and not self.frames and not self.lines:
            return (
                f"{self.bytes} bytes are neither frames nor text: is the baud rate right, and is "
                "this the board's port?"
            )
        return self._mistaken()

    def _mistaken(self) -> str:
        if self.hello is None:
            return ""
        if self.role in ROLES and self.hello["role"] != ROLES[self.role]:
            return f"it says that it is not the {self.role}: are the two ports swapped?"
        if self.hello["schema_hash"] != schema_hash():
            return (
                f"it speaks protocol table {self.hello['schema_hash']:016x}, not this rig's "
                f"{schema_hash():016x}: its frames may be misread"
            )
        return ""

    def read_line(self, line: bytes) -> None:
        """Take one line of a port that has sent no frame yet."""
        text = line.strip()
        if text and text.isascii() and text.decode("ascii").isprintable():
            self.lines += 1
            self.last_line = text[:SHOWN_MAX].decode("ascii")

    def _read_lines(self, text: bytes) -> None:
        *ended, self._tail = (self._tail + text).split(b"\n")
        self._tail = self._tail[-TAIL_MAX:]
        for line in ended:
            self.read_line(line)

    def _count(self, found: Decoded) -> None:
        self.frames += found.stats.frames
        self.damaged += found.stats.crc_errors
        self.lines += len(found.text)
        if found.text:
            self.last_line = found.text[-1].text[:SHOWN_MAX]
        came = {name: rows for name, rows in found.messages.items() if len(rows)}
        self.messages.update({name: len(rows) for name, rows in came.items()})
        if "hello" in came:
            self.hello = fields(came["hello"][-1])
        if came:
            self._count_lost(came)

    def _count_lost(self, came: Mapping[str, Any]) -> None:
        """Losses within these frames, and between them and the frame before."""
        offset = np.concatenate([rows["offset"] for rows in came.values()])
        order = np.argsort(offset, kind="stable")
        seq = np.concatenate([rows["seq"] for rows in came.values()])[order]
        hellos = came.get("hello")
        index = np.zeros(0, np.int64)
        uptime_ms = np.zeros(0, np.int64)
        if hellos is not None:
            index = np.searchsorted(offset[order], hellos["offset"])
            uptime_ms = hellos["uptime_ms"].astype(np.int64)
        if self._last is not None:
            # The frame before stands for a HELLO of the uptime last heard.
            last_seq, last_uptime_ms = self._last
            seq = np.concatenate([np.array([last_seq], np.uint16), seq])
            index = index + 1
            if last_uptime_ms >= 0 and len(index):
                index = np.concatenate([np.zeros(1, np.int64), index])
                uptime_ms = np.concatenate([np.array([last_uptime_ms], np.int64), uptime_ms])
        numbers = continuity(seq, index, uptime_ms)
        self.lost += numbers.lost
        self.restarts += numbers.restarts
        known = int(uptime_ms[-1]) if len(uptime_ms) else (self._last or (0, -1))[1]
        self._last = int(seq[-1]), known
