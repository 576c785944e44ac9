# SPDX-License-Identifier: Apache-2.0
"""The leader's estimate against what the simulated bar truly did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.motion.bar import Bar, at_point
from hil.motion.lifts import LIFTS, Lift, named
from hil.motion.repetitions import Concentric, concentrics, match
from hil.motion.repetitions import truth as true_repetitions
from hil.recording import Recording
from hil.reference.attitude import matrix
from hil.reference.estimator import Flag
from hil.reference.study import STILL_SPEED_MPS
from hil.timesync.analysis import Sync

Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Judged:
    """EKF frames beside the truth at the times that they refer to.

    Attributes:
        t_s: float64[n], time since the lift began.
        velocity_z_mps, true_velocity_z_mps: float64[n], of the bar's centre.
        tilt_error_rad: float64[n], angle between estimated and true vertical.
        levelled: bool[n], from the first zero-velocity update on: an estimator that began on a
            moving bar cannot know the level before.
        zupt: bool[n], a zero-velocity update ran and was taken.
        false_zupt: frames with a zero-velocity update while either sensor truly moved.
        pairs: (true, estimated) concentric phases; ``missed`` and ``invented`` have no partner.
        rests: the bar is put down between the repetitions.
    """

    t_s: Float
    velocity_z_mps: Float
    true_velocity_z_mps: Float
    tilt_error_rad: Float
    levelled: NDArray[np.bool_]
    zupt: NDArray[np.bool_]
    false_zupt: int
    pairs: Sequence[tuple[Concentric, Concentric]]
    missed: Sequence[Concentric]
    invented: Sequence[Concentric]
    rests: bool


def lift_of(recording: Recording) -> tuple[Lift, float, bool] | None:
    """The lift of the scenario, when it began in true time, s, and whether it has rests."""
    motion = recording.provenance.scenario.get("motion") or {}
    if motion.get("lift") not in LIFTS:
        return None
    rests = bool(motion.get("rests", False))
    lift = named(str(motion["lift"]), int(motion.get("seed", 1)), rests)
    has_rests = rests or lift.name in ("snatch", "clean_and_jerk")
    return lift, float(motion.get("start_s", 3.0)), has_rests


def judge(recording: Recording, sync: Sync, states: NDArray[Any]) -> Judged | None:
    """EKF frames of one start against the truth; None where the truth is not known."""
    found = lift_of(recording)
    if found is None or not sync.truth or states.size == 0:
        return None
    lift, start_s, rests = found
    clock = sync.truth.clocks["leader"]
    t = clock.true_ns(states["t_ticks_leader"].astype(np.float64)) / 1e9 - start_s
    inside = (t >= 0.0) & (t <= lift.duration_s)
    return against(true_motion(lift, t[inside]), states[inside], rests)


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """What the bar truly does at n times.

    Attributes:
        t_s: float64[n], since the lift began.
        velocity_mps: float64[n, 3] of the bar's centre; ``velocity_leader_mps`` of that sensor.
        rotation: float64[n, 3, 3], body to world.
        speed_mps: float64[n], of the faster sensor.
        phases: concentric phases of the whole lift.
    """

    t_s: Float
    velocity_mps: Float
    velocity_leader_mps: Float
    rotation: Float
    speed_mps: Float
    phases: Sequence[Concentric]


def true_motion(lift: Lift, t: Float) -> TrueMotion:
    """The lift at times from its beginning to its end."""
    motion = lift.trajectory(t)
    ends = {role: at_point(motion, mount).velocity_mps for role, mount in Bar().mounts.items()}
    return TrueMotion(
        t,
        motion.velocity_mps,
        ends["leader"],
        motion.rotation,
        np.max([np.linalg.norm(v, axis=1) for v in ends.values()], axis=0),
        true_repetitions(lift.trajectory),
    )


def against(true: TrueMotion, states: NDArray[Any], rests: bool) -> Judged:
    """EKF frames, or steps under their names, at the times of ``true``."""
    t = true.t_s
    zupt = (states["flags"] & int(Flag.ZUPT)) != 0
    velocity_z = states["centre_velocity_mps"][:, 2].astype(np.float64)
    up = np.moveaxis(matrix(states["quaternion"].astype(np.float64).T), -1, 0)[:, 2, :]
    true_up = true.rotation[:, 2, :]
    apart = np.linalg.norm(np.cross(up, true_up), axis=1)
    pairs, missed, invented = match(
        list(true.phases), concentrics(t, velocity_z) if t.size > 2 else []
    )
    # What began before the estimate did, or ends after it, cannot have been seen.
    missed = [
        phase for phase in missed if t.size and t[0] < phase.t_start_s < phase.t_end_s < t[-1]
    ]
    return Judged(
        t,
        velocity_z,
        true.velocity_mps[:, 2],
        np.arcsin(np.clip(apart, 0.0, 1.0)),
        np.logical_or.accumulate(zupt),
        zupt,
        int(np.sum(zupt & (true.speed_mps > STILL_SPEED_MPS))),
        pairs,
        missed,
        invented,
        rests,
    )
