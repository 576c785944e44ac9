# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""Zero-velocity positioning on a complementary AHRS: docs/estimators.md, section 4.

No filter with a covariance: attitude with gravity fed back, a moving average of the acceleration,
trapezoids, and per axis a threshold below which the velocity of that axis is zero.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from hil.reference.attitude import FloatArray, cross, matrix, multiply, normalised
from hil.reference.estimator import Sample
from hil.reference.tracker import Alignment, Estimate


@dataclass(frozen=True)
class ZeroVelocityParams:
    """The first group is published; the second is this project's, where nothing is said."""

    average_length: int = 15
    threshold_mps2: FloatArray = field(default_factory=lambda: np.array([0.5, 0.5, 0.8]))
    counter: int = 3

    gravity_mps2: float = 9.80665
    feedback_radps: float = 0.1  # rate of turn for a full error of gravity's direction
    forget: float = 0.999  # of the recursive least squares
    refine: Literal["bias", "gain", "nothing"] = "bias"
    align_s: float = 0.5


@dataclass(frozen=True)
class Calibration:
    """a = (S a_raw - b) * scale * G: S (3, 3) and b (3,) in counts, scale in g a count, G in m/s^2.

    The identity takes samples that are in m/s^2 already.
    """

    S: FloatArray = field(default_factory=lambda: np.eye(3))
    b: FloatArray = field(default_factory=lambda: np.zeros(3))
    scale: FloatArray = field(default_factory=lambda: np.ones(3))
    G: float = 1.0

    def __call__(self, raw: FloatArray) -> FloatArray:
        a: FloatArray = (self.S @ raw - self.b) * self.scale * self.G
        return a


@dataclass
class LeastSquares:
    """Recursive least squares of y = phi theta + n for one unknown (Ljung 1999, section 11.2)."""

    theta: float
    P: float = 1.0
    forget: float = 1.0

    def update(self, phi: float, y: float) -> float:
        """Take one equation in; returns theta."""
        K = self.P * phi / (self.forget + phi * self.P * phi)
        self.theta += K * (y - phi * self.theta)
        self.P = (self.P - K * phi * self.P) / self.forget
        return self.theta


def ahrs_step(
    q: FloatArray, accel: FloatArray, gyro: FloatArray, dt_s: float, feedback: float
) -> FloatArray:
    """One step of the attitude: the gyroscope, and e = a x g(q) fed back, both as a rate."""
    norm = math.sqrt(float(accel @ accel))
    rate = gyro
    if norm > 0.0:
        # Gravity's direction in the sensor's axes: the third row of the matrix of q.
        rate = gyro + feedback * cross(accel / norm, matrix(q)[2])
    return normalised(q + 0.5 * dt_s * multiply(q, np.array([0.0, *rate])))


class ZeroVelocityTracker:
    """State and step."""

    def __init__(
        self, params: ZeroVelocityParams | None = None, calibration: Calibration | None = None
    ) -> None:
        self.params = params or ZeroVelocityParams()
        self.calibration = calibration or Calibration()
        self.alignment = Alignment(self.params.align_s)
        self.q = np.array([1.0, 0.0, 0.0, 0.0])
        self.gyro_bias = np.zeros(3)
        self.window: deque[FloatArray] = deque(maxlen=self.params.average_length)
        self.a_last = np.zeros(3)
        self.v, self.p = np.zeros(3), np.zeros(3)
        self.quiet = np.zeros(3, dtype=np.int64)
        self.gain = LeastSquares(1.0, forget=self.params.forget)
        self.bias = [LeastSquares(0.0, forget=self.params.forget) for _ in range(3)]
        self.t_last_s = math.nan

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None:
        """Attitude, acceleration, average, thresholds, trapezoids."""
        p = self.params
        accel = self.calibration(sample.accel_mps2)
        if math.isnan(self.t_last_s):
            if self.alignment.done(Sample(sample.t_s, accel, sample.gyro_radps)):
                self.q, self.gyro_bias = self.alignment.q, self.alignment.gyro
                self.t_last_s = sample.t_s
            return None
        dt = sample.t_s - self.t_last_s
        self.t_last_s = sample.t_s
        rate = sample.gyro_radps - self.gyro_bias
        self.q = ahrs_step(self.q, accel, rate, dt, p.feedback_radps)
        bias = np.array([one.theta for one in self.bias])
        earth = matrix(self.q) @ (self.gain.theta * accel) - np.array([0.0, 0.0, p.gravity_mps2])
        self.window.append(earth)
        a = np.mean(np.array(self.window), axis=0) - bias
        self.integrate(a, dt)
        still = bool((self.quiet >= p.counter).all())
        if still:
            self.refine(accel, a + bias)
        return Estimate(sample.t_s, self.q, self.v, self.p, still)

    def integrate(self, a_mps2: FloatArray, dt_s: float) -> None:
        """Trapezoids; an axis that was quiet for ``counter`` samples has no velocity."""
        p = self.params
        self.quiet = np.where(np.abs(a_mps2) < p.threshold_mps2, self.quiet + 1, 0)
        v = self.v + 0.5 * dt_s * (self.a_last + a_mps2)
        v = np.where(self.quiet >= p.counter, 0.0, v)
        self.p = self.p + 0.5 * dt_s * (self.v + v)
        self.v, self.a_last = v, a_mps2

    def refine(self, accel_mps2: FloatArray, earth_mps2: FloatArray) -> None:
        """At rest: the gain that makes |a| gravity, or the bias that the earth's axes show."""
        if self.params.refine == "gain":
            self.gain.update(float(np.linalg.norm(accel_mps2)), self.params.gravity_mps2)
        elif self.params.refine == "bias":
            for one, y in zip(self.bias, earth_mps2, strict=True):
                one.update(1.0, float(y))
