# SPDX-License-Identifier: Apache-2.0
"""A sprint down a straight lane, with a sensor on the trunk; the truth is closed forms.

The runner stands still, leans into the start, comes up over some metres, reaches the peak velocity
at one known instant, and runs out. The world's x axis is the lane; the yaw is zero throughout. The
"bar" of :class:`~hil.motion.bar.Bar` is the runner here: its one mount is the sensor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hil.motion.bar import Bar, Mount, Trajectory
from hil.motion.curves import Curve, Fourier, Integral, Key, Product, Spline, Sum, window
from hil.motion.lifts import Lift

ROLE = "leader"
SURGE_MPS = 0.12
"""Amplitude of the forward velocity's change within a step: braking and push."""
BOUNCE_M = 0.022
"""Of the trunk's rise and fall, at the rate of steps."""
LEAN_RAD = np.radians(2.5)
ROLL_RAD = np.radians(4.0)
"""Of the trunk's pitch at the rate of steps, and of its roll at the rate of strides."""
START_LEAN_RAD, RUN_LEAN_RAD = np.radians(38.0), np.radians(8.0)


@dataclass(frozen=True)
class Athlete:
    """Peak velocity, how long after the start it is reached, steps a second at full speed.

    The three peaks are the camera's in Kim and Yu (2025); the times are this project's.
    """

    peak_mps: float
    peak_after_s: float
    steps_hz: float


ATHLETES: Mapping[str, Athlete] = {
    "sprint_8.12": Athlete(8.12, 4.8, 4.1),
    "sprint_8.56": Athlete(8.56, 5.2, 4.2),
    "sprint_8.98": Athlete(8.98, 5.6, 4.3),
}


@dataclass(frozen=True)
class Sprint:
    """The run as a lift, so that whatever simulates lifts simulates it, and when its peak is."""

    run: Lift
    bar: Bar
    peak_mps: float
    t_peak_s: float


def sprint(name: str, seed: int = 0) -> Sprint:
    """One run; the seed varies the rest before it and the phases of the trunk's sway.

    Raises:
        ValueError: there is no athlete of that name.
    """
    if name not in ATHLETES:
        raise ValueError(f"no sprint '{name}': sprints are {', '.join(ATHLETES)}")
    who = ATHLETES[name]
    rng = np.random.default_rng([seed, 7])
    start = 1.5 + rng.uniform(0.0, 1.0)
    peak = start + who.peak_after_s
    stop, end = peak + 5.0, peak + 6.5
    trend = _trend(who, start, peak, stop)
    # The surge's velocity is greatest at the peak too, so the sum has its peak there, exactly.
    w = 2.0 * np.pi * who.steps_hz
    step = window([(start, stop)], 1.0)
    surge = Fourier((SURGE_MPS / w,), (who.steps_hz,), (float(-w * peak),))

    def sway(amplitude: float, frequency_hz: float) -> Curve:
        wave = Fourier((amplitude,), (frequency_hz,), (float(rng.uniform(0.0, 2.0 * np.pi)),))
        return Product(step, wave)

    lean = Spline(
        [
            Key(start, 0.0),
            Key(start + 0.45, START_LEAN_RAD),
            Key(start + 0.7 * who.peak_after_s, RUN_LEAN_RAD),
            Key(peak + 1.5, RUN_LEAN_RAD),
            Key(peak + 3.0, -RUN_LEAN_RAD),
            Key(stop, 0.0),
        ]
    )
    trajectory = Trajectory(
        x=Sum((trend, Product(step, surge))),
        y=sway(0.012, who.steps_hz / 2.0),
        z=Sum((Spline([Key(0.0, 1.05)]), sway(BOUNCE_M, who.steps_hz))),
        yaw=Spline([Key(0.0, 0.0)]),
        tilt=Sum((lean, sway(LEAN_RAD, who.steps_hz))),
        spin=sway(ROLL_RAD, who.steps_hz / 2.0),
        duration_s=end,
    )
    bar = Bar(0.5, 0.0, {ROLE: Mount(np.zeros(3), np.eye(3))})
    run = Lift(name, seed, trajectory, ((0.0, start), (stop, end)), (), ())
    return Sprint(run, bar, who.peak_mps, peak)


def _trend(who: Athlete, start: float, peak: float, stop: float) -> Integral:
    """The mean motion: v = V (1 - exp(-t / tau)) at its knots, its peak, and running out."""
    top = who.peak_mps - SURGE_MPS
    tau = who.peak_after_s / 4.0
    keys = [Key(start, 0.0)]
    for share in (0.1, 0.25, 0.45, 0.7):
        rest = float(np.exp(-share * who.peak_after_s / tau))
        t = start + share * who.peak_after_s
        keys.append(Key(t, top * (1.0 - rest), top / tau * rest, -top / tau**2 * rest))
    keys.append(Key(peak, top, 0.0, -0.05 * top))
    keys.append(Key(peak + 1.0, 0.975 * top, -0.05 * top))
    keys.append(Key(stop, 0.0))
    return Integral(Spline(keys))
