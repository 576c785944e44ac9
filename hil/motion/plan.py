# SPDX-License-Identifier: Apache-2.0
"""Building blocks of a lift: strokes, rests, holds, contacts, flight; then the smooth whole.

A :class:`Plan` walks forward in time and lays down knots. Vertical motion comes from the
blocks; the other five coordinates get a knot at every turning point, with seeded rates there,
because a bar in hands is never still in all of them at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hil.motion.bar import GRAVITY_MPS2, Trajectory
from hil.motion.curves import Fourier, Key, Product, Spline, Sum, window

HOLD_RAMP_S = 0.2
"""How long hands take to bring their sway to a bar, or to take it away."""


@dataclass(frozen=True)
class Sway:
    """Seeded unsteadiness of a bar in hands.

    Standard deviations of the rates at the turning points give, with the sway and the tremor
    below, the medians seen in a public corpus of 1,400 repetitions: 14 deg/s and 33 mm/s.
    Physiological tremor is 8-12 Hz; sway of a standing or pressing body lies below 2 Hz.
    """

    rate_x_mps: float = 0.016
    rate_y_mps: float = 0.034
    rate_yaw_radps: float = np.radians(3.0)
    rate_tilt_radps: float = np.radians(4.0)
    rate_spin_radps: float = np.radians(19.0)
    angle_yaw_rad: float = np.radians(1.0)
    angle_tilt_rad: float = np.radians(1.2)
    angle_spin_rad: float = np.radians(4.0)
    sway_m: float = 0.0012
    tremor_m: float = 3e-5
    sway_rad: float = np.radians(0.5)
    tremor_rad: float = np.radians(0.03)


@dataclass
class Plan:
    """A lift under construction, at time ``t_s`` and height ``z_m`` with vertical rate ``v_mps``.

    Attributes:
        rng: source of every variation.
        tilt_rad, yaw_rad, spin_rad, x_m, y_m: where the free coordinates rest now.
    """

    rng: np.random.Generator
    z_m: float
    t_s: float = 0.0
    v_mps: float = 0.0
    a_mps2: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    tilt_rad: float = 0.0
    spin_rad: float = 0.0
    sway: Sway = field(default_factory=Sway)
    still_spans_s: list[tuple[float, float]] = field(default_factory=list)
    contacts_s: list[float] = field(default_factory=list)
    turns_s: list[float] = field(default_factory=list)
    _held_since_s: float | None = None
    _held_spans_s: list[tuple[float, float]] = field(default_factory=list)
    _keys: dict[str, list[Key]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._vertical()
        self.lie()

    # Vertical blocks -------------------------------------------------------------------------

    def rest(self, duration_s: float) -> None:
        """The bar lies on floor, rack or pins: truly still."""
        self._release()
        self._go(duration_s, self.z_m, 0.0, 0.0)
        self.lie()
        self.still_spans_s.append((self.t_s - duration_s, self.t_s))

    def hold(self, duration_s: float) -> None:
        """The bar is held in hands at one height: slow, but not still."""
        self._grip()
        self.turn(0.3)
        self._go(duration_s, self.z_m, 0.0, 0.0)
        self.turn(0.3)

    def move(self, duration_s: float, z_m: float, y_m: float | None = None) -> None:
        """Minimum-jerk-like carry between two heights (unrack, walk out, put down)."""
        self._grip()
        self._go(duration_s, z_m, 0.0, 0.0)
        if y_m is not None:
            self.y_m = y_m
        self.turn(0.3)

    def stroke(
        self,
        travel_m: float,
        speed_mps: float,
        accel_in: float | None,
        accel_out: float | None,
        dip: float = 0.0,
    ) -> None:
        """One up or down stroke of ``travel_m`` (signed) with a plateau near ``speed_mps``.

        ``accel_in`` and ``accel_out`` are the magnitudes of acceleration at its two turning
        points; ``None`` stands for a soft start from, or a soft stop at, rest. ``dip`` is the
        share of the speed lost in the sticking region half way.
        """
        self._grip()
        sign = float(np.sign(travel_m))
        length, v = abs(travel_m), speed_mps
        t_in, d_in = _ramp(v, accel_in)
        t_out, d_out = _ramp(v, accel_out)
        plateau = length - d_in - d_out
        if plateau < 0.02 * length:
            raise ValueError(
                f"stroke of {length:.3f} m is too short for {v:.2f} m/s: "
                f"ramps take {d_in + d_out:.3f} m"
            )
        if accel_in is not None:
            self.set_turn_accel(sign * accel_in)
        self._go(t_in, self.z_m + sign * d_in, sign * v, 0.0)
        half = plateau / 2.0 / (v * (1.0 - dip / 2.0))
        if dip > 0.0:
            self._go(half, self.z_m + sign * plateau / 2.0, sign * v * (1.0 - dip), 0.0)
            self._go(half, self.z_m + sign * plateau / 2.0, sign * v, 0.0)
        else:
            self._go(2.0 * half, self.z_m + sign * plateau, sign * v, 0.0)
        self._go(t_out, self.z_m + sign * d_out, 0.0, -sign * (accel_out or 0.0))
        self.turn(1.0)
        self.turns_s.append(self.t_s)

    def to_speed(self, duration_s: float, z_m: float, v_mps: float, a_mps2: float = 0.0) -> None:
        """Reach height ``z_m`` with vertical rate and acceleration as given."""
        self._grip()
        self._go(duration_s, z_m, v_mps, a_mps2)

    def fall(self, z_floor_m: float, v_mps: float = 0.0) -> None:
        """Let go: free fall (or a throw at ``v_mps``) until the plates touch at ``z_floor_m``."""
        self._release()
        self.lie()
        self._go(0.05, self.z_m - 0.004, -0.18, -GRAVITY_MPS2)
        self._flight(z_floor_m)

    def bounce(self, contact_s: float, restitution: float) -> None:
        """Floor contact: reverse ``v_mps`` to ``-restitution * v_mps`` within ``contact_s``."""
        self.contacts_s.append(self.t_s)
        self._go(contact_s, self.z_m, -restitution * self.v_mps, self.a_mps2)

    def settle(self, contact_s: float, restitution: float, stop_mps: float = 0.25) -> None:
        """Bounce on the floor in free flight until the bar lies still."""
        floor = self.z_m
        self._release()
        while -self.v_mps * restitution > stop_mps:
            self.bounce(contact_s, restitution)
            self._flight(floor)
        self.contacts_s.append(self.t_s)
        self._go(contact_s * 3.0, floor, 0.0, 0.0)
        self.lie()

    def spin_to(self, angle_rad: float, rate_radps: float = 0.0) -> None:
        """Put a knot on the spin here, in place of a seeded one."""
        self.spin_rad = angle_rad
        self._put("spin", Key(self.t_s, angle_rad, rate_radps))

    # The result ------------------------------------------------------------------------------

    def finish(self) -> Trajectory:
        """The trajectory so far, with sway and tremor wherever hands hold the bar."""
        self._release()
        grip = [s for s in self._held_spans_s if s[1] - s[0] > 2.0 * HOLD_RAMP_S]
        held = window(grip, HOLD_RAMP_S)
        s = self.sway

        def coordinate(name: str, slow: float, fast: float) -> Sum:
            noise = self._noise(slow, fast)
            return Sum((Spline(self._keys[name]), Product(held, noise)))

        return Trajectory(
            x=coordinate("x", s.sway_m, s.tremor_m),
            y=coordinate("y", s.sway_m, s.tremor_m),
            z=coordinate("z", 0.5 * s.sway_m, s.tremor_m),
            yaw=coordinate("yaw", 0.5 * s.sway_rad, s.tremor_rad),
            tilt=coordinate("tilt", 0.5 * s.sway_rad, s.tremor_rad),
            spin=coordinate("spin", s.sway_rad, s.tremor_rad),
            duration_s=self.t_s,
        )

    # Inside ----------------------------------------------------------------------------------

    def _noise(self, slow: float, fast: float) -> Fourier:
        amplitude = [slow * self.rng.uniform(0.5, 1.0) for _ in range(3)]
        frequency = list(self.rng.uniform(0.3, 1.8, 3))
        amplitude += [fast * self.rng.uniform(0.5, 1.0) for _ in range(3)]
        frequency += list(self.rng.uniform(8.0, 12.0, 3))
        phase = self.rng.uniform(0.0, 2.0 * np.pi, 6)
        return Fourier(tuple(amplitude), tuple(frequency), tuple(phase))

    def _go(self, duration_s: float, z_m: float, v_mps: float, a_mps2: float) -> None:
        self.t_s += duration_s
        self.z_m, self.v_mps, self.a_mps2 = z_m, v_mps, a_mps2
        self._vertical()

    def _vertical(self) -> None:
        self._put("z", Key(self.t_s, self.z_m, self.v_mps, self.a_mps2))

    def set_turn_accel(self, a_mps2: float) -> None:
        """Give the present turning point its acceleration, once the next stroke is known."""
        self.a_mps2 = a_mps2
        self._vertical()

    def _flight(self, z_floor_m: float) -> None:
        drop = self.z_m - z_floor_m
        speed = float(np.sqrt(self.v_mps**2 + 2.0 * GRAVITY_MPS2 * max(drop, 0.0)))
        duration = (speed + self.v_mps) / GRAVITY_MPS2
        self._go(duration, z_floor_m, -speed, -GRAVITY_MPS2)

    def _grip(self) -> None:
        if self._held_since_s is None:
            self._held_since_s = self.t_s
            self.lie()

    def _release(self) -> None:
        if self._held_since_s is not None and self.t_s > self._held_since_s:
            self._held_spans_s.append((self._held_since_s, self.t_s))
        self._held_since_s = None

    def lie(self) -> None:
        """Knots of the free coordinates with no rate: the bar lies, or flies without turning."""
        for name, value in (
            ("x", self.x_m),
            ("y", self.y_m),
            ("yaw", self.yaw_rad),
            ("tilt", self.tilt_rad),
            ("spin", self.spin_rad),
        ):
            self._put(name, Key(self.t_s, value))

    def turn(self, share: float) -> None:
        """Knots of the free coordinates with seeded offsets and rates."""
        s, n = self.sway, self.rng.standard_normal(10)
        for name, base, spread, rate in (
            ("x", self.x_m, 0.004, s.rate_x_mps),
            ("y", self.y_m, 0.008, s.rate_y_mps),
            ("yaw", self.yaw_rad, s.angle_yaw_rad, s.rate_yaw_radps),
            ("tilt", self.tilt_rad, s.angle_tilt_rad, s.rate_tilt_radps),
            ("spin", self.spin_rad, s.angle_spin_rad, s.rate_spin_radps),
        ):
            offset, turn, n = n[0], n[1], n[2:]
            self._put(name, Key(self.t_s, base + spread * offset, share * rate * turn))

    def _put(self, name: str, key: Key) -> None:
        keys = self._keys.setdefault(name, [])
        if keys and keys[-1].t_s == key.t_s:
            keys[-1] = key
        else:
            keys.append(key)


def _ramp(speed_mps: float, accel_mps2: float | None) -> tuple[float, float]:
    """Duration and travel from a turning point to ``speed_mps``.

    With an acceleration that falls linearly from ``accel_mps2`` to zero, v = a T / 2 and
    d = 2/3 v T. A soft start is antisymmetric about its middle, so d = v T / 2.
    """
    if accel_mps2 is None:
        duration = 1.88 * speed_mps / 4.0 + 0.05
        return duration, 0.5 * speed_mps * duration
    duration = 2.0 * speed_mps / accel_mps2
    return duration, 2.0 / 3.0 * speed_mps * duration
