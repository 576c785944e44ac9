# SPDX-License-Identifier: Apache-2.0
"""The changes of a simulated node's pins, as a logic analyser on the bench clock would see them.

The simulator logs ``time(us),port,pin,level`` in the node's local time.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.errors import RigError
from hil.recording import EDGE_CHANNELS, ClockModel
from hil.simulator.tail import Tail

PINS: Mapping[tuple[int, int], str] = {
    (1, 2): "radio_end",
    (1, 3): "pulse",
    (1, 5): "imu_int1",
}
"""(port, pin) -> signal; boards/pins.dtsi has the same."""

NS_PER_US = 1000

Changes = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
"""Times in ns on the bench clock, indices into EDGE_CHANNELS, levels after the change."""


class PinLog:
    """Reads one node's log while it grows."""

    def __init__(self, path: Path, role: str, clock: ClockModel) -> None:
        self._path = path
        self._tail = Tail(path)
        self._partial = b""
        self._clock = clock
        self._channels = {
            pin: EDGE_CHANNELS.index(f"{role}.{signal}") for pin, signal in PINS.items()
        }

    def changes(self) -> Changes:
        """What was logged since the last call, of the pins that have a channel.

        Raises:
            RigError: a line that is not as the simulator writes it.
        """
        *lines, self._partial = (self._partial + self._tail.read()).split(b"\n")
        rows = [row for line in lines if (row := self._parse(line)) is not None]
        table = np.array(rows, dtype=np.int64).reshape(-1, 3)
        true_us = self._clock.true_us(table[:, 0].astype(np.float64))
        t_ns_bench = np.rint(true_us * NS_PER_US).astype(np.int64)
        return t_ns_bench, table[:, 1], table[:, 2]

    def close(self) -> None:
        self._tail.close()

    def _parse(self, line: bytes) -> tuple[int, int, int] | None:
        if line.startswith(b"time"):
            return None
        try:
            local_us, port, pin, level = (int(part) for part in line.split(b","))
        except ValueError as error:
            raise RigError(f"{self._path}: not a line of the pin log: {line!r}") from error
        channel = self._channels.get((port, pin))
        return None if channel is None else (local_us, channel, level)
