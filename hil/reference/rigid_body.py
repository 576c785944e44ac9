# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""The second IMU on the same rigid bar: a pseudo-measurement of the leader's biases.

On a rigid body the force felt at the follower follows from the one felt at the leader:

    f_F = f_L + alpha x r + w x (w x r),   r = r_F - r_L,    w_F = w_L.

Both sides are measured at the follower's own sample time, on the leader's clock, from the
leader's recent past; biases hardly change within a link's latency, so a late packet is worth
as much as a punctual one. With measured quantities the residuals are

    d_f = f_L + alpha x r + w x (w x r) - f_F = b_aL - b_aF + n_f
    d_w = w_L - w_F                           = b_gL - b_gF + n_w.

The gate holds the residual against R as modelled. What passes is weighted by R plus the running
mean square of the residuals that passed before: a bar that flexes more than the model says loses
weight on its own.

The follower's own biases are constants, not noise: however often it is measured, the difference
to a bias known to s tells no more than one measurement of variance s^2. So their variance enters
R multiplied by N: N = ``rigid_fast`` for that many updates after start-up and after each turn of
the bar that shows gravity to both sensors from a new side, which together make that one
measurement; after that, N = the updates in ``rigid_spread_s``, for the biases' slow walk.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hil.reference.attitude import FloatArray, cross, skew
from hil.reference.params import Params
from hil.reference.state import A_, G_, Nav

HISTORY = 64
"""Leader samples kept: 150 ms at 416 Hz, the oldest follower sample that is still of use."""


@dataclass(frozen=True)
class Past:
    """A leader's filtered sample, with the angular acceleration that its neighbours give."""

    t_s: float
    force: FloatArray
    rate: FloatArray
    alpha: FloatArray


@dataclass(frozen=True)
class Arrival:
    """A follower's filtered sample at its own time on the leader's clock."""

    t_s: float
    force: FloatArray
    rate: FloatArray
    t_sigma_s: float


@dataclass
class Averager:
    """Sums of residuals until an update is due."""

    count: int = 0
    force_next: bool = True
    fresh_force: int = 0
    fresh_rate: int = 0
    force: FloatArray = field(default_factory=lambda: np.zeros(3))
    rate: FloatArray = field(default_factory=lambda: np.zeros(3))
    variance: float = 0.0
    centripetal: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    force_spread2: float = 0.0
    rate_spread2: float = 0.0

    def clear(self) -> None:
        self.count = 0
        self.force = np.zeros(3)
        self.rate = np.zeros(3)
        self.variance = 0.0
        self.centripetal = np.zeros((3, 3))


def at_time(history: deque[Past], t_s: float) -> tuple[Past, FloatArray] | None:
    """The leader's sample at ``t_s`` by linear interpolation, and the slope of its force.

    ``None`` when ``t_s`` is older than the history or newer than the leader's last sample.
    """
    if len(history) < 2 or t_s > history[-1].t_s or t_s < history[0].t_s:
        return None
    later = history[-1]
    for earlier in list(history)[-2::-1]:
        if earlier.t_s <= t_s:
            break
        later = earlier
    span = later.t_s - earlier.t_s
    u = (t_s - earlier.t_s) / span
    mixed = Past(
        t_s,
        earlier.force + u * (later.force - earlier.force),
        earlier.rate + u * (later.rate - earlier.rate),
        earlier.alpha + u * (later.alpha - earlier.alpha),
    )
    return mixed, (later.force - earlier.force) / span


def add_residual(
    params: Params,
    nav: Nav,
    sums: Averager,
    *,
    leader: Past,
    slope: FloatArray,
    follower: Arrival,
) -> tuple[FloatArray, FloatArray]:
    """Add one pair of residuals with its variance; returns (d_f, d_w)."""
    r = params.lever_follower_m - params.lever_leader_m
    w = leader.rate - nav.b_g
    d_f = leader.force + cross(leader.alpha, r) + cross(w, cross(w, r)) - follower.force
    d_w = leader.rate - follower.rate
    # d(w x (w x r)) = -([w x r]x + [w]x [r]x) dw; too large a bias estimate is too small a w.
    sums.centripetal -= skew(cross(w, r)) + skew(w) @ skew(r)
    sums.force += d_f
    sums.rate += d_w
    lever = float(np.sqrt(leader.alpha @ leader.alpha) + w @ w)
    sums.variance += (
        params.rigid_accel_sigma_mps2**2
        + float(slope @ slope) * follower.t_sigma_s**2
        + (params.lever_sigma_m * lever) ** 2
    )
    sums.count += 1
    return d_f, d_w


def repeats(params: Params, fresh: int) -> float:
    """How many times over the follower's bias variance is to be counted."""
    if fresh > 0:
        return float(params.rigid_fast)
    return params.rigid_spread_s * params.rate_hz / (2.0 * params.rigid_samples)


def force_measurement(
    params: Params, nav: Nav, sums: Averager
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """H, innovation, R of the averaged d_f."""
    n = sums.count
    H = np.zeros((3, 15))
    H[:, A_] = np.eye(3)
    H[:, G_] = sums.centripetal / n
    innovation = sums.force / n - nav.b_a
    R = sums.variance / n + repeats(params, sums.fresh_force) * params.accel_bias_sigma_mps2**2
    return H, innovation, np.full(3, R)


def rate_measurement(
    params: Params, nav: Nav, sums: Averager
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """H, innovation, R of the averaged d_w."""
    H = np.zeros((3, 15))
    H[:, G_] = np.eye(3)
    innovation = sums.rate / sums.count - nav.b_g
    R = (
        params.rigid_gyro_sigma_radps**2
        + repeats(params, sums.fresh_rate) * params.gyro_bias_sigma_radps**2
    )
    return H, innovation, np.full(3, R)
