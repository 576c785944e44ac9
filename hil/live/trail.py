# SPDX-License-Identifier: Apache-2.0
"""The last half minute of a signal, as points that browsers draw."""

from __future__ import annotations

from collections import deque
from itertools import islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, GYRO_RADPS_PER_LSB_PER_DPS
from hil.wire.codec import Decoded, physical

SPAN_S: Final = 30.0
BIN_S: Final = 0.02
"""IMU samples are shown as means of such spans: 50 points a second whatever the sensor's rate."""
BREAK_S: Final = 0.25
"""A line is not drawn across a longer pause."""
POINTS_MAX: Final = 4096

Point = list[float | None]


class Trail:
    """Points ``[t, values...]`` of the last ``SPAN_S``, counted from the first that ever came.

    Attributes:
        total: points so far, gone ones included.
    """

    def __init__(self, width: int, digits: int) -> None:
        self.total = 0
        self._width = width
        self._digits = digits
        self._points: deque[Point] = deque()
        self._t_s = float("nan")

    @property
    def t_s(self) -> float:
        """Time of the last point; NaN without one."""
        return self._t_s

    def add(self, t_s: float, values: list[float]) -> None:
        """One more point; values that are no numbers leave a hole."""
        if t_s - self._t_s > BREAK_S:
            self._push([round(t_s, 4), *[None] * self._width])
        shown = [round(v, self._digits) if np.isfinite(v) else None for v in values]
        self._push([round(t_s, 4), *shown])
        self._t_s = t_s

    def since(self, total: int) -> list[Point]:
        """What came after the first ``total`` points, as far as it is still there."""
        new = min(self.total - total, len(self._points))
        return list(islice(self._points, len(self._points) - new, None))

    def _push(self, point: Point) -> None:
        self._points.append(point)
        self.total += 1
        oldest = (point[0] or 0.0) - SPAN_S
        while len(self._points) > POINTS_MAX or (self._points[0][0] or 0.0) < oldest:
            self._points.popleft()


class ImuTrail(Trail):
    """Specific force and angular rate of one node: x y z in m/s^2, then x y z in deg/s."""

    def __init__(self) -> None:
        super().__init__(6, 2)
        self._bin = -1
        self._sum = np.zeros(6)
        self._count = 0

    def take(self, t_s: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """Samples in order of time.

        Args:
            t_s: (n,).
            values: (n, 6), in the units of the trail.
        """
        number = np.floor(t_s / BIN_S).astype(np.int64)
        begins = np.flatnonzero(np.diff(number, prepend=number[:1] - 1))
        sums = np.add.reduceat(values, begins, axis=0)
        counts = np.diff(begins, append=len(number))
        for bin_, total, count in zip(number[begins].tolist(), sums, counts.tolist(), strict=True):
            if bin_ != self._bin:
                self._close()
                self._bin = bin_
            self._sum = self._sum + total
            self._count += count

    def _close(self) -> None:
        if self._count:
            self.add((self._bin + 0.5) * BIN_S, (self._sum / self._count).tolist())
        self._sum, self._count = np.zeros(6), 0


def samples(
    found: Decoded,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The samples of IMU batches.

    Returns:
        For each sample: the index of its batch; its time in ticks of the clock of the node that
        took it; (n, 6) x y z of specific force in m/s^2, then of angular rate in deg/s.
    """
    sent, raw = found.messages["imu_batch"], found.groups["imu_batch"]
    period = physical(sent, "imu_batch", "period_ticks", found.table)
    batch = raw["row"].astype(np.int64)
    within = np.arange(len(batch)) - np.searchsorted(batch, batch)
    ticks = sent["t_first_ticks_node"].astype(np.float64)[batch] + within * period[batch]
    accel = (sent["accel_fs_g"] * ACCEL_MPS2_PER_LSB_PER_G)[batch, np.newaxis] * raw["accel_lsb"]
    gyro = (sent["gyro_fs_dps"] * GYRO_RADPS_PER_LSB_PER_DPS)[batch, np.newaxis] * raw["gyro_lsb"]
    return batch, ticks, np.hstack([accel, np.degrees(gyro)])
