# SPDX-License-Identifier: Apache-2.0
"""Is the estimator as sure of itself as it may be? NEES against the simulated bar's truth."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.core import Estimator, Samples
from hil.fusion.inputs import Run
from hil.fusion.truth import lift_of
from hil.motion.bar import Bar, at_point
from hil.motion.lifts import Lift
from hil.recording import Recording
from hil.reference.attitude import matrix
from hil.reference.study import NEES_STATES
from hil.timesync.analysis import Sync

Float = NDArray[np.float64]

CHUNK_STEPS: Final = 4096
"""A covariance is 225 numbers: so many at a time are kept."""


def nees(recording: Recording, sync: Sync, run: Run) -> tuple[Float, Float]:
    """NEES of velocity and tilt on every step of the lift (Bar-Shalom, Li and Kirubarajan 2001,
    section 5.4), of the host's core in float32.

    Returns:
        time since the lift began in s and NEES with five degrees of freedom, float64[n] each;
        empty where the truth is not known.
    """
    found = lift_of(recording)
    nothing = np.zeros(0), np.zeros(0)
    if found is None or not sync.truth:
        return nothing
    lift, start_s, _ = found
    clock, index = sync.truth.clocks["leader"], np.array(NEES_STATES)
    estimator = Estimator(run.params, np.float32)
    times, values = [], []
    turn: Float | None = None
    for leader, follower, arrival in chunks(run):
        result = estimator.run(leader, follower, arrival, covariances=True)
        outputs = result.outputs
        t = clock.true_ns(outputs["t_ticks"].astype(np.float64)) / 1e9 - start_s
        inside = (t >= 0.0) & (t <= lift.duration_s)
        if not inside.any():
            continue
        t, outputs = t[inside], outputs[inside]
        P = result.covariances[inside][:, index[:, None], index].astype(np.float64)  # noqa: N806
        velocity, rotation = _truth(lift, t)
        if turn is None:
            turn = yaw_between(outputs["q"][0].astype(np.float64), rotation[0])
        e = errors(outputs, velocity @ turn.T, turn @ rotation)
        values.append(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]))
        times.append(t)
    return (np.concatenate(times), np.concatenate(values)) if times else nothing


def errors(outputs: NDArray[np.void], velocity_mps: Float, rotation: Float) -> Float:
    """(n, 5) truth minus estimate in the states of :data:`NEES_STATES`: velocity and tilt.

    Args:
        velocity_mps: (n, 3) of the leader's sensor, in the estimator's world frame.
        rotation: (n, 3, 3) body to the same frame.
    """
    estimated = np.moveaxis(matrix(outputs["q"].astype(np.float64).T), -1, 0)
    d = rotation @ np.swapaxes(estimated, 1, 2)
    tilt = 0.5 * np.stack([d[:, 2, 1] - d[:, 1, 2], d[:, 0, 2] - d[:, 2, 0]], axis=1)
    return np.concatenate([velocity_mps - outputs["v"].astype(np.float64), tilt], axis=1)


def _truth(lift: Lift, t: Float) -> tuple[Float, Float]:
    motion = lift.trajectory(t)
    return at_point(motion, Bar().mounts["leader"]).velocity_mps, motion.rotation


def yaw_between(quaternion: Float, rotation: Float) -> Float:
    """(3, 3) turn about the vertical from the truth to the estimate: yaw has no reference."""
    d = matrix(quaternion) @ rotation.T
    angle = np.arctan2(d[1, 0] - d[0, 1], d[0, 0] + d[1, 1])
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def chunks(run: Run) -> list[tuple[Samples, Samples, NDArray[np.int64]]]:
    """The run's samples, so many steps at a time."""
    fed = run.samples
    total = len(fed.leader.t_ticks)
    found = []
    for begin in range(0, total, CHUNK_STEPS):
        end = min(begin + CHUNK_STEPS, total)
        a, b = np.searchsorted(fed.arrival, (begin, end))
        found.append(
            (_cut(fed.leader, begin, end), _cut(fed.follower, a, b), fed.arrival[a:b] - begin)
        )
    return found


def _cut(samples: Samples, begin: int, end: int) -> Samples:
    t, accel, gyro, clipped, sigma = samples.columns()
    rows = slice(int(begin), int(end))
    return Samples(t[rows], accel[rows], gyro[rows], clipped[rows], sigma[rows])
