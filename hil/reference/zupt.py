# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""Is the bar still? Detectors over a sliding window, and the updates that stillness allows.

Variance detector (default): the variance of |a| - g and the mean of |w - b_g|^2 over the window,
each below its threshold, on both sensors, while the mean of |a| - g is small. The mean has a wide
limit of its own, because a bias shows there: once the bar lies another way up, so does |a|.
SHOE (Skog et al. 2010, eq. 12): the generalised likelihood ratio
mean(|a - g a_m/|a_m||^2 / s_a^2 + |w|^2 / s_w^2) below one threshold.

Either way ``zupt_dwell`` consecutive detections are needed. A slow eccentric and a touch-and-go
boundary pass through zero velocity, but in hands: tremor keeps the variances up. Should a
motion be smoother than that, the update's own gate holds it off, because a filter that knows
its velocity to a few mm/s does not believe in a zero 0.1 m/s away.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hil.reference.attitude import FloatArray, skew
from hil.reference.params import Params
from hil.reference.state import A_, G_, T_, V_, Nav


@dataclass
class Window:
    """Last ``zupt_window`` filtered samples of one sensor, (force, rate) rows."""

    rows: FloatArray
    filled: int = 0
    next: int = 0

    @classmethod
    def of(cls, params: Params) -> Window:
        return cls(np.zeros((params.zupt_window, 6)))

    def push(self, force: FloatArray, rate: FloatArray) -> None:
        self.rows[self.next, :3] = force
        self.rows[self.next, 3:] = rate
        self.next = (self.next + 1) % len(self.rows)
        self.filled = min(self.filled + 1, len(self.rows))

    def clear(self) -> None:
        self.filled = 0
        self.next = 0

    @property
    def full(self) -> bool:
        return self.filled == len(self.rows)

    @property
    def mean_force(self) -> FloatArray:
        mean: FloatArray = self.rows[:, :3].mean(axis=0)
        return mean


@dataclass
class Detector:
    """Windows of both sensors and the count of consecutive detections."""

    leader: Window
    follower: Window
    hits: int = 0
    refused_s: float = 0.0
    gyro_bias_follower: FloatArray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(cls, params: Params) -> Detector:
        return cls(Window.of(params), Window.of(params))


def window_is_still(params: Params, window: Window, b_g: FloatArray) -> bool:
    """One sensor's verdict on its present window."""
    if not window.full:
        return False
    force, rate = window.rows[:, :3], window.rows[:, 3:] - b_g
    newest = (window.next - 1) % len(window.rows)
    excess = np.sqrt(np.sum(force * force, axis=1)) - params.gravity_mps2
    excess_mean = float(np.mean(excess))
    spread = excess - excess_mean
    mean_force = window.mean_force
    jump = force[newest] - mean_force
    turning2 = np.sum(rate * rate, axis=1)
    # A window forgets slowly; one sample far outside it ends the stillness at once. The whole
    # vector is looked at as well: a bar that sets out sideways does not change |a|.
    accel_limit = params.zupt_release * params.zupt_accel_var
    if (
        spread[newest] ** 2 > accel_limit
        or float(jump @ jump) > accel_limit
        or turning2[newest] > params.zupt_release * params.zupt_gyro_var
        or abs(excess_mean) > params.zupt_level_mps2
    ):
        return False
    if params.zupt_shoe:
        up = params.gravity_mps2 / np.sqrt(mean_force @ mean_force) * mean_force
        off = force - up
        statistic = (
            float(np.mean(np.sum(off * off, axis=1))) / params.shoe_accel_sigma_mps2**2
            + float(np.mean(turning2)) / params.shoe_gyro_sigma_radps**2
        )
        return statistic < params.shoe_threshold
    return (
        float(np.mean(spread * spread)) < params.zupt_accel_var
        and float(np.mean(turning2)) < params.zupt_gyro_var
    )


def velocity_measurement(params: Params, nav: Nav) -> tuple[FloatArray, FloatArray, FloatArray]:
    """z = 0 = v + n: returns H, innovation, R."""
    H = np.zeros((3, 15))
    H[:, V_] = np.eye(3)
    return H, -nav.v, np.full(3, params.zupt_variance)


def rate_measurement(
    params: Params, nav: Nav, rate: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A still gyroscope shows its bias: z = rate = b_g + n."""
    H = np.zeros((3, 15))
    H[:, G_] = np.eye(3)
    return H, rate - nav.b_g, np.full(3, params.zaru_sigma_radps**2)


def gravity_measurement(
    params: Params, nav: Nav, mean_force: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A still accelerometer shows the vertical: the horizontal part of R (f - b_a) is zero.

    Two rows. Their yaw entries are set to exactly zero: gravity says nothing about yaw.
    """
    R = nav.R
    f_world = R @ (mean_force - nav.b_a)
    H = np.zeros((2, 15))
    H[:, T_] = -skew(f_world)[:2]
    H[:, T_.stop - 1] = 0.0
    H[:, A_] = -R[:2]
    return H, -f_world[:2], np.full(2, params.gravity_sigma_mps2**2)
