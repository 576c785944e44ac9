# SPDX-License-Identifier: Apache-2.0
"""How well one choice of parameters does on one case, as plain numbers, and the cost made of them.

Where the truth is known:

    cost = (mean / L)^2 + (peak / L')^2 + (velocity / L)^2 + consistency + 10 (wrong + false)

with the RMSE of mean and peak concentric velocity and of the vertical velocity of the bar's centre
over their limits (:data:`hil.accuracy.LIMITS`), phases missed or invented, and whether any
zero-velocity update ran on a moving bar. Consistency is zero while the mean NEES of velocity and
tilt lies in its band and no more samples than a consistent filter's lie above it.

Where it is not, the negative logarithm of the likelihood of what the filter could not foresee: the
velocity with which it comes to each rest, and the height with which it comes back to each turning
point. Each innovation y with its variance S counts (y^2 / S + ln S) / 2, a proper scoring rule
(Gneiting and Raftery 2007, section 3): least for the smallest errors and a variance that is theirs.
A repetition more or less than now costs 10. What this cannot see stands in docs/tuning.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.accuracy import LIMITS
from hil.core import Estimator
from hil.fusion.consistency import chunks, errors, yaw_between
from hil.fusion.inputs import Run
from hil.fusion.truth import TrueMotion, against, true_motion
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.reference.study import NEES_BAND, NEES_STATES
from hil.reps import of_outputs, repetitions
from hil.tuning.case import Case, Known
from hil.tuning.rerun import as_frames

Float = NDArray[np.float64]
Settings = Mapping[str, float]
Figures = dict[str, float]

EVERY: Final = 8
"""NEES is taken on every so many steps: its neighbours say the same."""
WRONG: Final = 10.0
"""Cost of a repetition missed or invented: more than any error of velocity may cost."""
REFUSED: Final = 1e3
"""Cost where the estimator refuses the parameters, or comes to no number."""
NEES_ABOVE: Final = 0.025
TRIP: Final = int(Flag.ROUND_TRIP | Flag.ROUND_TRIP_GATED)


def evaluate(case: Case, several: Sequence[Settings]) -> list[Figures]:
    """Figures of each choice of parameters on one case; the order is kept.

    An estimator that refuses parameters or samples gives ``refused`` and nothing else.
    """
    true: TrueMotion | None = None
    found = []
    for settings in several:
        try:
            outputs, covariances = _steps(case.run, applied(case.run.params, settings))
        except ValueError:
            found.append({"refused": 1.0})
            continue
        figures = blind(outputs, case.run.params.zupt_variance)
        if case.known is not None:
            inside, t = _inside(case.known, outputs)
            if true is None or not np.array_equal(true.t_s, t):
                true = true_motion(case.known.lift, t)
            figures |= _against(true, outputs, covariances, inside, case.known.rests)
        found.append(figures)
    return found


def applied(params: Params, settings: Settings) -> Params:
    """``params`` with other numbers."""
    changes: dict[str, Any] = dict(settings)
    return replace(params, **changes)


def cost(figures: Figures, now: Figures, rests: bool = True) -> float:
    """What is made least; ``now`` are the figures with the image's own parameters."""
    if "refused" in figures:
        return REFUSED
    if "mean_rmse_mps" in figures:
        value = _known_cost(figures, rests)
    else:
        value = figures["rest_nll"] + figures["trip_nll"]
        value += WRONG * abs(figures["repetitions"] - now["repetitions"])
    return value if math.isfinite(value) else REFUSED


def _known_cost(f: Figures, rests: bool) -> float:
    limits = LIMITS[rests]
    value = (f["velocity_rmse_mps"] / limits.mean_rmse) ** 2
    if f["phases"] > 0.0:
        value += (f["mean_rmse_mps"] / limits.mean_rmse) ** 2
        value += (f["peak_rmse_mps"] / limits.peak_rmse) ** 2
    return value + consistency(f) + WRONG * (f["wrong"] + float(f["false_zupt"] > 0.0))


def consistency(f: Figures) -> float:
    """Zero for a filter as sure of itself as it may be."""
    low, high = NEES_BAND
    nees = max(f["nees"], 1e-9)
    outside = max(0.0, math.log(nees / high), math.log(low / nees))
    return outside**2 + max(0.0, f["nees_above"] / NEES_ABOVE - 1.0)


def blind(outputs: NDArray[np.void], zupt_variance: float) -> Figures:
    """What needs no truth: how the filter comes to rests and turning points, and repetitions."""
    rests = _rests(outputs)
    v = outputs["v"][rests].astype(np.float64)
    S = outputs["variance"][rests, 3:6].astype(np.float64) + zupt_variance  # noqa: N806
    trips = outputs[(outputs["flags"] & TRIP) != 0]
    y = trips["innovation"][:, 0].astype(np.float64)
    nis = trips["nis"].astype(np.float64)
    trip_S = np.where(nis > 0.0, y**2 / np.where(nis > 0.0, nis, 1.0), np.nan)  # noqa: N806
    seen = np.isfinite(trip_S) & (trip_S > 0.0)
    y, nis, trip_S = y[seen], nis[seen], trip_S[seen]  # noqa: N806
    return {
        "rests": float(len(rests)),
        "rest_rms_mps": _rms(v),
        "rest_nis": _mean(np.sum(v**2 / S, axis=1)) / 3.0,
        "rest_nll": _mean(0.5 * np.sum(v**2 / S + np.log(S), axis=1)),
        "trips": float(len(y)),
        "trip_rms_m": _rms(y),
        "trip_nis": _mean(nis),
        "trip_nll": _mean(0.5 * (nis + np.log(trip_S))),
        "repetitions": float(
            sum(len(repetitions(trace).repetitions) for trace in of_outputs(outputs))
        ),
    }


def _rests(outputs: NDArray[np.void]) -> NDArray[np.int64]:
    """Last step before each rest, as the detector has it: the filter knows nothing of it yet."""
    still = (outputs["flags"] & int(Flag.STILL)) != 0
    return np.flatnonzero(still[1:] & ~still[:-1])


def _mean(x: Float) -> float:
    return float(np.mean(x)) if x.size else 0.0


def _rms(x: Float) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0


def _steps(run: Run, params: Params) -> tuple[NDArray[np.void], Float]:
    """Outputs of the core in the firmware's own arithmetic, and (k, 5, 5) of every eighth step."""
    estimator = Estimator(params, np.float32)
    index = np.array(NEES_STATES)
    outputs, covariances, count = [], [], 0
    for leader, follower, arrival in chunks(run):
        result = estimator.run(leader, follower, arrival, covariances=True)
        first = -count % EVERY
        some = result.covariances[first::EVERY]
        covariances.append(some[:, index[:, None], index].astype(np.float64))
        outputs.append(result.outputs)
        count += len(result.outputs)
    return np.concatenate(outputs), np.concatenate(covariances)


def _inside(known: Known, outputs: NDArray[np.void]) -> tuple[NDArray[np.bool_], Float]:
    t = known.t_s(outputs["t_ticks"])
    inside = (t >= 0.0) & (t <= known.lift.duration_s)
    return inside, t[inside]


def _against(
    true: TrueMotion,
    outputs: NDArray[np.void],
    covariances: Float,
    inside: NDArray[np.bool_],
    rests: bool,
) -> Figures:
    if true.t_s.size < 3:
        return {"refused": 1.0}
    judged = against(true, as_frames(outputs[inside]), rests)
    pairs = judged.pairs
    levelled = judged.levelled if judged.levelled.any() else np.ones(true.t_s.size, bool)
    nees = _nees(true, outputs, covariances, inside)
    return {
        "phases": float(len(pairs)),
        "velocity_rmse_mps": _rms((judged.velocity_z_mps - judged.true_velocity_z_mps)[levelled]),
        "mean_rmse_mps": _rms(np.array([b.mean_mps - a.mean_mps for a, b in pairs])),
        "peak_rmse_mps": _rms(np.array([b.peak_mps - a.peak_mps for a, b in pairs])),
        "wrong": float(len(judged.missed) + len(judged.invented)),
        "false_zupt": float(judged.false_zupt),
        "nees": float(np.mean(nees)),
        "nees_above": float(np.mean(nees > NEES_BAND[1])),
    }


def _nees(
    true: TrueMotion, outputs: NDArray[np.void], covariances: Float, inside: NDArray[np.bool_]
) -> Float:
    """Of velocity and tilt, without the first eighth (:class:`hil.reference.study.Run`)."""
    some = inside[::EVERY][: len(covariances)]
    at = np.zeros(len(outputs), bool)
    at[::EVERY] = some
    rows, of_true = outputs[at], at[inside]
    rotation = true.rotation[of_true]
    turn = yaw_between(rows["q"][0].astype(np.float64), rotation[0])
    e = errors(rows, true.velocity_leader_mps[of_true] @ turn.T, turn @ rotation)
    solved = np.linalg.solve(covariances[some], e[:, :, None])[:, :, 0]
    nees: Float = np.einsum("ni,ni->n", e, solved)
    return nees[len(nees) // 8 :]
