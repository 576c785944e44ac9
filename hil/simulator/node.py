# SPDX-License-Identifier: Apache-2.0
"""One simulated node: its program, its serial line, its pins, its clock and its sensor's truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hil.process import Child
from hil.recording import ClockModel
from hil.simulator import arguments
from hil.simulator.imu_truth import Rows, TruthLog
from hil.simulator.pins import NS_PER_US, Changes, PinLog
from hil.simulator.serial_line import SerialLine


class Node:
    """Everything that belongs to ``role``; :meth:`attach` gives it its running program."""

    def __init__(self, role: str, clock: ClockModel, folder: Path) -> None:
        self.role = role
        self.clock = clock
        self.line = SerialLine(arguments.times_file(folder, role))
        self._pins = PinLog(arguments.pins_file(folder, role), role, clock)
        self._int1 = PinLog(arguments.int1_file(folder, role), role, clock)
        self._truth = TruthLog(arguments.truth_file(folder, role))
        self._child: Child | None = None

    @property
    def child(self) -> Child:
        assert self._child is not None
        return self._child

    def attach(self, child: Child) -> None:
        self._child = child

    @property
    def true_s(self) -> float:
        """True simulated time that the node was last known to have reached."""
        return float(self.clock.true_us(self.line.local_us)) * 1e-6 if self.line.local_us else 0.0

    def serial(self) -> Iterator[tuple[int, bytes]]:
        """New bytes with the bench time, ns, at which the last of them had left the node."""
        bursts = list(self.line.bursts())
        local_us = np.array([burst.local_us for burst in bursts], dtype=np.float64)
        t_ns_bench = np.rint(self.clock.true_us(local_us) * NS_PER_US).astype(np.int64)
        yield from zip(t_ns_bench.tolist(), (burst.data for burst in bursts), strict=True)

    def changes(self) -> Iterator[Changes]:
        """New changes of the pins, and of the sensor's interrupt pin."""
        yield self._pins.changes()
        yield self._int1.changes()

    def imu_truth(self) -> Rows:
        """New slots of the sensor: what it sampled, and when."""
        return self._truth.rows()

    def close(self) -> None:
        self.line.close()
        self._pins.close()
        self._int1.close()
        self._truth.close()
