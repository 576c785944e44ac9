# SPDX-License-Identifier: Apache-2.0
"""The host's end of a simulated node's serial line.

Bytes come through a pseudoterminal; when they left the node is in a log beside it, which
``firmware/sim/serial_line.c`` writes: little-endian records of ``{u64 bytes sent so far, u64 local
time in us at the end of the last of them}``. Records without new bytes are signs of life.
"""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hil.simulator.tail import Tail

RECORD = np.dtype([("total", "<u8"), ("local_us", "<u8")])
READ_SIZE = 65536


@dataclass(frozen=True)
class Burst:
    """Bytes that left the node together; ``local_us`` is the node's time at the end of the last."""

    local_us: int
    data: bytes


class SerialLine:
    """A pseudoterminal, raw at both ends, and the log of its times.

    Attributes:
        path: the end that the node opens.
        received: bytes read so far.
        sent: bytes that the log says were sent.
        local_us: the node's time in the last record of the log.
    """

    def __init__(self, times: Path) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        # This end of the node's side stays open, so that reading never ends with an error when
        # the node closes its own.
        self.path = os.ttyname(self._slave)
        self.received = 0
        self.sent = 0
        self.local_us = 0
        self._times = Tail(times)
        self._partial = b""
        self._waiting = bytearray()
        self._records: list[tuple[int, int]] = []
        self._delivered = 0

    def bursts(self) -> Iterator[Burst]:
        """Everything that has arrived whole since the last call, in order."""
        self._receive()
        self._read_times()
        complete = 0
        for total, local_us in self._records:
            if total > self.received:
                break
            complete += 1
            count = total - self._delivered
            if count > 0:
                yield Burst(local_us, bytes(self._waiting[:count]))
                del self._waiting[:count]
                self._delivered = total
        del self._records[:complete]

    @property
    def undelivered(self) -> int:
        """Bytes that were sent and did not come out of :meth:`bursts`."""
        return self.sent - self._delivered

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)
        self._times.close()

    def _receive(self) -> None:
        try:
            while data := os.read(self.master, READ_SIZE):
                self._waiting += data
                self.received += len(data)
        except BlockingIOError:
            return

    def _read_times(self) -> None:
        data = self._partial + self._times.read()
        whole = len(data) - len(data) % RECORD.itemsize
        self._partial = data[whole:]
        for total, local_us in np.frombuffer(data[:whole], RECORD).tolist():
            self.sent = total
            self.local_us = local_us
            self._records.append((total, local_us))
