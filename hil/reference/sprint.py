# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""Azimuth-aided sprint EKF after Kim and Yu (2025): docs/estimators.md, section 2.

One sensor on the trunk, nine error states (attitude, position, velocity), and one measurement: who
sprints down a lane looks down the lane, so the yaw is zero. Nothing measures velocity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil.reference.attitude import FloatArray, from_matrix, matrix, skew
from hil.reference.estimator import Sample
from hil.reference.tracker import Alignment, Estimate

T_, P_, V_ = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True)
class SprintParams:
    """The description gives no noise: these are the LSM6DSOX's at its rate, in a lane of 2 deg."""

    gravity_mps2: float = 9.80665
    gyro_noise_radps_rthz: float = 7.0e-5
    accel_noise_mps2_rthz: float = 1.1e-3
    tilt_sigma_rad: float = 0.01
    yaw_sigma_rad: float = math.radians(2.0)
    align_s: float = 0.5
    remove_gyro_mean: bool = True
    """Take the gyroscope's mean over the alignment for its bias, which is no state here."""


def cayley(turn: FloatArray) -> FloatArray:
    """(I + W)(I - W)^-1 with W = [turn]x / 2: the rotation about ``turn`` by 2 atan(|turn| / 2)."""
    W = 0.5 * skew(turn)
    return (np.eye(3) + W) @ np.linalg.inv(np.eye(3) - W)


def transition(force_nav: FloatArray, dt_s: float) -> FloatArray:
    """F, (9, 9): d' = F d for d = (dtheta, dp, dv), with C_true = Exp(dtheta) C."""
    F = np.eye(9)
    F[P_, V_] = dt_s * np.eye(3)
    F[V_, T_] = -dt_s * skew(force_nav)
    return F


class SprintTracker:
    """State and step. ``v_max_mps`` and ``t_max_s`` are what it reports of a run."""

    def __init__(self, params: SprintParams | None = None) -> None:
        self.params = params or SprintParams()
        self.alignment = Alignment(self.params.align_s)
        self.C = np.eye(3)
        self.p, self.v = np.zeros(3), np.zeros(3)
        self.P = np.zeros((9, 9))
        self.gyro_bias = np.zeros(3)
        self.t_last_s = math.nan
        self.v_max_mps, self.t_max_s = 0.0, math.nan

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None:
        """Predict, then correct by yaw = 0. The second sensor is not looked at."""
        if math.isnan(self.t_last_s):
            if self.alignment.done(sample):
                self._begin(sample.t_s)
            return None
        dt = sample.t_s - self.t_last_s
        self.t_last_s = sample.t_s
        self.predict(sample.accel_mps2, sample.gyro_radps - self.gyro_bias, dt)
        self.correct_yaw()
        if self.v[0] > self.v_max_mps:
            self.v_max_mps, self.t_max_s = float(self.v[0]), sample.t_s
        return Estimate(sample.t_s, from_matrix(self.C), self.v, self.p, False)

    def _begin(self, t_s: float) -> None:
        p = self.params
        self.C = matrix(self.alignment.q)
        if p.remove_gyro_mean:
            self.gyro_bias = self.alignment.gyro
        self.P[T_, T_] = np.diag([p.tilt_sigma_rad**2] * 2 + [p.yaw_sigma_rad**2])
        self.t_last_s = t_s

    def predict(self, accel_mps2: FloatArray, gyro_radps: FloatArray, dt_s: float) -> None:
        """C by the Cayley form; acceleration by the mean of C before and after; P by F and Q."""
        p = self.params
        before = self.C
        self.C = before @ cayley(gyro_radps * dt_s)
        force = 0.5 * (before + self.C) @ accel_mps2
        a = force - np.array([0.0, 0.0, p.gravity_mps2])
        self.p = self.p + dt_s * self.v + 0.5 * dt_s * dt_s * a
        self.v = self.v + dt_s * a
        F = transition(force, dt_s)
        Q = np.zeros(9)
        Q[T_] = p.gyro_noise_radps_rthz**2 * dt_s
        Q[V_] = p.accel_noise_mps2_rthz**2 * dt_s
        self.P = F @ self.P @ F.T + np.diag(Q)

    def correct_yaw(self) -> None:
        """0 = yaw + n, in the Joseph form, and the correction fed back to C, p and v."""
        R = self.params.yaw_sigma_rad**2
        yaw = math.atan2(self.C[1, 0], self.C[0, 0])
        H = np.zeros(9)
        H[2] = 1.0
        K = self.P @ H / (H @ self.P @ H + R)
        IKH = np.eye(9) - np.outer(K, H)
        self.P = IKH @ self.P @ IKH.T + R * np.outer(K, K)
        d = K * -yaw
        self.C = cayley(d[T_]) @ self.C
        self.p = self.p + d[P_]
        self.v = self.v + d[V_]
