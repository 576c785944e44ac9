# SPDX-License-Identifier: Apache-2.0
"""A rigid bar on an analytic trajectory, and what a sensor anywhere on it feels.

Frames
    world   z up, x and y horizontal, fixed to the floor (the rotation of the Earth, 0.004 deg/s,
            is below the gyroscopes' noise over a set and is left out).
    bar     origin at the bar's centre, x along the shaft from follower to leader, z up when the
            bar lies level with zero spin.
    sensor  of one IMU; ``Mount.rotation`` takes sensor vectors to the bar frame.

The orientation is R = Rz(yaw) Ry(tilt) Rx(spin), bar to world. Positive tilt lowers the
leader's end; spin is the rotation in the hands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hil.motion.curves import Curve, FloatArray

GRAVITY_MPS2 = 9.80665
"""Standard gravity; the world's gravity vector is (0, 0, -GRAVITY_MPS2)."""


@dataclass(frozen=True)
class Mount:
    """Where one IMU sits: ``position_m`` (3,), bar frame, and ``rotation`` (3, 3) sensor to bar."""

    position_m: FloatArray
    rotation: FloatArray


def default_mounts() -> dict[str, Mount]:
    """One IMU on each sleeve, 20 mm off the axis, the follower turned half round the vertical."""
    half_turn = np.diag([-1.0, -1.0, 1.0])
    return {
        "leader": Mount(np.array([1.05, 0.0, 0.02]), np.eye(3)),
        "follower": Mount(np.array([-1.05, 0.0, 0.02]), half_turn),
    }


@dataclass(frozen=True)
class Bar:
    """The bar's parameters. Mass does not enter the kinematics; power and force need it."""

    length_m: float = 2.2
    mass_kg: float = 20.0
    mounts: Mapping[str, Mount] = field(default_factory=default_mounts)


@dataclass(frozen=True)
class BarMotion:
    """Exact motion of the bar's centre at n times; the last axes are world or bar components.

    Attributes:
        t_s: (n,) true time.
        position_m, velocity_mps, acceleration_mps2: (n, 3) of the centre, world frame.
        rotation: (n, 3, 3) bar to world.
        rate_radps, angular_accel_radps2: (n, 3), bar frame.
    """

    t_s: FloatArray
    position_m: FloatArray
    velocity_mps: FloatArray
    acceleration_mps2: FloatArray
    rotation: FloatArray
    rate_radps: FloatArray
    angular_accel_radps2: FloatArray


@dataclass(frozen=True)
class PointMotion:
    """Exact motion of one point of the bar, and what an ideal IMU there measures.

    Attributes:
        position_m, velocity_mps, acceleration_mps2: (n, 3), world frame.
        rotation: (n, 3, 3) sensor to world.
        specific_force_mps2: (n, 3), sensor frame: R^T (a - g).
        rate_radps: (n, 3), sensor frame.
    """

    t_s: FloatArray
    position_m: FloatArray
    velocity_mps: FloatArray
    acceleration_mps2: FloatArray
    rotation: FloatArray
    specific_force_mps2: FloatArray
    rate_radps: FloatArray


@dataclass(frozen=True)
class Trajectory:
    """Six curves: x, y, z in m and yaw, tilt, spin in rad, over 0..duration_s."""

    x: Curve
    y: Curve
    z: Curve
    yaw: Curve
    tilt: Curve
    spin: Curve
    duration_s: float

    def __call__(self, t_s: FloatArray) -> BarMotion:
        t = np.asarray(t_s, dtype=np.float64)
        px, py, pz = self.x(t), self.y(t), self.z(t)
        position, velocity, acceleration = (
            np.stack([px[i], py[i], pz[i]], axis=-1) for i in range(3)
        )
        psi, dpsi, ddpsi = self.yaw(t)
        theta, dtheta, ddtheta = self.tilt(t)
        phi, dphi, ddphi = self.spin(t)
        st, ct, sp, cp = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
        # Body rates of Euler angles z-y-x (Diebel 2006, section 5.6).
        rate = np.stack(
            [dphi - dpsi * st, dtheta * cp + dpsi * ct * sp, -dtheta * sp + dpsi * ct * cp],
            axis=-1,
        )
        angular_accel = np.stack(
            [
                ddphi - ddpsi * st - dpsi * dtheta * ct,
                ddtheta * cp
                - dtheta * dphi * sp
                + ddpsi * ct * sp
                - dpsi * dtheta * st * sp
                + dpsi * dphi * ct * cp,
                -ddtheta * sp
                - dtheta * dphi * cp
                + ddpsi * ct * cp
                - dpsi * dtheta * st * cp
                - dpsi * dphi * ct * sp,
            ],
            axis=-1,
        )
        ss, cs = np.sin(psi), np.cos(psi)
        rotation = np.stack(
            [
                np.stack([cs * ct, cs * st * sp - ss * cp, cs * st * cp + ss * sp], axis=-1),
                np.stack([ss * ct, ss * st * sp + cs * cp, ss * st * cp - cs * sp], axis=-1),
                np.stack([-st, ct * sp, ct * cp], axis=-1),
            ],
            axis=-2,
        )
        return BarMotion(t, position, velocity, acceleration, rotation, rate, angular_accel)


def at_point(motion: BarMotion, mount: Mount) -> PointMotion:
    """Motion of the point ``mount`` of the rigid bar.

    With r the lever arm in the bar frame, v_P = v + R (w x r) and
    a_P = a + R (alpha x r + w x (w x r)): the Euler and the centripetal term.
    """
    r = mount.position_m
    w, alpha = motion.rate_radps, motion.angular_accel_radps2
    arm_rate = np.cross(w, r)
    arm_accel = np.cross(alpha, r) + np.cross(w, arm_rate)
    position = motion.position_m + motion.rotation @ r
    velocity = motion.velocity_mps + _rotate(motion.rotation, arm_rate)
    acceleration = motion.acceleration_mps2 + _rotate(motion.rotation, arm_accel)
    rotation = motion.rotation @ mount.rotation
    force = _rotate(
        np.swapaxes(rotation, -1, -2), acceleration + np.array([0.0, 0.0, GRAVITY_MPS2])
    )
    return PointMotion(
        motion.t_s, position, velocity, acceleration, rotation, force, w @ mount.rotation
    )


def _rotate(rotation: FloatArray, vector: FloatArray) -> FloatArray:
    rotated: FloatArray = np.einsum("nij,nj->ni", rotation, vector)
    return rotated
