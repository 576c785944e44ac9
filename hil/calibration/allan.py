# SPDX-License-Identifier: Apache-2.0
"""How a sensor at rest wanders, in the units that its datasheet is written in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.core import calib
from hil.core.calib import STANDARD_GRAVITY_MPS2, Noise

FloatArray = NDArray[np.float64]
Sensor = Literal["accel", "gyro"]

_UNITS: Final[dict[Sensor, tuple[float, str, float, str]]] = {
    "accel": (STANDARD_GRAVITY_MPS2 * 1e-6, "ug/rtHz", STANDARD_GRAVITY_MPS2 * 1e-3, "mg"),
    "gyro": (np.pi / 180e3, "mdps/rtHz", np.pi / 180.0 / 3600.0, "dph"),
}
"""One of the density's unit in SI, its name; the same of the bias instability."""


@dataclass(frozen=True, eq=False)
class Wander:
    """Allan deviation of three axes.

    Attributes:
        tau_s: (k,) averaging times.
        deviation: (k, 3), in m/s^2 or rad/s.
        noise: of each axis, in SI units.
        density: (3,) white noise as datasheets state it, one-sided: sqrt(2) N.
        density_unit: ``ug/rtHz`` or ``mdps/rtHz``.
        instability: (3,) bias instability B; 0 where the record is too short to show it.
        instability_unit: ``mg`` or ``dph`` (degrees per hour).
    """

    tau_s: FloatArray
    deviation: FloatArray
    noise: tuple[Noise, Noise, Noise]
    density: FloatArray
    density_unit: str
    instability: FloatArray
    instability_unit: str


def allan_of(samples: FloatArray, rate_hz: float, sensor: Sensor) -> Wander:
    """Allan deviation of (n, 3) samples of one sensor at rest, in SI units.

    Raises:
        ValueError: not (n, 3), fewer than 8 samples, not finite, or an impossible rate.
    """
    samples = np.asarray(samples, np.float64)
    if samples.ndim != 2 or samples.shape[1] != 3:
        raise ValueError(f"samples of shape {samples.shape}: give (n, 3)")
    (tau_s, x, noise_x), (_, y, noise_y), (_, z, noise_z) = (
        calib.allan_deviation(axis, rate_hz) for axis in samples.T
    )
    noise = (noise_x, noise_y, noise_z)
    density, density_unit, instability, instability_unit = _UNITS[sensor]
    return Wander(
        tau_s,
        np.stack([x, y, z], axis=1),
        noise,
        np.sqrt(2.0) * np.array([axis.white for axis in noise]) / density,
        density_unit,
        np.array([axis.instability for axis in noise]) / instability,
        instability_unit,
    )
