# SPDX-License-Identifier: Apache-2.0
"""A string pot's port while it is logged: samples, and losses by their times."""

from __future__ import annotations

from hil.log.meter import Meter
from hil.stringpot.samples import Reader


class PotMeter(Meter):
    """As :class:`Meter`; ``lost`` are samples, ``damaged`` lines that are no sample."""

    damaged_are = "bad lines"
    lost_are = "samples lost"
    wrong_port = "is it the ESP32's port, and has it power?"

    def __init__(self, role: str, t_ns: int) -> None:
        super().__init__(role, t_ns)
        self._reader = Reader()

    def read_line(self, line: bytes) -> None:
        super().read_line(line)
        self._reader.line(line)
        if self.lines % 1000 == 0:
            self._reader.take()
        self.lost, self.damaged = self._reader.lost, self._reader.bad_lines
        self.restarts = self._reader.restarts
