# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N803, N806 (matrices carry the capital letters of the equations)
"""Accuracy and consistency against analytic truth: run one set, then count over many.

``python -m hil.reference.study`` prints the figures of the reference itself, at about a second a
repetition; ``python -m hil.accuracy`` makes the table of docs/estimator.md, section 9, with the
core.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hil.motion.bar import Bar, at_point
from hil.motion.imu_model import CALIBRATED, ErrorSpread, ImuConfig, ImuStream, sample
from hil.motion.lifts import Lift, seeded_set
from hil.motion.repetitions import Concentric, concentrics, match, truth
from hil.reference.attitude import FloatArray, from_gravity, matrix
from hil.reference.estimator import Estimator, Flag, Output, Sample
from hil.reference.params import Params

STILL_SPEED_MPS = 0.01
"""A zero-velocity update while either sensor truly moves faster than this is false."""


@dataclass(frozen=True)
class Link:
    """How the follower's samples reach the leader.

    Attributes:
        latency_s: from sample to arrival; arrivals come in batches of ``batch`` samples.
        offset_s: constant error of the follower's time on the leader's clock.
        t_sigma_s: what the estimator is told of that error.
        lost_s: spans of leader time in which nothing arrives.
    """

    latency_s: float = 0.012
    batch: int = 4
    offset_s: float = 0.0
    t_sigma_s: float = 1e-6
    lost_s: Sequence[tuple[float, float]] = ()


@dataclass(frozen=True)
class Run:
    """One set through the estimator: the outputs and the truth at the same times."""

    lift: Lift
    t_s: FloatArray
    outputs: Sequence[Output]
    true_speed_ends_mps: FloatArray
    pairs: Sequence[tuple[Concentric, Concentric]]
    missed: Sequence[Concentric]
    invented: Sequence[Concentric]
    nees: FloatArray
    covariances: FloatArray
    errors: FloatArray

    @property
    def false_zupt(self) -> int:
        """Steps with an accepted zero-velocity update while the bar truly moved."""
        fired = np.array([bool(o.flags & Flag.ZUPT) for o in self.outputs])
        return int(np.sum(fired & (self.true_speed_ends_mps > STILL_SPEED_MPS)))

    @property
    def nees_mean(self) -> float:
        """Mean NEES without the first eighth of the set."""
        return float(self.nees[len(self.nees) // 8 :].mean())

    @property
    def nees_above(self) -> float:
        """Share of the same samples whose NEES lies above :data:`NEES_BAND`."""
        return float(np.mean(self.nees[len(self.nees) // 8 :] > NEES_BAND[1]))


def feed(
    leader: ImuStream, follower: ImuStream | None, link: Link
) -> Iterator[tuple[Sample, list[Sample]]]:
    """Leader samples in order, each with the follower samples that have arrived by then."""
    n_f = 0 if follower is None else len(follower.t_node_s)
    arrived = 0
    for k in range(len(leader.t_node_s)):
        now = float(leader.t_true_s[k])
        batch: list[Sample] = []
        while follower is not None and arrived < n_f:
            last = min(arrived - arrived % link.batch + link.batch, n_f) - 1
            if float(follower.t_true_s[last]) + link.latency_s > now:
                break
            t_f = float(follower.t_true_s[arrived])
            if not any(a <= t_f < b for a, b in link.lost_s):
                batch.append(
                    Sample(
                        t_f + link.offset_s,
                        follower.accel_mps2[arrived],
                        follower.gyro_radps[arrived],
                        bool(follower.clipped[arrived]),
                        link.t_sigma_s,
                    )
                )
            arrived += 1
        yield (
            Sample(now, leader.accel_mps2[k], leader.gyro_radps[k], bool(leader.clipped[k])),
            batch,
        )


def run_set(
    lift: Lift,
    seed: int,
    params: Params | None = None,
    *,
    spread: ErrorSpread = CALIBRATED,
    link: Link | None = None,
    two: bool = True,
    config: ImuConfig | None = None,
    make: Callable[[Params], Estimator] = Estimator,
) -> Run:
    """Simulate both IMUs on ``lift``, estimate, and compare with the truth."""
    config = config or ImuConfig()
    params = params or Params(rate_hz=config.rate_hz)
    leader, follower = simulate(lift, seed, spread=spread, config=config)
    estimator = make(params)
    outputs, covariances = [], []
    for own, others in feed(leader, follower if two else None, link or Link()):
        output = estimator.step(own, others)
        if output is not None:
            outputs.append(output)
            covariances.append(estimator.nav.P.copy())
    return score(lift, leader, params, outputs, np.array(covariances))


def simulate(
    lift: Lift, seed: int, *, spread: ErrorSpread = CALIBRATED, config: ImuConfig | None = None
) -> tuple[ImuStream, ImuStream]:
    """Streams of leader and follower; the follower's chip runs 1.3 % slower."""
    config, bar = config or ImuConfig(), Bar()
    slower = ImuConfig(config.odr_hz, config.odr_error - 0.013)
    leader = sample(lift.trajectory, bar, "leader", seed, config=config, spread=spread)
    follower = sample(
        lift.trajectory, bar, "follower", seed, config=slower, spread=spread, t_first_s=0.0007
    )
    return leader, follower


def score(
    lift: Lift,
    leader: ImuStream,
    params: Params,
    outputs: Sequence[Output],
    covariances: FloatArray,
) -> Run:
    """Compare the outputs of an estimator, and P (n, 15, 15) after each, with the truth."""
    bar = Bar()
    t = np.array([o.t_s for o in outputs])
    motion = lift.trajectory(t)
    at_leader = at_point(motion, bar.mounts["leader"])
    at_follower = at_point(motion, bar.mounts["follower"])
    speed = np.maximum(
        np.linalg.norm(at_leader.velocity_mps, axis=1),
        np.linalg.norm(at_follower.velocity_mps, axis=1),
    )
    estimated = concentrics(t, np.array([o.centre_velocity_mps[2] for o in outputs]))
    pairs, missed, invented = match(truth(lift.trajectory), estimated)
    errors = _errors(outputs, at_leader.velocity_mps, motion.rotation, leader, params)
    nees = _nees(errors, covariances)
    return Run(lift, t, outputs, speed, pairs, missed, invented, nees, covariances, errors)


def _errors(
    outputs: Sequence[Output],
    velocity: FloatArray,
    rotation: FloatArray,
    leader: ImuStream,
    params: Params,
) -> FloatArray:
    """(n, 15) true error state; position is left zero, for it has no origin of its own."""
    n = len(outputs)
    # The filter starts with zero yaw: turn the truth about the vertical to agree with that.
    first = matrix(from_gravity(rotation[0].T @ np.array([0.0, 0.0, 1.0])))
    turn = first @ rotation[0].T
    e = np.zeros((n, 15))
    b_a = leader.accel_bias_mps2[-n:] @ params.rotation_leader.T
    b_g = leader.gyro_bias_radps[-n:] @ params.rotation_leader.T
    estimated = np.moveaxis(matrix(np.array([o.q for o in outputs]).T), -1, 0)
    d = (turn @ rotation) @ np.swapaxes(estimated, 1, 2)
    e[:, 3:6] = velocity @ turn.T - np.array([o.v for o in outputs])
    e[:, 6:9] = 0.5 * np.stack(
        [d[:, 2, 1] - d[:, 1, 2], d[:, 0, 2] - d[:, 2, 0], d[:, 1, 0] - d[:, 0, 1]], axis=1
    )
    e[:, 9:12] = b_a - np.array([o.b_a for o in outputs])
    e[:, 12:15] = b_g - np.array([o.b_g for o in outputs])
    return e


NEES_STATES = (3, 4, 5, 6, 7)
"""Velocity and tilt: what the estimator is for. Yaw and position have no reference."""

NEES_BAND = (0.831, 12.833)
"""2.5 % and 97.5 % points of chi-square with five degrees of freedom.

A chip's biases are drawn once per set and make most of its errors, so the samples of one set are
nearly one draw: the mean over a set is held against the band of a single draw, not against the
much narrower one of independent samples.
"""


def _nees(errors: FloatArray, P: FloatArray) -> FloatArray:
    index = np.array(NEES_STATES)
    e = errors[:, index]
    S = P[:, index[:, None], index]
    value: FloatArray = np.einsum("ni,ni->n", e, np.linalg.solve(S, e[:, :, None])[:, :, 0])
    return value


class Scored(Protocol):
    """What :func:`summarise` wants to know of a set."""

    @property
    def pairs(self) -> Sequence[tuple[Concentric, Concentric]]: ...
    @property
    def missed(self) -> Sequence[Concentric]: ...
    @property
    def invented(self) -> Sequence[Concentric]: ...
    @property
    def false_zupt(self) -> int: ...
    @property
    def nees_mean(self) -> float: ...
    @property
    def nees_above(self) -> float: ...


@dataclass(frozen=True)
class Summary:
    """Figures over many sets; velocities in m/s."""

    sets: int
    reps: int
    missed: int
    invented: int
    mean_rmse: float
    mean_bias: float
    peak_rmse: float
    peak_bias: float
    peak_time_rmse_s: float
    travel_rmse_m: float
    mean_p95: float
    peak_p95: float
    false_zupt: int
    nees_mean: float
    nees_inside: float
    """Share of sets whose mean NEES lies in :data:`NEES_BAND`."""
    nees_above: float
    """Share of samples above it: where the filter is surer than it may be."""


def summarise(runs: Sequence[Scored]) -> Summary:
    """Root mean square, bias and 95th percentile over every repetition of every run."""
    pairs = [pair for r in runs for pair in r.pairs]
    mean = np.array([b.mean_mps - a.mean_mps for a, b in pairs])
    peak = np.array([b.peak_mps - a.peak_mps for a, b in pairs])
    when = np.array([b.t_peak_s - a.t_peak_s for a, b in pairs])
    travel = np.array([b.travel_m - a.travel_m for a, b in pairs])

    def rms(x: FloatArray) -> float:
        return float(np.sqrt(np.mean(x * x)))

    return Summary(
        len(runs),
        len(pairs),
        sum(len(r.missed) for r in runs),
        sum(len(r.invented) for r in runs),
        rms(mean),
        float(mean.mean()),
        rms(peak),
        float(peak.mean()),
        rms(when),
        rms(travel),
        float(np.percentile(np.abs(mean), 95)),
        float(np.percentile(np.abs(peak), 95)),
        sum(r.false_zupt for r in runs),
        float(np.mean([r.nees_mean for r in runs])),
        float(np.mean([NEES_BAND[0] <= r.nees_mean <= NEES_BAND[1] for r in runs])),
        float(np.mean([r.nees_above for r in runs])),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line of figures for sets with rests and one for touch and go."""
    parser = argparse.ArgumentParser(prog="python -m hil.reference.study", description=__doc__)
    parser.add_argument("--sets", type=int, default=20, help="sets of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--one-imu", action="store_true", help="without the follower")
    options = parser.parse_args(argv)
    for rests in (True, False):
        runs = [
            run_set(seeded_set(seed, rests), seed, two=not options.one_imu)
            for seed in range(options.first, options.first + options.sets)
        ]
        s = summarise(runs)
        print(
            f"{'with rests' if rests else 'touch and go':12}  sets {s.sets}  reps {s.reps}  "
            f"missed {s.missed}  invented {s.invented}  "
            f"mean RMSE {1e3 * s.mean_rmse:.1f} mm/s (bias {1e3 * s.mean_bias:+.1f}, "
            f"p95 {1e3 * s.mean_p95:.1f})  "
            f"peak RMSE {1e3 * s.peak_rmse:.1f} mm/s (bias {1e3 * s.peak_bias:+.1f}, "
            f"p95 {1e3 * s.peak_p95:.1f})  "
            f"peak time {1e3 * s.peak_time_rmse_s:.1f} ms  "
            f"travel {1e3 * s.travel_rmse_m:.1f} mm  "
            f"false ZUPT {s.false_zupt}  NEES {s.nees_mean:.2f} of {len(NEES_STATES)}  "
            f"sets in its band {100 * s.nees_inside:.0f} %  "
            f"samples above {100 * s.nees_above:.1f} %"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
