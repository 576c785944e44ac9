# SPDX-License-Identifier: Apache-2.0
"""A track held against the truth: one row of the league table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.compare.cases import Case, Truth
from hil.compare.methods import Track
from hil.motion.repetitions import concentrics, match
from hil.reference.attitude import matrix
from hil.reference.broad import WASHOUT_S, high_passed

Float = NDArray[np.float64]

SETTLE_S: Final = 0.6
"""From when on each tracker has something to say: none is judged before."""
REST_S: Final = 0.75
"""A rest that is shorter may be missed."""


@dataclass(frozen=True)
class Row:
    """One tracker on one run; None where there is no truth for it.

    Attributes:
        attitude_deg: RMSE of the inclination.
        velocity_mps: RMSE of the judged component of velocity.
        washed_mps: the same after a high-pass of 1 s on both sides; only where cameras are truth.
        mean_mps, peak_mps: RMSE of mean and peak velocity over the concentric phases found; of a
            sprint, ``peak_mps`` is the error of its greatest velocity.
        reps, missed, invented: true concentric phases, those not found, and those that are none.
        drift_m_per_min: by how much the integrated velocity is off, by amount.
        false_zupt_s: time that the tracker held still while the sensor moved.
        rests, missed_rests: true rests, and those in which it never held still.
        cost_us: processor time a sample.
    """

    case: str
    seed: int
    method: str
    samples: int
    attitude_deg: float | None = None
    velocity_mps: float | None = None
    washed_mps: float | None = None
    mean_mps: float | None = None
    peak_mps: float | None = None
    reps: int | None = None
    missed: int | None = None
    invented: int | None = None
    drift_m_per_min: float | None = None
    false_zupt_s: float | None = None
    rests: int | None = None
    missed_rests: int | None = None
    cost_us: float | None = None


def score(case: Case, method: str, track: Track) -> Row:
    """The row of one tracker."""
    title, seed, n = case.spec.title, case.spec.seed, len(case.samples.leader.t_ticks)
    if case.truth is None:
        return Row(title, seed, method, n, cost_us=track.cost_us)
    truth, t = case.truth, case.time_s(track.t_s)
    v = track.velocity_mps[:, case.axis]
    begin = case.time_s(np.array([case.samples.leader.t_ticks[0] / 16e6]))[0] + SETTLE_S
    inside = (t >= begin) & case.counts(t)
    step = float(np.median(np.diff(t)))
    true, ours = truth.velocity_mps(t), v if case.smooth is None else case.smooth(v, 1.0 / step)
    known = inside & np.isfinite(true) & np.isfinite(ours)
    error = (ours - true)[known]
    values: dict[str, Any] = {
        "attitude_deg": _tilt_rmse_deg(track.q[inside], truth.up(t[inside])),
        "velocity_mps": _rms(error),
        "drift_m_per_min": abs(60.0 * float(error.mean())) if error.size else None,
        "cost_us": track.cost_us,
    }
    if case.smooth is not None:
        values["washed_mps"] = _washed(t, ours, true, known)
    moving = truth.speed_mps(t) > truth.still_speed_mps
    values["false_zupt_s"] = step * float(np.sum(track.still & moving & (t >= begin)))
    values |= _rests(truth, t, track.still)
    if truth.peak_mps is not None:
        values["peak_mps"] = abs(float(v[inside].max()) - truth.peak_mps)
    if truth.repetitions is not None:
        values |= _repetitions(truth, t[inside], v[inside])
    return Row(title, seed, method, n, **values)


def _rms(x: Float) -> float | None:
    return math.sqrt(float(np.mean(x * x))) if x.size else None


def _tilt_rmse_deg(q: Float, up: Float) -> float | None:
    own = matrix(q.T)[2].T
    angle = np.arctan2(np.linalg.norm(np.cross(own, up), axis=1), np.sum(own * up, axis=1))
    found = _rms(angle[np.isfinite(angle)])
    return None if found is None else math.degrees(found)


def _washed(t: Float, ours: Float, true: Float, known: NDArray[np.bool_]) -> float | None:
    """As :func:`hil.reference.broad.velocity_rmse_mps` does it."""
    rate = 1.0 / float(np.median(np.diff(t)))
    both = np.isfinite(true) & np.isfinite(ours)
    a, b = (high_passed(np.where(both, x, np.nan), rate) for x in (ours, true))
    settle = int(3.0 * WASHOUT_S * rate)
    near_gap = np.convolve(~both, np.ones(settle + 1))[: len(both)] > 0
    near_gap[:settle] = True
    return _rms((a - b)[known & ~near_gap])


def _rests(truth: Truth, t: Float, still: NDArray[np.bool_]) -> dict[str, int]:
    spans = [(max(a, float(t[0])), min(b, float(t[-1]))) for a, b in truth.rests_s if len(t)]
    spans = [(a, b) for a, b in spans if b - a >= REST_S]
    held = [bool(still[(t >= a) & (t <= b)].any()) for a, b in spans]
    return {"rests": len(spans), "missed_rests": held.count(False)}


def _repetitions(truth: Truth, t: Float, v: Float) -> dict[str, float | int | None]:
    found = concentrics(t, v) if len(t) > 2 else []
    pairs, missed, invented = match(list(truth.repetitions or ()), found)
    # What began before the estimate did, or ends after it, cannot have been seen.
    missed = [p for p in missed if len(t) and t[0] < p.t_start_s < p.t_end_s < t[-1]]
    mean = np.array([b.mean_mps - a.mean_mps for a, b in pairs])
    peak = np.array([b.peak_mps - a.peak_mps for a, b in pairs])
    return {
        "reps": len(pairs) + len(missed),
        "missed": len(missed),
        "invented": len(invented),
        "mean_mps": _rms(mean),
        "peak_mps": _rms(peak),
    }


ROOT_MEAN_SQUARES: Final = ("attitude_deg", "velocity_mps", "washed_mps", "mean_mps", "peak_mps")
SUMS: Final = ("samples", "reps", "missed", "invented", "rests", "missed_rests", "false_zupt_s")
MEANS: Final = ("drift_m_per_min", "cost_us")


def pooled(rows: Sequence[Row]) -> Row:
    """The rows of one tracker and one case over its seeds as one: RMSE by their squares."""
    first = rows[0]
    values: dict[str, Any] = {}
    for name in (*ROOT_MEAN_SQUARES, *SUMS, *MEANS):
        have = [x for x in (getattr(row, name) for row in rows) if x is not None]
        if not have:
            continue
        if name in SUMS:
            values[name] = sum(have)
        elif name in MEANS:
            values[name] = sum(have) / len(have)
        else:
            values[name] = math.sqrt(sum(x * x for x in have) / len(have))
    return Row(first.case, len(rows), first.method, **values)


def league(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """By case, in the order of their coming: one pooled row for each tracker."""
    kept: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        kept.setdefault(row.case, {}).setdefault(row.method, []).append(row)
    return {
        case: [pooled(members) for members in methods.values()] for case, methods in kept.items()
    }


def as_mapping(row: Row) -> dict[str, Any]:
    """Without what is not known; five digits."""
    return {
        name: float(f"{value:.5g}") if isinstance(value, float) else value
        for name, value in asdict(row).items()
        if value is not None
    }
