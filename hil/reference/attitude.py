# SPDX-License-Identifier: Apache-2.0
"""Rotations: Hamilton quaternions (w, x, y, z), body to world, and their 3-vectors.

Conventions and equation numbers after J. Sola, Quaternion kinematics for the error-state
Kalman filter, arXiv:1711.02508.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def skew(v: FloatArray) -> FloatArray:
    """[v]x with [v]x u = v x u (Sola 69)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b for two 3-vectors (``numpy.cross`` costs ten times more at this size)."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """p (x) q (Sola 12)."""
    return np.array(
        [
            p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
            p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
            p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
            p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
        ]
    )


def conjugate(q: FloatArray) -> FloatArray:
    return np.array([q[0], -q[1], -q[2], -q[3]])


def exp(rotation_vector: FloatArray) -> FloatArray:
    """Quaternion of a rotation vector (Sola 101).

    Below 1e-4 rad the series to second order is used: its error is under 1e-18 there, and the
    quotient sin(x)/x would lose digits in float32.
    """
    x, y, z = rotation_vector
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        w, k = 1.0 - angle2 / 8.0, 0.5 - angle2 / 48.0
    else:
        angle = math.sqrt(angle2)
        w, k = math.cos(0.5 * angle), math.sin(0.5 * angle) / angle
    return np.array([w, k * x, k * y, k * z])


def normalised(q: FloatArray) -> FloatArray:
    return q / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


def matrix(q: FloatArray) -> FloatArray:
    """Rotation matrix body to world (Sola 115)."""
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def from_matrix(rotation: FloatArray) -> FloatArray:
    """Quaternion with w >= 0 of a rotation matrix, by its largest component (Shepperd 1978)."""
    m, trace = rotation, float(np.trace(rotation))
    # 4 q q^T, whose row of the largest component is the safest to divide by.
    outer = np.empty((4, 4))
    outer[0] = [1.0 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
    outer[1:, 0] = outer[0, 1:]
    outer[1:, 1:] = m + m.T + (1.0 - trace) * np.eye(3)
    q = normalised(outer[int(np.argmax(np.diag(outer)))])
    return q if q[0] >= 0.0 else -q


def from_gravity(specific_force: FloatArray) -> FloatArray:
    """Quaternion with zero yaw whose world z axis is the direction of ``specific_force``.

    Zero yaw means: the body's x axis points along world x, seen from above. Where the body's x
    axis is vertical, yaw has no meaning and the result is still a valid attitude.
    """
    fx, fy, fz = specific_force
    roll = math.atan2(fy, fz)
    pitch = math.atan2(-fx, math.sqrt(fy * fy + fz * fz))
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    return np.array([cr * cp, sr * cp, cr * sp, -sr * sp])


def angle_between(p: FloatArray, q: FloatArray) -> float:
    """Angle of the rotation from ``p`` to ``q``, rad, 0..pi."""
    d = multiply(conjugate(p), q)
    return 2.0 * math.atan2(math.sqrt(d[1] * d[1] + d[2] * d[2] + d[3] * d[3]), abs(d[0]))


def tilt_between(p: FloatArray, q: FloatArray) -> float:
    """Inclination part of the rotation between two attitudes, rad: yaw divided out.

    Following Laidig et al., BROAD (2021): 2 arccos(sqrt(w^2 + z^2)) of the difference in the
    world frame.
    """
    d = multiply(p, conjugate(q))
    return 2.0 * math.atan2(
        math.sqrt(d[1] * d[1] + d[2] * d[2]), math.sqrt(d[0] * d[0] + d[3] * d[3])
    )
