# SPDX-License-Identifier: Apache-2.0
"""The motion file that the chip model of the simulated bench plays.

Rows of true time, specific force and angular rate in the sensor's own frame; the player
interpolates linearly between rows, and holds the first row before and the last one after them.
The chip model adds range, noise and counts. Little-endian: ``BVMOTION``, version u32, rows u32,
then seven f64 a row (``docs/lsm6dsox.md``, section 6).
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from hil.motion.bar import Bar, Trajectory, at_point
from hil.motion.curves import FloatArray
from hil.motion.imu_model import ChipErrors

MAGIC = b"BVMOTION"
VERSION = 1
HEADER = struct.Struct("<8sII")
COLUMNS = 7


def write(
    path: Path,
    trajectory: Trajectory,
    bar: Bar,
    role: str,
    *,
    errors: ChipErrors | None = None,
    start_s: float = 0.0,
    handled_s: float = 0.0,
    rate_hz: float = 2000.0,
) -> int:
    """Write what the IMU ``role`` feels, from ``start_s`` of true time on; returns the rows.

    With ``errors``, the constant errors of one chip are already in it: bias, scale and
    misalignment. For the first ``handled_s``, which end before ``start_s``, the bar rocks about
    its axis in somebody's hands. At 2 kHz linear interpolation of a 10 Hz tremor is exact to 1e-4
    of its amplitude.

    Raises:
        ValueError: ``role`` is no mount of this bar, the rate is not positive, or the bar is
            handled after the start.
    """
    if role not in bar.mounts:
        raise ValueError(f"the bar has no IMU '{role}': mounts are {', '.join(bar.mounts)}")
    if rate_hz <= 0:
        raise ValueError(f"rate_hz must be positive, not {rate_hz}")
    t = np.arange(int(trajectory.duration_s * rate_hz) + 1) / rate_hz
    ideal = at_point(trajectory(t), bar.mounts[role])
    force, rate = ideal.specific_force_mps2, ideal.rate_radps
    t_s = start_s + t
    if handled_s > 0.0:
        if handled_s >= start_s:
            raise ValueError(f"handled for {handled_s} s, but the set starts at {start_s} s")
        before = np.arange(int(handled_s * rate_hz) + 1) / rate_hz
        rocked, rocking = handled(before, force[0], handled_s)
        force, rate = np.vstack([rocked, force]), np.vstack([rocking, rate])
        t_s = np.concatenate([before, t_s])
    if errors is not None:
        force = force @ errors.accel_matrix.T + errors.accel_bias_mps2
        rate = rate @ errors.gyro_matrix.T + errors.gyro_bias_radps
    rows = np.column_stack([t_s, force, rate]).astype("<f8")
    path.write_bytes(HEADER.pack(MAGIC, VERSION, len(rows)) + rows.tobytes())
    return len(rows)


def handled(t_s: FloatArray, force_mps2: FloatArray, end_s: float) -> tuple[FloatArray, FloatArray]:
    """A bar that rocks in somebody's hands until ``end_s``, then lies still as it lay.

    Args:
        force_mps2: (3,) specific force at rest.

    Returns:
        Specific force and rate of turn, (n, 3) each.
    """
    axis = np.cross(force_mps2, np.eye(3)[np.argmin(np.abs(force_mps2))])
    axis = axis / np.linalg.norm(axis)
    # It fades at the end, and with it the rate: three degrees at 1.3 Hz.
    swing = np.radians(3.0) * np.sin(2.0 * np.pi * 1.3 * t_s) * np.clip(end_s - t_s, 0.0, 1.0) ** 2
    across = np.cross(axis, force_mps2)
    force = np.outer(np.cos(swing), force_mps2) + np.outer(np.sin(swing), across)
    return force, -np.outer(np.gradient(swing, t_s), axis)


def read(path: Path) -> FloatArray:
    """The rows of a motion file, (n, 7).

    Raises:
        ValueError: not a motion file, another version, cut, or times that do not increase.
    """
    data = path.read_bytes()
    if len(data) < HEADER.size or data[:8] != MAGIC:
        raise ValueError(f"{path}: not a motion file: it begins with {data[:8]!r}")
    _, version, rows = HEADER.unpack_from(data)
    if version != VERSION:
        raise ValueError(f"{path}: version {version}, expected {VERSION}")
    if len(data) != HEADER.size + rows * COLUMNS * 8:
        raise ValueError(f"{path}: {len(data)} bytes do not hold the {rows} rows it speaks of")
    table: FloatArray = np.frombuffer(data, "<f8", offset=HEADER.size).reshape(rows, COLUMNS)
    backwards = np.flatnonzero(~(np.diff(table[:, 0]) > 0))
    if len(backwards):
        raise ValueError(f"{path}: times do not increase at row {int(backwards[0]) + 1}")
    return table
