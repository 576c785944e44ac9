# SPDX-License-Identifier: Apache-2.0
"""The motion file that the chip model of the simulated bench plays: plain CSV.

One header line, then one row per instant, times increasing from 0 in equal or unequal steps;
the player interpolates linearly between rows and holds the last one. Values are ideal and in
the sensor's own frame: the chip model adds range, noise and counts.

::

    t_s,fx_mps2,fy_mps2,fz_mps2,wx_radps,wy_radps,wz_radps
    0.000000,0.00000,0.00000,9.80665,0.000000,0.000000,0.000000
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hil.motion.bar import Bar, Trajectory, at_point
from hil.motion.curves import FloatArray

HEADER = "t_s,fx_mps2,fy_mps2,fz_mps2,wx_radps,wy_radps,wz_radps"


def write(path: Path, trajectory: Trajectory, bar: Bar, role: str, rate_hz: float = 2000.0) -> int:
    """Write the ideal motion of the IMU ``role`` at ``rate_hz``; returns the number of rows.

    At 2 kHz linear interpolation of a 10 Hz tremor is exact to 1e-4 of its amplitude.

    Raises:
        ValueError: ``role`` is no mount of this bar, or the rate is not positive.
    """
    if role not in bar.mounts:
        raise ValueError(f"the bar has no IMU '{role}': mounts are {', '.join(bar.mounts)}")
    if rate_hz <= 0:
        raise ValueError(f"rate_hz must be positive, not {rate_hz}")
    t = np.arange(int(trajectory.duration_s * rate_hz) + 1) / rate_hz
    ideal = at_point(trajectory(t), bar.mounts[role])
    table = np.column_stack([t, ideal.specific_force_mps2, ideal.rate_radps])
    with path.open("w", encoding="ascii", newline="\n") as file:
        np.savetxt(
            file,
            table,
            delimiter=",",
            header=HEADER,
            comments="",
            fmt=["%.6f"] + ["%.5f"] * 3 + ["%.6f"] * 3,
        )
    return len(t)


def read(path: Path) -> FloatArray:
    """The rows of a motion file, (n, 7).

    Raises:
        ValueError: wrong header, wrong number of columns, or times that do not increase.
    """
    with path.open(encoding="ascii") as file:
        header = file.readline().strip()
        if header != HEADER:
            raise ValueError(f"{path}: first line is {header!r}, expected {HEADER!r}")
        table: FloatArray = np.loadtxt(file, delimiter=",", ndmin=2)
    if table.shape[1] != 7:
        raise ValueError(f"{path}: {table.shape[1]} columns, expected 7")
    backwards = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if len(backwards):
        raise ValueError(f"{path}: times do not increase at row {int(backwards[0]) + 3}")
    return table
