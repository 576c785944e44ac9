# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N802, N803, N806 (matrices carry the capital letters of the equations)
"""The nominal state, its error state and the covariance; prediction and correction.

Nominal state, 16 numbers: position p and velocity v of the leader's IMU (world, m, m/s),
attitude q (bar to world), accelerometer bias b_a and gyroscope bias b_g of the leader (bar
frame). Error state, 15: (dp, dv, dtheta, db_a, db_g), true = nominal (+) error, with the
attitude error in the world frame: R_true = Exp(dtheta) R. So yaw is the third component of
dtheta alone, and a measurement that must leave yaw free has a zero there.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hil.reference.attitude import FloatArray, exp, matrix, multiply, normalised, skew
from hil.reference.params import Params

P_, V_, T_, A_, G_ = (slice(3 * i, 3 * i + 3) for i in range(5))
"""Slices of the error state: position, velocity, attitude, accelerometer and gyroscope bias."""

PZ = 2
"""Index of the vertical position error."""


@dataclass
class Nav:
    """Nominal state and covariance (15, 15)."""

    p: FloatArray = field(default_factory=lambda: np.zeros(3))
    v: FloatArray = field(default_factory=lambda: np.zeros(3))
    q: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    b_a: FloatArray = field(default_factory=lambda: np.zeros(3))
    b_g: FloatArray = field(default_factory=lambda: np.zeros(3))
    P: FloatArray = field(default_factory=lambda: np.zeros((15, 15)))

    @property
    def R(self) -> FloatArray:
        return matrix(self.q)


def predict(
    params: Params,
    nav: Nav,
    *,
    a_before: FloatArray,
    force: FloatArray,
    rate: FloatArray,
    dt: float,
    extra: tuple[float, float, float],
) -> FloatArray:
    """One inertial step of ``dt`` s; docs/estimator.md, section 5.

    Args:
        a_before: acceleration in the world frame at the step's beginning, as this function
            returned it; velocity integrates by the trapezium.
        force: specific force at the step's end, bar frame, prefiltered.
        rate: angular rate, mean of the step's two ends; the attitude turns by the trapezium.
        extra: variances added to velocity, attitude and accelerometer bias on this step, for
            clipping, impacts and scale errors.

    Returns:
        Acceleration in the world frame at the step's end.
    """
    w = rate - nav.b_g
    f = force - nav.b_a
    nav.q = normalised(multiply(nav.q, exp(w * dt)))
    R = nav.R
    f_world = R @ f
    a: FloatArray = f_world - np.array([0.0, 0.0, params.gravity_mps2])
    v_before = nav.v
    nav.v = nav.v + 0.5 * dt * (a_before + a)
    nav.p = nav.p + 0.5 * dt * (v_before + nav.v)

    F = np.eye(15)
    F[P_, V_] = dt * np.eye(3)
    F[V_, T_] = -dt * skew(f_world)
    F[V_, A_] = -dt * R
    F[T_, G_] = -dt * R
    P = F @ nav.P @ F.T
    nav.P = 0.5 * (P + P.T)

    q_v = params.accel_noise_mps2_rthz**2
    q_t = params.gyro_noise_radps_rthz**2
    q_a = params.accel_walk_mps2_rts**2
    q_g = params.gyro_walk_radps_rts**2
    d = np.einsum("ii->i", nav.P)
    d[PZ] += params.height_walk_m_rts**2 * dt
    d[V_] += q_v * dt + extra[0]
    d[T_] += q_t * dt + extra[1]
    d[A_] += q_a * dt + extra[2]
    d[G_] += q_g * dt
    return a


def nis(nav: Nav, H: FloatArray, innovation: FloatArray, R: FloatArray) -> float:
    """Normalised innovation squared y^T S^-1 y; R is the diagonal of the noise."""
    S = H @ nav.P @ H.T + np.diag(R)
    return float(innovation @ np.linalg.solve(S, innovation))


def correct(
    nav: Nav,
    H: FloatArray,
    innovation: FloatArray,
    R: FloatArray,
) -> FloatArray:
    """Kalman correction in Joseph form, and injection of the error; returns the error.

    Args:
        H: (m, 15) Jacobian of the measurement by the error state.
        innovation: (m,) measured minus predicted.
        R: (m,) variances of the measurement; components are independent, so that the core may
            treat them one after the other with the same result.
    """
    PHt = nav.P @ H.T
    S = H @ PHt + np.diag(R)
    K = np.linalg.solve(S, PHt.T).T
    IKH = np.eye(15) - K @ H
    P = IKH @ nav.P @ IKH.T + (K * R) @ K.T
    nav.P = 0.5 * (P + P.T)
    dx = K @ innovation
    nav.p = nav.p + dx[P_]
    nav.v = nav.v + dx[V_]
    nav.q = normalised(multiply(exp(dx[T_]), nav.q))
    nav.b_a = nav.b_a + dx[A_]
    nav.b_g = nav.b_g + dx[G_]
    return dx
