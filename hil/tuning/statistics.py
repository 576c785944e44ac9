# SPDX-License-Identifier: Apache-2.0
"""The ZUPT detector's statistics over a whole run, made once for all thresholds.

With the variance detector (docs/estimator.md, section 7.2) a sensor is still on a step when

* the variance of |f| - g over the window is below ``zupt_accel_var``, and neither the newest
  |f| - g nor the newest force vector is further from its mean than ``zupt_release`` times that;
* the mean of |w - b_g|^2 is below ``zupt_gyro_var``, and the newest is not above
  ``zupt_release`` times that;
* the mean of |f| - g is within ``zupt_level_mps2``.

So each sensor, by the larger both, and by the largest over the dwell the detector itself, is one
number against each threshold: the least threshold with which it fires on that step. The
gyroscope's biases are those that the estimator comes to with the run's own parameters; other
thresholds may change them in the last digits, because they move updates of the biases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hil.core import TICKS_PER_S, Estimator, Samples
from hil.fusion.inputs import Run
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.tuning.parameters import ParameterError

Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Statistics:
    """What the detector needs to fire, step by step from the end of the alignment on.

    Attributes:
        t_ticks: int64[n], time of each leader sample.
        period_s: mean time of a step.
        accel_var: float64[n], (m/s^2)^2: fires when ``zupt_accel_var`` lies above it ...
        gyro_var: float64[n], (rad/s)^2: ... and ``zupt_gyro_var`` above this. inf: never.
        outputs: of the core with the run's own parameters, the same n steps.
    """

    t_ticks: NDArray[np.int64]
    period_s: float
    accel_var: Float
    gyro_var: Float
    outputs: NDArray[np.void]


def statistics(run: Run) -> Statistics:
    """The detector's statistics over one start of the estimator.

    Raises:
        ParameterError: the run has the SHOE detector, which has one threshold and not two.
    """
    p = run.params
    if p.zupt_shoe:
        raise ParameterError(
            "zupt_shoe is on: the SHOE detector has one threshold, shoe_threshold",
            "tune the variance detector: zupt_shoe=false",
        )
    fed = run.samples
    outputs = Estimator(p).run(fed.leader, fed.follower, fed.arrival).outputs
    n, steps = len(fed.leader.t_ticks), outputs["step"].astype(np.int64)
    if steps.size < 2:
        empty = np.zeros(0)
        return Statistics(np.zeros(0, np.int64), 1.0 / p.rate_hz, empty, empty, outputs)
    # The detector runs before the step's own updates: with the biases of the step before.
    b_g = np.vstack([outputs["b_g"][:1], outputs["b_g"][:-1]]).astype(np.float64)
    own = filtered(fed.leader, p, p.rotation_leader)
    accel, gyro = _sensor(own, p, steps, np.zeros(len(steps), np.int64), b_g)
    follower = filtered(fed.follower, p, p.rotation_follower)
    heard = np.searchsorted(fed.arrival, steps, side="right") - 1
    lost = (outputs["flags"] & int(Flag.FOLLOWER_LOST)) != 0
    bias = _follower_bias(run, follower, int(steps[0]) - 1)
    cleared = _heard_since(heard, lost)
    theirs = _sensor(follower, p, heard, cleared, np.broadcast_to(bias, b_g.shape))
    accel, gyro = (
        np.where(lost, mine, np.maximum(mine, other))
        for mine, other in zip((accel, gyro), theirs, strict=True)
    )
    period_s = float(fed.leader.t_ticks[-1] - fed.leader.t_ticks[0]) / TICKS_PER_S / max(n - 1, 1)
    t_ticks = np.asarray(fed.leader.t_ticks)[steps]
    return Statistics(
        t_ticks, period_s, _held(accel, p.zupt_dwell), _held(gyro, p.zupt_dwell), outputs
    )


def filtered(samples: Samples, params: Params, rotation: Float) -> Float:
    """(n, 6) force and rate of one sensor in the bar's axes, prefiltered as the estimator does."""
    _, accel, gyro, _, _ = samples.columns()
    x = np.hstack([accel @ rotation.T, gyro @ rotation.T])
    if len(x) == 0:
        return x
    if params.prefilter_iir:
        kernel = _impulse_response(params)
    else:
        kernel = np.full(params.average_length, 1.0 / params.average_length)
    # The first sample fills the memory, so a start is no step.
    padded = np.vstack([np.broadcast_to(x[0], (len(kernel) - 1, 6)), x])
    return np.stack([np.convolve(c, kernel, "valid") for c in padded.T], axis=1)


def _impulse_response(params: Params) -> Float:
    """Of the Butterworth prefilter (equation 7), until it has died away below 1e-17."""
    k = math.tan(math.pi * params.cutoff_hz / params.rate_hz)
    d = 1.0 + math.sqrt(2.0) * k + k * k
    b = (k * k / d, 2.0 * k * k / d, k * k / d)
    a1, a2 = 2.0 * (k * k - 1.0) / d, (1.0 - math.sqrt(2.0) * k + k * k) / d
    length = math.ceil(40.0 / -math.log(math.sqrt(a2))) if 0.0 < a2 < 1.0 else 64
    h = [b[0], b[1] - a1 * b[0]]
    h.append(b[2] - a1 * h[1] - a2 * h[0])
    while len(h) < max(length, 8):
        h.append(-a1 * h[-1] - a2 * h[-2])
    return np.array(h)


def _sensor(
    rows: Float, p: Params, newest: NDArray[np.int64], since: NDArray[np.int64], b_g: Float
) -> tuple[Float, Float]:
    """Least thresholds with which one sensor is still, for windows that end at row ``newest``.

    ``since`` is the first row that a window may hold; a window that is not full is never still.
    """
    w = p.zupt_window
    full = newest - w + 1 >= since
    accel = np.full(len(newest), np.inf)
    gyro = np.full(len(newest), np.inf)
    at, bias = newest[full], b_g[full]
    if at.size == 0:
        return accel, gyro
    force, rate = rows[:, :3], rows[:, 3:]
    excess = np.sqrt(np.sum(force * force, axis=1)) - p.gravity_mps2
    begin = at - w + 1
    excess_mean = _means(excess[:, None], w)[begin, 0]
    var = sliding_window_view(excess, w).var(axis=1)[begin]
    spread2 = (excess[at] - excess_mean) ** 2
    jump2 = np.sum((force[at] - _means(force, w)[begin]) ** 2, axis=1)
    least = np.maximum(var, np.maximum(spread2, jump2) / p.zupt_release)
    accel[full] = np.where(np.abs(excess_mean) > p.zupt_level_mps2, np.inf, least)
    # Mean |w - b|^2 = mean |w|^2 - 2 b . mean w + |b|^2, about the whole run's mean of still steps.
    centre = np.median(bias, axis=0)
    off, shift = rate - centre, bias - centre
    turning2 = (
        _means(np.sum(off * off, axis=1)[:, None], w)[begin, 0]
        - 2.0 * np.sum(shift * _means(off, w)[begin], axis=1)
        + np.sum(shift * shift, axis=1)
    )
    now2 = np.sum((rate[at] - bias) ** 2, axis=1)
    gyro[full] = np.maximum(turning2, now2 / p.zupt_release)
    return accel, gyro


def _means(x: Float, width: int) -> Float:
    """Means of (n, k) over windows of ``width`` rows, each summed anew: no running sum."""
    mean: Float = sliding_window_view(x, width, axis=0).mean(axis=-1)
    return mean


def _follower_bias(run: Run, rows: Float, align_step: int) -> Float:
    """What the alignment took for the follower's gyroscope bias: its mean rate, if all was still.

    The same test as ``Estimator::align``; zero otherwise, and without a follower.
    """
    p, fed = run.params, run.samples
    own = filtered(fed.leader, p, p.rotation_leader)[: align_step + 1]
    theirs = rows[: int(np.searchsorted(fed.arrival, align_step, side="right"))]
    off = own[:, :3] - own[0, :3]
    still = (
        np.mean(np.sum(off * off, axis=1)) - np.sum(off.mean(axis=0) ** 2) < 3 * p.zupt_accel_var
        and np.sum(own[:, 3:].var(axis=0)) < p.zupt_gyro_var
    )
    bias: Float = theirs[:, 3:].mean(axis=0) if still and len(theirs) else np.zeros(3)
    return bias


def _heard_since(heard: NDArray[np.int64], lost: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First follower row that the window may hold on each step: after the last loss."""
    first = np.where(lost, heard + 1, 0)
    since: NDArray[np.int64] = np.maximum.accumulate(np.concatenate([[0], first[:-1]]))
    return since


def _held(least: Float, dwell: int) -> Float:
    """Largest of the last ``dwell`` values; inf where there are not so many."""
    held = np.full(len(least), np.inf)
    if len(least) >= dwell:
        held[dwell - 1 :] = _largest(least, dwell)
    return held


def _largest(x: Float, width: int) -> Float:
    """Sliding maximum by doubling: log2(width) passes."""
    done = 1
    while done < width:
        step = min(done, width - done)
        x = np.maximum(x[:-step], x[step:])
        done += step
    return x
