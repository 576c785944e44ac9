# SPDX-License-Identifier: Apache-2.0
"""The lifts: one function each, from a seed to a set of repetitions.

Every set begins and ends with the bar lying still; what happens between is the point.
``rests=True`` puts the bar down (floor, pins) for about a second between repetitions,
``rests=False`` goes touch and go: from the first unrack to the last rerack no sample is still.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hil.motion.bar import Trajectory
from hil.motion.curves import Key, Spline, Sum
from hil.motion.plan import Plan, Sway

FLOOR_Z_M = 0.225
"""Height of the bar's centre with 450 mm plates on the floor (IWF rule 3.3.3.5)."""


@dataclass(frozen=True)
class Lift:
    """One set and what is true of it.

    Attributes:
        still_spans_s: where the bar lies truly still (plus sensor noise, nothing moves).
        contacts_s: instants at which plates hit the floor.
        turns_s: turning points of the strokes.
    """

    name: str
    seed: int
    trajectory: Trajectory
    still_spans_s: tuple[tuple[float, float], ...]
    contacts_s: tuple[float, ...]
    turns_s: tuple[float, ...]

    @property
    def duration_s(self) -> float:
        return self.trajectory.duration_s


def bench(seed: int, reps: int = 8, rests: bool = False, sway: Sway | None = None) -> Lift:
    """Bench press: 490 mm of travel, peaks near 1,050 mm/s. With rests: pin press."""
    plan = _plan(seed, 1.0, sway)
    return _pressed(
        "bench",
        seed,
        plan,
        reps=reps,
        rests=rests,
        travel_m=0.49,
        bottom_spread_m=0.010,
        peak_mps=1.11,
        down_mps=0.55,
    )


def squat(seed: int, reps: int = 8, rests: bool = False, sway: Sway | None = None) -> Lift:
    """Back squat: 620 mm, depth spread 15 mm. With rests: pin squat."""
    plan = _plan(seed, 1.45, sway)
    return _pressed(
        "squat",
        seed,
        plan,
        reps=reps,
        rests=rests,
        travel_m=0.62,
        bottom_spread_m=0.015,
        peak_mps=1.0,
        down_mps=0.7,
    )


def touch_and_go_ten(seed: int) -> Lift:
    """Ten bench repetitions without any rest."""
    return bench(seed, reps=10, rests=False)


def slow_eccentric(seed: int, reps: int = 4, seconds: float = 5.0) -> Lift:
    """Bench press lowered over ``seconds``: near constant, near zero velocity for seconds."""
    plan = _plan(seed, 1.0, None)
    return _pressed(
        "slow_eccentric",
        seed,
        plan,
        reps=reps,
        rests=False,
        travel_m=0.49,
        bottom_spread_m=0.010,
        peak_mps=0.9,
        down_mps=0.49 / seconds * 1.05,
    )


def tilted(seed: int, reps: int = 6) -> Lift:
    """Bench press with one arm behind the other: tilted by some degrees all along, swinging."""
    plan = _plan(seed, 1.0, Sway(angle_tilt_rad=np.radians(4.0), rate_tilt_radps=np.radians(12.0)))
    plan.tilt_rad = np.radians(plan.rng.uniform(4.0, 8.0)) * plan.rng.choice([-1.0, 1.0])
    plan.yaw_rad = np.radians(plan.rng.uniform(-3.0, 3.0))
    return _pressed(
        "tilted",
        seed,
        plan,
        reps=reps,
        rests=False,
        travel_m=0.49,
        bottom_spread_m=0.010,
        peak_mps=1.0,
        down_mps=0.55,
    )


def spinning(seed: int, reps: int = 6, rate_dps: float = 360.0) -> Lift:
    """Repetitions while the shaft spins in the hands at about ``rate_dps``."""
    plan = _plan(seed, 1.0, None)
    lift = _pressed(
        "spinning",
        seed,
        plan,
        reps=reps,
        rests=False,
        travel_m=0.49,
        bottom_spread_m=0.010,
        peak_mps=0.95,
        down_mps=0.6,
    )
    first, last = lift.still_spans_s[0][1] + 1.5, lift.still_spans_s[-1][0] - 1.5
    rate = np.radians(rate_dps)
    ramp = 0.8
    turned = rate * (last - first - ramp)
    spin = Spline(
        [
            Key(first, 0.0),
            Key(first + ramp, rate * ramp / 2.0, rate),
            Key(last - ramp, turned - rate * ramp / 2.0, rate),
            Key(last, turned),
        ]
    )
    t = lift.trajectory
    whole = Trajectory(t.x, t.y, t.z, t.yaw, t.tilt, Sum((t.spin, spin)), t.duration_s)
    return Lift("spinning", seed, whole, lift.still_spans_s, lift.contacts_s, lift.turns_s)


def deadlift(seed: int, reps: int = 6, rests: bool = False) -> Lift:
    """Deadlift. Touch and go bounces the plates off the floor; with rests the bar lies dead."""
    plan = _plan(seed, FLOOR_Z_M, None)
    rng = plan.rng
    plan.rest(rng.uniform(1.5, 2.5))
    travel = 0.52 + 0.03 * rng.standard_normal()
    speed = rng.uniform(0.65, 0.95)
    for rep in range(reps):
        v = speed * (1.0 - 0.02 * rep) * rng.uniform(0.96, 1.04)
        top = FLOOR_Z_M + travel + 0.005 * rng.standard_normal()
        if rep == 0 or rests:
            accel = _turn_accel(v, travel)
            plan.stroke(top - plan.z_m, v, None, accel, dip=rng.uniform(0.0, 0.25))
        else:
            accel = _turn_accel(v, travel)
            out_t, out_d = 2.0 * v / accel, 4.0 / 3.0 * v * v / accel
            plan.to_speed(0.12, plan.z_m + 0.06 * (plan.v_mps + v), v)
            plan.to_speed((top - out_d - plan.z_m) / v, top - out_d, v)
            plan.to_speed(out_t, top, 0.0, -accel)
            plan.turn(1.0)
            plan.turns_s.append(plan.t_s)
        down = rng.uniform(0.8, 1.2)
        accel = _turn_accel(down, travel)
        plan.set_turn_accel(-accel)
        ramp_t, ramp_d = 2.0 * down / accel, 4.0 / 3.0 * down * down / accel
        plan.to_speed(ramp_t, top - ramp_d, -down)
        if rests or rep == reps - 1:
            soft = 0.25
            plan.to_speed(
                (plan.z_m - FLOOR_Z_M - 0.02) / (0.5 * (down + soft)), FLOOR_Z_M + 0.02, -soft
            )
            plan.to_speed(0.02 / soft, FLOOR_Z_M, -soft)
            plan.lie()
            plan.settle(0.03, 0.3)
            plan.rest(rng.uniform(0.8, 1.6))
        else:
            plan.to_speed((plan.z_m - FLOOR_Z_M) / down, FLOOR_Z_M, -down)
            plan.bounce(rng.uniform(0.035, 0.07), rng.uniform(0.25, 0.45))
            plan.turn(1.0)
    plan.rest(1.0)
    return _lift("deadlift", seed, plan)


def snatch(seed: int, reps: int = 2) -> Lift:
    """Snatch: pull to about 1.9 m/s, turnover with the bar spinning, catch, stand, lower."""
    plan = _plan(seed, FLOOR_Z_M, None)
    rng = plan.rng
    plan.rest(rng.uniform(1.5, 2.5))
    for _ in range(reps):
        peak = rng.uniform(1.75, 2.0)
        spin0 = plan.spin_rad
        plan.to_speed(0.45, 0.50, 1.15, 0.0)
        plan.to_speed(0.12, 0.64, 1.15, 3.0)
        plan.to_speed(0.20, 0.95, peak, 0.0)
        plan.spin_to(spin0)
        plan.to_speed(0.24, 1.29, 0.55, -7.0)
        plan.to_speed(0.11, 1.31, -0.35, -5.0)
        plan.spin_to(spin0 + np.radians(rng.uniform(80.0, 120.0)))
        plan.to_speed(0.16, 1.20, -0.9, 2.0)
        plan.to_speed(0.28, 1.05, 0.0, 4.0)
        plan.turn(0.6)
        up = rng.uniform(0.7, 0.95)
        accel = _turn_accel(up, 0.58)
        plan.stroke(0.62 + 0.01 * rng.standard_normal(), up, accel, accel, dip=0.2)
        plan.set_turn_accel(0.0)
        plan.hold(rng.uniform(0.8, 1.5))
        plan.spin_to(plan.spin_rad)
        plan.move(1.1, 0.85)
        plan.spin_rad = spin0 + np.radians(20.0) * rng.standard_normal()
        _put_down(plan, 0.9)
    return _lift("snatch", seed, plan)


def clean_and_jerk(seed: int, reps: int = 2) -> Lift:
    """Clean, front squat, dip, drive and split jerk, then lowered to the floor."""
    plan = _plan(seed, FLOOR_Z_M, None)
    rng = plan.rng
    plan.rest(rng.uniform(1.5, 2.5))
    for _ in range(reps):
        peak = rng.uniform(1.4, 1.65)
        spin0 = plan.spin_rad
        plan.to_speed(0.50, 0.47, 0.95, 0.0)
        plan.to_speed(0.13, 0.60, 0.95, 2.5)
        plan.to_speed(0.20, 0.85, peak, 0.0)
        plan.spin_to(spin0)
        plan.to_speed(0.22, 1.10, 0.4, -7.0)
        plan.to_speed(0.10, 1.11, -0.35, -6.0)
        plan.spin_to(spin0 + np.radians(rng.uniform(60.0, 90.0)))
        plan.to_speed(0.18, 0.98, -1.0, 2.0)
        plan.to_speed(0.30, 0.80, 0.0, 4.0)
        plan.turn(0.6)
        up = rng.uniform(0.65, 0.85)
        accel = _turn_accel(up, 0.55)
        plan.stroke(0.55, up, accel, accel, dip=0.3)
        plan.set_turn_accel(0.0)
        plan.hold(rng.uniform(1.0, 1.6))
        plan.stroke(-0.16, 0.45, None, 7.0)
        plan.to_speed(0.26, plan.z_m + 0.24, rng.uniform(1.35, 1.55), 0.0)
        plan.to_speed(0.18, plan.z_m + 0.17, 0.3, -6.0)
        plan.to_speed(0.10, plan.z_m + 0.005, -0.15, 0.0)
        plan.to_speed(0.12, plan.z_m - 0.01, 0.0, 0.0)
        plan.turn(0.6)
        plan.stroke(0.20, 0.35, None, None)
        plan.hold(rng.uniform(0.8, 1.4))
        plan.spin_to(plan.spin_rad)
        plan.move(1.0, 1.2)
        plan.move(1.0, 0.7)
        plan.spin_rad = spin0 + np.radians(20.0) * rng.standard_normal()
        _put_down(plan, 0.9)
    return _lift("clean_and_jerk", seed, plan)


def drop(seed: int, reps: int = 2) -> Lift:
    """Dropped from overhead on bumper plates: free fall, saturating impacts, bounces, rest."""
    plan = _plan(seed, FLOOR_Z_M, None)
    rng = plan.rng
    plan.rest(rng.uniform(1.5, 2.5))
    for _ in range(reps):
        plan.stroke(0.85, rng.uniform(0.9, 1.1), None, 4.0)
        plan.set_turn_accel(0.0)
        plan.hold(0.8)
        plan.stroke(rng.uniform(0.6, 0.8), 0.8, None, 4.0)
        plan.set_turn_accel(0.0)
        plan.hold(rng.uniform(0.8, 1.5))
        plan.fall(FLOOR_Z_M)
        plan.settle(rng.uniform(0.012, 0.018), rng.uniform(0.35, 0.5))
        plan.rest(rng.uniform(1.5, 2.5))
    return _lift("drop", seed, plan)


LIFTS: Mapping[str, Callable[..., Lift]] = {
    "bench": bench,
    "squat": squat,
    "deadlift": deadlift,
    "snatch": snatch,
    "clean_and_jerk": clean_and_jerk,
    "drop": drop,
    "touch_and_go_ten": touch_and_go_ten,
    "slow_eccentric": slow_eccentric,
    "tilted": tilted,
    "spinning": spinning,
}

KNOW_RESTS = ("bench", "squat", "deadlift")
"""Lifts that take ``rests``."""
WITH_RESTS = ("deadlift", "bench", "squat", "snatch", "clean_and_jerk")
TOUCH_AND_GO = ("bench", "squat", "deadlift", "touch_and_go_ten", "tilted", "slow_eccentric")


def still(seed: int) -> Lift:
    """No lift at all: the bar lies for ten seconds."""
    plan = _plan(seed, FLOOR_Z_M, None)
    plan.rest(10.0)
    return _lift("still", seed, plan)


def named(name: str, seed: int, rests: bool = False) -> Lift:
    """A lift by its name, or ``still``; ``rests`` puts the bar down between repetitions.

    Raises:
        ValueError: there is none of that name, or it has no way with rests.
    """
    if name == "still":
        return still(seed)
    if name not in LIFTS:
        raise ValueError(f"no lift '{name}': lifts are {', '.join(LIFTS)}, still")
    if not rests:
        return LIFTS[name](seed)
    if name not in KNOW_RESTS:
        raise ValueError(
            f"the lift '{name}' has no variant with rests: leave 'rests' out, or take one of "
            + ", ".join(KNOW_RESTS)
        )
    return LIFTS[name](seed, rests=True)


def seeded_set(seed: int, rests: bool) -> Lift:
    """The ``seed``-th set of the accuracy study, with rests or touch and go."""
    names = WITH_RESTS if rests else TOUCH_AND_GO
    name = names[seed % len(names)]
    return named(name, seed, rests and name in KNOW_RESTS)


def _plan(seed: int, z_m: float, sway: Sway | None) -> Plan:
    plan = Plan(np.random.default_rng([seed, 4]), z_m, sway=sway or Sway())
    rng = plan.rng
    # No rack is level and no lifter takes the bar with the same marks up.
    plan.tilt_rad = np.radians(0.8) * rng.standard_normal()
    plan.spin_rad = np.radians(8.0) * rng.standard_normal()
    plan.lie()
    return plan


def _pressed(
    name: str,
    seed: int,
    plan: Plan,
    *,
    reps: int,
    rests: bool,
    travel_m: float,
    bottom_spread_m: float,
    peak_mps: float,
    down_mps: float,
) -> Lift:
    """Squat and bench: from the rack, out, down and up, and back."""
    rng = plan.rng
    plan.lie()
    rack = plan.z_m
    plan.rest(rng.uniform(1.5, 2.5))
    plan.move(rng.uniform(0.7, 1.0), rack + 0.05, y_m=plan.y_m)
    plan.move(rng.uniform(0.9, 1.3), rack + 0.03, y_m=plan.y_m - 0.25)
    plan.hold(rng.uniform(0.5, 1.0))
    lifter = rng.uniform(0.93, 1.07)
    top_mean = plan.z_m
    bottom_mean = top_mean - travel_m * rng.uniform(0.94, 1.06)
    soft_start = True
    for rep in range(reps):
        bottom = bottom_mean + (0.0 if rests else bottom_spread_m * rng.standard_normal())
        top = top_mean + 0.006 * rng.standard_normal()
        v = peak_mps * lifter * (1.0 - 0.02 * rep) * rng.uniform(0.97, 1.03)
        accel = _turn_accel(v, top - bottom)
        down = down_mps * rng.uniform(0.85, 1.15)
        down_in = None if soft_start else _turn_accel(down, plan.z_m - bottom)
        last = rep == reps - 1
        out = None if last else min(accel, _turn_accel(down_mps, travel_m) * 1.5)
        if rests:
            plan.stroke(bottom - plan.z_m, min(down, 0.6), None, None)
            plan.lie()
            plan.rest(rng.uniform(0.8, 1.5))
            soft = min(0.8 * v, 1.2 * float(np.sqrt(top - plan.z_m)))
            plan.stroke(top - plan.z_m, soft, None, None, dip=rng.uniform(0.0, 0.2))
            plan.hold(rng.uniform(0.3, 0.8))
            continue
        plan.stroke(bottom - plan.z_m, down, down_in, accel)
        out = accel if out is None else max(out, _turn_accel(v, top - bottom))
        plan.stroke(top - plan.z_m, v, accel, out, dip=rng.uniform(0.0, 0.12))
        soft_start = False
    if not rests:
        plan.set_turn_accel(0.0)
    plan.hold(rng.uniform(0.4, 0.8))
    plan.move(rng.uniform(0.9, 1.2), rack + 0.05, y_m=plan.y_m + 0.25)
    plan.move(rng.uniform(0.6, 0.9), rack)
    plan.lie()
    plan.rest(rng.uniform(1.0, 1.5))
    return _lift(name, seed, plan)


def _put_down(plan: Plan, duration_s: float) -> None:
    """Lower to the floor by hand, touch it softly, and lie still."""
    plan.to_speed(duration_s, FLOOR_Z_M, -0.3)
    plan.lie()
    plan.settle(0.03, 0.3)
    plan.rest(plan.rng.uniform(1.0, 2.0))


def _turn_accel(speed_mps: float, travel_m: float) -> float:
    """Acceleration at the turning points that leaves 15 % of the travel for the plateau."""
    return 8.0 / 3.0 * speed_mps**2 / (0.85 * abs(travel_m))


def _lift(name: str, seed: int, plan: Plan) -> Lift:
    trajectory = plan.finish()
    return Lift(
        name,
        seed,
        trajectory,
        tuple(plan.still_spans_s),
        tuple(plan.contacts_s),
        tuple(plan.turns_s),
    )
