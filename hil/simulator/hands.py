# SPDX-License-Identifier: Apache-2.0
"""Hands that hold a simulated unit and turn it; what its chip feels has the chip's own errors.

The unit turns about an axis through its sensor, so that the specific force is gravity alone. The
lines go into the pipe that ``firmware/drivers/lsm6dsox/model/hands.h`` describes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from hil.errors import RigError
from hil.motion.bar import GRAVITY_MPS2
from hil.motion.curves import FloatArray
from hil.motion.imu_model import ChipErrors

STEPS: Final = 40
"""Straight pieces of one turn."""
UP: Final = {
    f"{sign}{axis}": (1.0 if sign == "+" else -1.0) * np.eye(3)[row]
    for row, axis in enumerate("xyz")
    for sign in "+-"
}
"""Face -> direction of the specific force, unit vector in the sensor's axes, with that face up."""


class Hands:
    """Holds the unit with +z up until told otherwise.

    Args:
        pipe: made here; the simulated chip reads it.
        errors: of the chip: what it feels is ``matrix @ true + bias``.

    Raises:
        RigError: by all that moves the unit, when nobody reads the pipe and it is full.
    """

    def __init__(self, pipe: Path, errors: ChipErrors) -> None:
        os.mkfifo(pipe, mode=0o600)
        # Both ways, so that it opens before the chip does and stays open when the chip restarts.
        self._fd = os.open(pipe, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._errors = errors
        self._up = UP["+z"]

    def rest(self) -> None:
        """Hold still in the present position."""
        self._say(0.0, self._up, np.zeros(3))

    def turn(self, up: FloatArray, seconds: float = 1.0) -> None:
        """Turn the unit until the direction ``up``, in its own axes, points up; then hold still."""
        for duration_s, direction, rate_radps in turning(self._up, up, seconds):
            self._say(duration_s, direction, rate_radps)
        self._up = up / np.linalg.norm(up)
        self.rest()

    def shake(self, seconds: float = 1.0, rate_radps: float = 0.5) -> None:
        """Move the unit to and fro, as someone who is not ready."""
        period_s = 0.2
        for sign in (1.0, -1.0) * max(1, round(seconds / (2 * period_s))):
            self._say(0.0, self._up, np.full(3, sign * rate_radps))
            self._say(period_s, self._up, np.full(3, sign * rate_radps))
        self.rest()

    def spin(self, rate_radps: FloatArray) -> None:
        """Turn steadily at a rate that the accelerometer does not see, until told otherwise."""
        self._say(0.0, self._up, rate_radps)

    def close(self) -> None:
        os.close(self._fd)

    def _say(self, duration_s: float, up: FloatArray, rate_radps: FloatArray) -> None:
        accel = self._errors.accel_matrix @ (GRAVITY_MPS2 * up) + self._errors.accel_bias_mps2
        gyro = self._errors.gyro_matrix @ rate_radps + self._errors.gyro_bias_radps
        row = (duration_s, *accel.tolist(), *gyro.tolist())
        line = ",".join(f"{value:.9g}" for value in row) + "\n"
        try:
            # A pipe takes so short a line whole or not at all.
            os.write(self._fd, line.encode("ascii"))
        except BlockingIOError as error:
            raise RigError(
                "the simulated sensor does not read how it is held: it has ended, or far more was "
                "asked of its hands than time has passed"
            ) from error


def turning(
    begin: FloatArray, end: FloatArray, seconds: float
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Pieces of the shortest turn: duration, direction of gravity, rate at the end of each, rad/s.

    The angle follows a polynomial of degree five: at rest at both ends, without a jerk.
    """
    a, b = begin / np.linalg.norm(begin), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-9:
        # Straight over: about any axis that lies flat.
        axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    axis = axis / np.linalg.norm(axis)
    angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    if angle < 1e-9:
        return
    for step in range(1, STEPS + 1):
        u = step / STEPS
        theta = angle * u**3 * (10 - 15 * u + 6 * u**2)
        rate = angle / seconds * 30 * u**2 * (1 - u) ** 2
        direction = a * np.cos(theta) + np.cross(axis, a) * np.sin(theta)
        # Gravity turns one way in the unit's axes when the unit turns the other way.
        yield seconds / STEPS, direction, -rate * axis
