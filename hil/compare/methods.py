# SPDX-License-Identifier: Apache-2.0
"""Every tracker over the samples of a case, under one form: a :class:`Track`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import process_time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.compare.cases import Case
from hil.core import NOTHING, Estimator, Samples, seconds, ticks
from hil.errors import HilError
from hil.reference.attitude import from_gravity, matrix
from hil.reference.estimator import Flag, Sample
from hil.reference.madgwick import madgwick_step
from hil.reference.params import Params
from hil.reference.sprint import SprintTracker
from hil.reference.tracker import Estimate, Slower, Tracker
from hil.reference.vertical_plane import PlaneParams, PlaneTracker
from hil.reference.zero_velocity import ZeroVelocityTracker

Float = NDArray[np.float64]

ALIGN_S: Final = 0.5
COUNTED_HZ: Final = 100.0
"""The rate at which a tracker's counts of samples make sense; its description gives none."""
REST_FORCE_MPS2: Final = 0.3
REST_RATE_RADPS: Final = 0.1
REST_HOLD_S: Final = 0.2
"""The integrations' common rule: | |f| - g | and |w| below these for so long, and v is zero."""


@dataclass(frozen=True)
class Track:
    """What a tracker made of n samples; times on the samples' clock.

    Attributes:
        q: (n, 4). velocity_mps: (n, 3) of the bar's centre. still: (n,).
        cost_us: processor time a sample.
    """

    t_s: Float
    q: Float
    velocity_mps: Float
    still: NDArray[np.bool_]
    cost_us: float


class CoreTracker:
    """The firmware's estimator under the shared interface of :mod:`hil.reference.tracker`."""

    def __init__(self, params: Params, dtype: Any = np.float32) -> None:
        self.estimator = Estimator(params, dtype)

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None:
        row = self.estimator.step(_samples([sample]), _samples(others))
        if row is None:
            return None
        values = {name: np.asarray(row[name], dtype=np.float64) for name in ("q", "v", "p")}
        still = bool(int(row["flags"]) & Flag.ZUPT)
        return Estimate(float(seconds(row["t_ticks"])), **values, still=still)


def _samples(rows: Sequence[Sample]) -> Samples:
    return Samples(
        ticks(np.array([r.t_s for r in rows])),
        np.array([r.accel_mps2 for r in rows]).reshape(-1, 3),
        np.array([r.gyro_radps for r in rows]).reshape(-1, 3),
        np.array([r.clipped for r in rows], dtype=bool),
        np.array([r.t_sigma_s for r in rows]),
    )


def _ours(case: Case) -> Track:
    fed = case.samples
    return _core(case, fed.follower, fed.arrival)


def _ours_alone(case: Case) -> Track | None:
    if len(case.samples.follower.t_ticks) == 0:
        return None
    return _core(case, NOTHING, None)


def _core(case: Case, follower: Samples, arrival: NDArray[np.int64] | None) -> Track:
    begin = process_time()
    result = Estimator(case.params, np.float32).run(case.samples.leader, follower, arrival)
    spent = process_time() - begin
    rows = result.outputs
    return Track(
        result.t_s,
        rows["q"].astype(np.float64),
        rows["centre_velocity_mps"].astype(np.float64),
        (rows["flags"] & int(Flag.ZUPT)) != 0,
        1e6 * spent / len(case.samples.leader.t_ticks),
    )


def _stepped(make: Callable[[Case], Tracker]) -> Callable[[Case], Track]:
    """A tracker of one sensor, fed one sample after the other."""

    def run(case: Case) -> Track:
        t, accel, gyro, clipped, _ = case.samples.leader.columns()
        rows = [Sample(*row) for row in zip(seconds(t).tolist(), accel, gyro, clipped, strict=True)]
        tracker = make(case)
        begin = process_time()
        estimates = [tracker.step(row) for row in rows]
        spent = process_time() - begin
        kept = [(k, e) for k, e in enumerate(estimates) if e is not None]
        q = np.array([e.q for _, e in kept]).reshape(-1, 4)
        v = np.array([e.v for _, e in kept]).reshape(-1, 3)
        at = np.array([k for k, _ in kept], dtype=np.int64)
        return Track(
            np.array([e.t_s for _, e in kept]),
            q,
            at_centre(case.params, q, v, gyro[at]),
            np.array([e.still for _, e in kept], dtype=bool),
            1e6 * spent / len(rows),
        )

    return run


def at_centre(params: Params, q: Float, v_mps: Float, gyro_radps: Float) -> Float:
    """(n, 3) velocity of the bar's centre from that of the sensor: v - R (w x r)."""
    arm = np.cross(gyro_radps, params.lever_leader_m)
    centre: Float = v_mps - np.einsum("ijn,nj->ni", matrix(q.T), arm)
    return centre


def _integrated(attitude: Callable[[Case, Float, Float], Float]) -> Callable[[Case], Track]:
    """Attitude by a filter, gravity off, trapezoids, and the common rule of zero velocity.

    All three begin alike: the gyroscope's mean over the first ``ALIGN_S`` is taken off.
    """

    def run(case: Case) -> Track:
        t_ticks, accel, gyro, _, _ = case.samples.leader.columns()
        t = seconds(t_ticks)
        begin = process_time()
        first = max(int(np.searchsorted(t, t[0] + ALIGN_S)), 1)
        rate = gyro - gyro[:first].mean(axis=0)
        q = attitude(case, accel, rate)
        force = np.einsum("ijn,nj->ni", matrix(q.T), accel)
        force[:, 2] -= case.params.gravity_mps2
        still = at_rest(t, accel, rate, case.params.gravity_mps2)
        v = integrate(t, force, still)
        spent = process_time() - begin
        centre = at_centre(case.params, q, v, rate)
        after = slice(first, None)
        return Track(t[after], q[after], centre[after], still[after], 1e6 * spent / len(t))

    return run


def at_rest(t_s: Float, accel: Float, rate: Float, gravity_mps2: float) -> NDArray[np.bool_]:
    """(n,) the common rule: both below their limits, and for ``REST_HOLD_S`` before."""
    quiet = np.abs(np.linalg.norm(accel, axis=1) - gravity_mps2) < REST_FORCE_MPS2
    quiet &= np.linalg.norm(rate, axis=1) < REST_RATE_RADPS
    last_loud = np.maximum.accumulate(np.where(quiet, -np.inf, t_s))
    still: NDArray[np.bool_] = quiet & (t_s - np.maximum(last_loud, t_s[0]) >= REST_HOLD_S)
    return still


def integrate(t_s: Float, accel_mps2: Float, still: NDArray[np.bool_]) -> Float:
    """(n, 3) velocity by trapezoids, zero wherever it is still."""
    steps = 0.5 * (accel_mps2[1:] + accel_mps2[:-1]) * np.diff(t_s)[:, None]
    free = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    # Each sample less what had come together by the last one at rest.
    last = np.maximum.accumulate(np.where(still, np.arange(len(t_s)), 0))
    velocity: Float = free - free[last]
    return velocity


def _madgwick(case: Case, accel: Float, rate: Float) -> Float:
    t = seconds(case.samples.leader.t_ticks)
    q = _level(accel, t)
    rows = np.empty((len(accel), 4))
    steps = np.diff(t, prepend=t[0]).tolist()
    for k, (a, w, dt) in enumerate(zip(accel, rate, steps, strict=True)):
        q = madgwick_step(q, a, w, dt, case.params.madgwick_gain)
        rows[k] = q
    return rows


def _level(accel: Float, t_s: Float) -> Float:
    first = max(int(np.searchsorted(t_s, t_s[0] + ALIGN_S)), 1)
    return from_gravity(accel[:first].mean(axis=0))


def _vqf(case: Case, accel: Float, rate: Float) -> Float:
    t = seconds(case.samples.leader.t_ticks)
    period = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    found = (
        _extra("vqf")
        .VQF(period)
        .updateBatch(np.ascontiguousarray(rate), np.ascontiguousarray(accel))
    )
    q: Float = found["quat6D"]
    return q


def _fusion(case: Case, accel: Float, rate: Float) -> Float:
    fusion = _extra("imufusion")
    t = seconds(case.samples.leader.t_ticks)
    period = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    settings = fusion.AhrsSettings()
    # As its own example has it: reject what is 10 deg off, and recover after 5 s, in samples.
    settings.sample_rate = 1.0 / period
    settings.convention = fusion.CONVENTION_NWU
    settings.gain = 0.5
    settings.gyroscope_range = 2000.0
    settings.acceleration_rejection = 10.0
    settings.rejection_timeout = 5.0 / period
    ahrs = fusion.Ahrs()
    ahrs.set_settings(settings)
    ahrs.set_quaternion(_level(accel, t))
    ahrs.skip_startup()
    rows = np.empty((len(accel), 4))
    degrees, g = np.degrees(rate), accel / case.params.gravity_mps2
    for k in range(len(rows)):
        ahrs.update_no_magnetometer(degrees[k], g[k])
        rows[k] = ahrs.get_quaternion()
    return rows


def _extra(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise HilError(
            f"the package '{name}' is not installed", "pip install 'hil[compare]'"
        ) from error


def _zero_velocity(case: Case) -> Tracker:
    block = max(round(case.params.rate_hz / COUNTED_HZ), 1)
    return Slower(ZeroVelocityTracker(), block)


OURS: Final = "ours"
METHODS: Final[Mapping[str, Callable[[Case], Track | None]]] = {
    OURS: _ours,
    "ours, one sensor": _ours_alone,
    "sprint EKF": _stepped(lambda case: SprintTracker()),
    "vertical plane": _stepped(lambda case: PlaneTracker(PlaneParams(plane_axis=case.plane_axis))),
    "zero velocity": _stepped(_zero_velocity),
    "VQF": _integrated(_vqf),
    "Madgwick": _integrated(_madgwick),
    "Fusion": _integrated(_fusion),
}
"""In the table's order. The last three are integrations on a filter's attitude."""


def need_extras() -> None:
    """Ask for what is missing before anything is run.

    Raises:
        HilError: a package is not installed.
    """
    for name in ("vqf", "imufusion"):
        _extra(name)
