# SPDX-License-Identifier: Apache-2.0
"""What is compared on: samples of one run, and what is true of it where that is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil import library, timesync
from hil.core import NOTHING, Samples, ticks
from hil.errors import HilError, RecordingError
from hil.fusion.inputs import runs
from hil.fusion.truth import lift_of
from hil.motion.bar import Bar, at_point
from hil.motion.imu_model import sample
from hil.motion.lifts import KNOW_RESTS, LIFTS, Lift, named
from hil.motion.repetitions import Concentric
from hil.motion.repetitions import truth as true_repetitions
from hil.motion.sprint import ATHLETES, ROLE, sprint
from hil.parity import Batch, batch
from hil.recording import load
from hil.reference import broad
from hil.reference.attitude import matrix
from hil.reference.params import Params
from hil.reference.study import STILL_SPEED_MPS, simulate
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]
Kind = Literal["motion", "sprint", "broad", "recording"]

RESTS: Final = "_rests"
MOTIONS: Final = (*LIFTS, *(name + RESTS for name in KNOW_RESTS), "still")
SPRINTS: Final = tuple(ATHLETES)
TRIALS: Final = ("14", "15", "24")

OPTICAL_STILL_MPS: Final = 0.05
"""Below it, cameras cannot tell motion from their own noise."""


@dataclass(frozen=True)
class Spec:
    """Which case: small, so that it travels between processes.

    Attributes:
        name: of the lift, sprint or trial, or the recording's path.
        folder: of the trial: holds broad/*.hdf5.
    """

    kind: Kind
    name: str
    seed: int = 0
    folder: str = ""

    @property
    def title(self) -> str:
        return {"broad": f"BROAD {self.name}"}.get(self.kind, self.name.replace("_", " "))


@dataclass(frozen=True)
class Truth:
    """What is true, as functions of the case's time, s, (n,); NaN where it is not known.

    Attributes:
        velocity_mps: (n,) the component that is judged: upwards of the bar's centre, or forwards.
        up: (n, 3) the world's vertical in the sensor's axes.
        speed_mps: (n,) of the fastest sensor.
        repetitions: None where the motion has none.
        peak_mps: greatest velocity of a sprint.
    """

    velocity_mps: Callable[[Float], Float]
    up: Callable[[Float], Float]
    speed_mps: Callable[[Float], Float]
    rests_s: Sequence[tuple[float, float]]
    still_speed_mps: float = STILL_SPEED_MPS
    repetitions: Sequence[Concentric] | None = None
    peak_mps: float | None = None


@dataclass(frozen=True)
class Case:
    """Samples and truth of one run.

    Attributes:
        axis: world axis of the velocity that is judged: 2 upwards, 0 forwards.
        time_s: from a time on the samples' clock to the truth's.
        smooth: low-pass of an estimate at its rate, Hz: the one that the truth has been through.
        counts: over which times errors are taken.
        plane_axis: along which the bar does not move, for the tracker that asks.
    """

    spec: Spec
    samples: Batch
    params: Params
    truth: Truth | None
    axis: int = 2
    time_s: Callable[[Float], Float] = field(default=lambda t: t)
    smooth: Callable[[Float, float], Float] | None = None
    counts: Callable[[Float], NDArray[np.bool_]] = field(
        default=lambda t: np.ones(len(t), dtype=bool)
    )
    plane_axis: int = 0


def make(spec: Spec) -> Case:
    """The case that ``spec`` names.

    Raises:
        HilError: there is none such, or it cannot be read.
    """
    return {"motion": _motion, "sprint": _sprint, "broad": _broad, "recording": _recording}[
        spec.kind
    ](spec)


def motion_specs(name: str, seeds: int) -> list[Spec]:
    """Specs of one motion or sprint, or of ``all``.

    Raises:
        HilError: there is none of that name.
    """
    names = (*MOTIONS, *SPRINTS) if name == "all" else (name,)
    if name == "sprint":
        names = SPRINTS
    for one in names:
        if one not in MOTIONS and one not in SPRINTS:
            raise HilError(
                f"no motion '{one}'", "name one of: all, sprint, " + ", ".join((*MOTIONS, *SPRINTS))
            )
    return [
        Spec("sprint" if one in SPRINTS else "motion", one, seed)
        for one in names
        for seed in range(1, seeds + 1)
    ]


def _motion(spec: Spec) -> Case:
    rests = spec.name.endswith(RESTS)
    lift = named(spec.name.removesuffix(RESTS), spec.seed, rests)
    return Case(spec, batch(*simulate(lift, spec.seed)), Params(), _of_lift(lift, Bar(), 2))


def _sprint(spec: Spec) -> Case:
    run = sprint(spec.name, spec.seed)
    stream = sample(run.run.trajectory, run.bar, ROLE, spec.seed)
    truth = _of_lift(run.run, run.bar, 0)
    # A runner is no bar: no lever arms, no round trip, no hold, and no bound on forward speed.
    params = replace(
        Params(),
        lever_leader_m=np.zeros(3),
        lever_follower_m=np.zeros(3),
        round_trip=False,
        hold_span_s=0.0,
        bound_period_s=0.0,
    )
    return Case(
        spec,
        batch(stream, None),
        params,
        replace(truth, repetitions=None, peak_mps=run.peak_mps),
        axis=0,
        # A runner does not move sideways.
        plane_axis=1,
    )


def _of_lift(lift: Lift, bar: Bar, axis: int) -> Truth:
    def speed(t: Float) -> Float:
        motion = lift.trajectory(t)
        ends = [at_point(motion, mount).velocity_mps for mount in bar.mounts.values()]
        fastest: Float = np.max([np.linalg.norm(v, axis=1) for v in ends], axis=0)
        return fastest

    return Truth(
        lambda t: lift.trajectory(t).velocity_mps[:, axis],
        lambda t: lift.trajectory(t).rotation[:, 2, :],
        speed,
        lift.still_spans_s,
        repetitions=true_repetitions(lift.trajectory),
    )


def _broad(spec: Spec) -> Case:
    try:
        trial = broad.load(spec.folder, spec.name)
    except FileNotFoundError as error:
        raise HilError(str(error), "name the folder that holds broad/: --data DIR") from error
    except ModuleNotFoundError as error:
        raise HilError(
            "BROAD's files need h5py, which is not installed", "pip install 'hil[compare]'"
        ) from error
    rate, n = trial.rate_hz, len(trial.accel_mps2)
    own = Samples(ticks(np.arange(n) / rate), trial.accel_mps2, trial.gyro_radps)
    none = np.zeros(0, dtype=np.int64)
    grid, velocity = np.arange(n) / rate, broad.true_velocity(trial)
    up = matrix(np.nan_to_num(trial.q_true).T)[2].T
    up[np.isnan(trial.q_true).any(axis=1)] = np.nan
    position = trial.p_true_m
    step = np.full((n, 3), np.nan)
    step[1:-1] = 0.5 * (position[2:] - position[:-2]) * rate
    speed = np.linalg.norm(
        np.stack([broad.smoothed(step[:, k], rate) for k in range(3)], axis=1), axis=1
    )

    def nearest(t: Float) -> NDArray[np.int64]:
        return np.clip(np.rint(t * rate).astype(np.int64), 0, n - 1)

    return Case(
        spec,
        Batch(own, NOTHING, none),
        broad.params(rate),
        Truth(
            lambda t: np.interp(t, grid, velocity),
            lambda t: up[nearest(t)],
            lambda t: np.interp(t, grid, speed),
            _spans(~trial.counts, grid),
            still_speed_mps=OPTICAL_STILL_MPS,
        ),
        # As in hil.reference.broad, whole samples: stamps of ours lie half way between two.
        time_s=lambda t: np.floor(t * rate + 0.01) / rate,
        smooth=broad.smoothed,
        counts=lambda t: trial.counts[nearest(t)],
    )


def _spans(inside: NDArray[np.bool_], t_s: Float) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [(float(t_s[a]), float(t_s[b - 1])) for a, b in pairs]


def _recording(spec: Spec) -> Case:
    recording = load(library.resolve(Path(spec.name)))
    found = runs(recording)
    if not found:
        raise RecordingError(
            f"{spec.name}: no IMU batch in the leader's stream: there is nothing to compare on",
            "record with an image that has the estimator: hil build",
        )
    run, truth = found[-1], None
    known, sync = lift_of(recording), timesync.analyse(recording)
    case = Case(spec, run.samples, run.params, None)
    if known is None or not sync.truth:
        return case
    lift, start_s, _ = known
    clock, truth = sync.truth.clocks["leader"], _of_lift(lift, Bar(), 2)
    return replace(
        case,
        truth=truth,
        time_s=lambda t: clock.true_ns(t * TICK_RATE_HZ) / 1e9 - start_s,
        counts=lambda t: (t >= 0.0) & (t <= lift.duration_s),
    )
