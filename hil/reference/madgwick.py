# SPDX-License-Identifier: Apache-2.0
"""Madgwick's gradient filter for an IMU: the baseline beside the EKF.

S. Madgwick, An efficient orientation filter for inertial and inertial/magnetic sensor arrays,
2010, eq. 25, 26, 33 and 42-44, with the quaternion turned to body-to-world.
"""

from __future__ import annotations

import math

import numpy as np

from hil.reference.attitude import FloatArray, multiply, normalised


def madgwick_step(
    q: FloatArray, force: FloatArray, rate: FloatArray, dt_s: float, gain_radps: float
) -> FloatArray:
    """One step: gyroscope integration and a step of ``gain_radps * dt_s`` down the gradient."""
    w, x, y, z = q
    derivative = 0.5 * multiply(q, np.array([0.0, rate[0], rate[1], rate[2]]))
    norm = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    if norm > 0.0:
        ax, ay, az = force / norm
        f1 = 2.0 * (x * z - w * y) - ax
        f2 = 2.0 * (w * x + y * z) - ay
        f3 = 2.0 * (0.5 - x * x - y * y) - az
        gradient = np.array(
            [
                -2.0 * y * f1 + 2.0 * x * f2,
                2.0 * z * f1 + 2.0 * w * f2 - 4.0 * x * f3,
                -2.0 * w * f1 + 2.0 * z * f2 - 4.0 * y * f3,
                2.0 * x * f1 + 2.0 * y * f2,
            ]
        )
        length = math.sqrt(float(gradient @ gradient))
        if length > 1e-12:
            derivative = derivative - (gain_radps / length) * gradient
    return normalised(q + dt_s * derivative)
