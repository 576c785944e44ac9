# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""Vertical-plane bar tracker: docs/estimators.md, section 3.

The attitude comes from outside as Euler angles; the filter has position, velocity and a bias of the
acceleration, all in the world's axes, and knows that a bar moves in a vertical plane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil.reference.attitude import FloatArray, matrix
from hil.reference.estimator import Sample
from hil.reference.madgwick import madgwick_step
from hil.reference.tracker import Alignment, Estimate

P_, V_, B_ = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True)
class PlaneParams:
    """The first group is published; the second is this project's, where nothing is said."""

    still_accel_mps2: float = 0.5
    still_gyro_radps: float = 0.4
    still_hold_s: float = 0.2
    Qv: float = 5e-4  # (m/s)^2 a second
    Qba: float = 1e-6  # (m/s^2)^2 a second
    Rv: float = 1e-4  # (m/s)^2
    Ry: float = 2e-3  # m^2
    plane_axis: int = 1  # y: the axis along which the bar does not move
    plane_speed_mps: float = 0.05  # below it the plane is not applied

    cutoff_hz: float = 20.0  # low-pass of the acceleration
    gravity_tau_s: float = 0.5  # of the gravity estimate while still
    madgwick_gain: float = 0.033  # the Euler angles' source
    align_s: float = 0.5


def euler(q: FloatArray) -> tuple[float, float, float]:
    """Roll, pitch, yaw (z-y-x) of a quaternion, rad."""
    R = matrix(q)
    return (
        math.atan2(R[2, 1], R[2, 2]),
        -math.asin(max(-1.0, min(1.0, float(R[2, 0])))),
        math.atan2(R[1, 0], R[0, 0]),
    )


def from_euler(roll: float, pitch: float, yaw: float) -> FloatArray:
    """R = Rz(yaw) Ry(pitch) Rx(roll), sensor to ENU."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


class PlaneTracker:
    """State and step."""

    def __init__(self, params: PlaneParams | None = None) -> None:
        self.params = params or PlaneParams()
        self.alignment = Alignment(self.params.align_s)
        self.q = np.array([1.0, 0.0, 0.0, 0.0])
        self.x = np.zeros(9)
        self.P = np.diag([1e-4] * 3 + [1e-4] * 3 + [1e-2] * 3)
        self.gravity = np.zeros(3)
        self.smooth = np.zeros(3)
        self.gyro_bias = np.zeros(3)
        self.quiet_s = 0.0
        self.t_last_s = math.nan

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None:
        """Attitude, gravity off, predict, and one of the two updates."""
        p = self.params
        if math.isnan(self.t_last_s):
            if self.alignment.done(sample):
                self.q = self.alignment.q
                self.gyro_bias = self.alignment.gyro
                self.gravity = matrix(self.q) @ self.alignment.accel
                self.smooth = self.gravity.copy()
                self.t_last_s = sample.t_s
            return None
        dt = sample.t_s - self.t_last_s
        self.t_last_s = sample.t_s
        rate = sample.gyro_radps - self.gyro_bias
        self.q = madgwick_step(self.q, sample.accel_mps2, rate, dt, p.madgwick_gain)
        force = from_euler(*euler(self.q)) @ sample.accel_mps2
        share = 1.0 - math.exp(-2.0 * math.pi * p.cutoff_hz * dt)
        self.smooth = self.smooth + share * (force - self.smooth)
        accel = self.smooth - self.gravity
        still = self.is_still(accel, rate, dt)
        self.predict(accel, dt)
        if still:
            self.gravity = self.gravity + min(dt / p.gravity_tau_s, 1.0) * accel
            self.update(V_, np.full(3, p.Rv))
        elif float(np.linalg.norm(self.x[V_])) > p.plane_speed_mps:
            self.update(slice(p.plane_axis, p.plane_axis + 1), np.array([p.Ry]))
        return Estimate(sample.t_s, self.q, self.x[V_].copy(), self.x[P_].copy(), still)

    def is_still(self, accel_mps2: FloatArray, rate_radps: FloatArray, dt_s: float) -> bool:
        """Both below their thresholds, and that for ``still_hold_s``."""
        p = self.params
        quiet = (
            float(np.linalg.norm(accel_mps2)) < p.still_accel_mps2
            and float(np.linalg.norm(rate_radps)) < p.still_gyro_radps
        )
        self.quiet_s = self.quiet_s + dt_s if quiet else 0.0
        return self.quiet_s >= p.still_hold_s

    def predict(self, accel_mps2: FloatArray, dt_s: float) -> None:
        """Position and velocity by the acceleration less its bias."""
        a = accel_mps2 - self.x[B_]
        self.x[P_] += dt_s * self.x[V_] + 0.5 * dt_s * dt_s * a
        self.x[V_] += dt_s * a
        F = np.eye(9)
        F[P_, V_] = dt_s * np.eye(3)
        F[P_, B_] = -0.5 * dt_s * dt_s * np.eye(3)
        F[V_, B_] = -dt_s * np.eye(3)
        Q = np.zeros(9)
        Q[V_] = self.params.Qv * dt_s
        Q[B_] = self.params.Qba * dt_s
        self.P = F @ self.P @ F.T + np.diag(Q)

    def update(self, states: slice, variances: FloatArray) -> None:
        """These states are measured to be zero, with these variances; Joseph form."""
        H = np.eye(9)[states]
        PHt = self.P @ H.T
        K = np.linalg.solve(H @ PHt + np.diag(variances), PHt.T).T
        IKH = np.eye(9) - K @ H
        self.P = IKH @ self.P @ IKH.T + (K * variances) @ K.T
        self.x = self.x - K @ self.x[states]
