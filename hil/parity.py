# SPDX-License-Identifier: Apache-2.0
"""The same samples through the reference and through the core, and how far apart they come out.

Both get sample times on the 16 MHz grid of the leader's clock, so that time's quantisation is no
part of the difference.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.core import NOTHING, Estimator, Samples, seconds, ticks
from hil.motion.imu_model import ImuStream
from hil.reference import estimator as reference
from hil.reference.params import Params
from hil.reference.study import Link, feed

FloatArray = NDArray[np.float64]

SCALES: Mapping[str, float] = {
    "v": 1.0,
    "centre_velocity_mps": 1.0,
    "q": 1.0,
    "b_a": 0.1,
    "b_g": 0.01,
    "q_madgwick": 1.0,
}
"""What a relative error of a state is relative to, where the state's own largest value is less.

A velocity that returns to zero, or a bias near zero, has no relative error of its own: 1 m/s is a
slow repetition, 0.1 m/s^2 and 0.01 rad/s are biases of a part without calibration. Positions and
variances, which span decades, are taken relative to their own largest value in the run.
"""


@dataclass(frozen=True)
class Batch:
    """Samples of both IMUs and the leader step on which each follower sample rides."""

    leader: Samples
    follower: Samples
    arrival: NDArray[np.int64]


def batch(leader: ImuStream, follower: ImuStream | None, link: Link | None = None) -> Batch:
    """What :func:`hil.reference.study.feed` would hand to the reference, as arrays."""
    own, others, arrival = [], [], []
    for k, (sample, arrived) in enumerate(feed(leader, follower, link or Link())):
        own.append(sample)
        others += arrived
        arrival += [k] * len(arrived)
    return Batch(_samples(own), _samples(others), np.array(arrival, dtype=np.int64))


def first_steps(samples: Batch, steps: int) -> Batch:
    """The batch up to leader sample ``steps``."""
    kept = int((samples.arrival < steps).sum())

    def cut(one: Samples, n: int) -> Samples:
        t, accel, gyro, clipped, t_sigma = one.columns()
        return Samples(t[:n], accel[:n], gyro[:n], clipped[:n], t_sigma[:n])

    return Batch(cut(samples.leader, steps), cut(samples.follower, kept), samples.arrival[:kept])


def _samples(samples: list[reference.Sample]) -> Samples:
    if not samples:
        return NOTHING
    return Samples(
        ticks(np.array([s.t_s for s in samples])),
        np.array([s.accel_mps2 for s in samples]),
        np.array([s.gyro_radps for s in samples]),
        np.array([s.clipped for s in samples]),
        np.array([s.t_sigma_s for s in samples]),
    )


def run_core(samples: Batch, params: Params, dtype: Any = np.float64) -> NDArray[np.void]:
    """Outputs of the core over a batch."""
    return Estimator(params, dtype).run(samples.leader, samples.follower, samples.arrival).outputs


def run_reference(samples: Batch, params: Params) -> NDArray[np.void]:
    """Outputs of the reference over a batch, in the core's layout for float64."""
    estimator = reference.Estimator(params)
    own, others = _rows(samples.leader), _rows(samples.follower)
    bounds = np.searchsorted(samples.arrival, np.arange(len(own) + 1))
    rows = np.zeros(len(own), Estimator(params).dtype)
    filled = 0
    for k, sample in enumerate(own):
        output = estimator.step(sample, others[bounds[k] : bounds[k + 1]])
        if output is None:
            continue
        row = rows[filled]
        row["t_ticks"] = ticks(np.array(output.t_s))
        row["step"] = k
        for name in rows.dtype.names or ():
            if name not in ("t_ticks", "step"):
                row[name] = getattr(output, name)
        filled += 1
    return rows[:filled]


def _rows(samples: Samples) -> list[reference.Sample]:
    t, accel, gyro, clipped, t_sigma = samples.columns()
    return [
        reference.Sample(float(t[i]), accel[i], gyro[i], bool(clipped[i]), float(t_sigma[i]))
        for t in (seconds(t),)
        for i in range(len(t))
    ]


def relative_errors(ours: NDArray[np.void], theirs: NDArray[np.void]) -> dict[str, float]:
    """Largest difference of each field over the run, relative to its scale (``SCALES``).

    Fields that only some steps have (innovation, NIS) and flags are not here.

    Raises:
        ValueError: the two do not have outputs for the same steps.
    """
    if not np.array_equal(ours["step"], theirs["step"]):
        raise ValueError("outputs for different steps: the alignments ended apart")
    errors = {}
    for name in (*SCALES, "p", "variance", "centre_height_m"):
        a, b = (x[name].astype(np.float64).reshape(len(x), -1) for x in (ours, theirs))
        scale = np.maximum(np.abs(b).max(axis=0), SCALES.get(name, 0.0))
        errors[name] = float((np.abs(a - b).max(axis=0) / scale).max())
    return errors


def attitude_error_rad(ours: NDArray[np.void], theirs: NDArray[np.void]) -> FloatArray:
    """(k,) angle between the two attitudes at each step."""
    a, b = (x["q"].astype(np.float64) for x in (ours, theirs))
    # |a - b| of unit quaternions is 2 sin(angle / 4), which keeps its digits near zero.
    apart = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    angle: FloatArray = 4.0 * np.arcsin(np.minimum(0.5 * apart, 1.0))
    return angle
