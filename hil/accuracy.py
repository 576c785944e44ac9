# SPDX-License-Identifier: Apache-2.0
"""Accuracy and consistency of the core over many seeded sets, in all processors at once.

``python -m hil.accuracy --sets 200`` prints the table of docs/estimator.md, section 9: one line
per lift and one for each of the two kinds of set. It ends with 1 where a limit is not kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hil.core import Estimator
from hil.motion.lifts import Lift, seeded_set
from hil.motion.repetitions import Concentric
from hil.parity import batch
from hil.process.pool import pool
from hil.reference.estimator import Flag, Output
from hil.reference.params import Params
from hil.reference.study import Link, Run, score, simulate, summarise


@dataclass(frozen=True)
class Score:
    """What one set contributes to the table; small, so that it travels between processes."""

    name: str
    rests: bool
    pairs: Sequence[tuple[Concentric, Concentric]]
    missed: Sequence[Concentric]
    invented: Sequence[Concentric]
    false_zupt: int
    nees_mean: float
    nees_above: float


@dataclass(frozen=True)
class Limits:
    """What a kind of set must keep to, over all its sets together; velocities in m/s."""

    mean_rmse: float
    peak_rmse: float
    nees_inside: float = 0.90
    nees_above: float = 0.025


LIMITS = {True: Limits(0.010, 0.015), False: Limits(0.020, 0.030)}
"""By ``rests``. No phase may be missed or invented, and no zero-velocity update be false.

Of NEES, a consistent filter has 95 % of sets in the band; 90 % leaves room for 20 sets, of which
one or two may lie outside. The share of samples above the band is that of a consistent filter.
"""


def faults(scores: Sequence[Score]) -> list[str]:
    """What does not keep to :data:`LIMITS`, one line each; empty when all does."""
    found = []
    for rests, limits in LIMITS.items():
        kind = [one for one in scores if one.rests == rests]
        if not kind:
            continue
        s, label = summarise(kind), "with rests" if rests else "touch and go"
        for name, limit in (("missed", 0), ("invented", 0), ("false_zupt", 0)):
            if getattr(s, name) > limit:
                found.append(f"{label}: {name} {getattr(s, name)}, limit {limit}")
        for name in ("mean_rmse", "peak_rmse"):
            value, limit_mps = getattr(s, name), getattr(limits, name)
            # Written so that a NaN does not pass.
            if not value <= limit_mps:
                found.append(f"{label}: {name} {1e3 * value:.1f} mm/s, limit {1e3 * limit_mps:.0f}")
        if not s.nees_inside >= limits.nees_inside:
            found.append(f"{label}: NEES in its band in {100 * s.nees_inside:.0f} % of the sets")
        if not s.nees_above <= limits.nees_above:
            found.append(f"{label}: NEES above its band in {100 * s.nees_above:.1f} % of samples")
    return found


def run_set(
    lift: Lift,
    seed: int,
    params: Params | None = None,
    *,
    link: Link | None = None,
    two: bool = True,
    dtype: Any = np.float64,
) -> Run:
    """:func:`hil.reference.study.run_set` with the core in the reference's place."""
    params = params or Params()
    leader, follower = simulate(lift, seed)
    samples = batch(leader, follower if two else None, link)
    result = Estimator(params, dtype).run(
        samples.leader, samples.follower, samples.arrival, covariances=True
    )
    rows = {name: result.outputs[name] for name in result.outputs.dtype.names or ()}
    outputs = [
        Output(
            t_s=float(t_s),
            flags=Flag(int(rows["flags"][k])),
            **{
                name: column[k]
                for name, column in rows.items()
                if name not in ("t_ticks", "step", "flags")
            },
        )
        for k, t_s in enumerate(result.t_s)
    ]
    return score(lift, leader, params, outputs, result.covariances.astype(np.float64))


def score_seed(seed: int, *, rests: bool, two: bool = True, dtype: Any = np.float64) -> Score:
    """The ``seed``-th set of the study."""
    lift = seeded_set(seed, rests)
    run = run_set(lift, seed, two=two, dtype=dtype)
    return Score(
        lift.name,
        rests,
        run.pairs,
        run.missed,
        run.invented,
        run.false_zupt,
        run.nees_mean,
        run.nees_above,
    )


def table(scores: Sequence[Score]) -> str:
    """Markdown, one line per lift and one per kind of set."""
    lines = [
        "| sets | phases | missed | invented | mean velocity RMSE | peak velocity RMSE "
        "| false ZUPT steps | NEES (5) | sets in band | samples above |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for rests in (False, True):
        kind = [s for s in scores if s.rests == rests]
        groups = {
            name: [s for s in kind if s.name == name] for name in sorted({s.name for s in kind})
        }
        label = "with rests" if rests else "touch and go"
        for name, members in (*groups.items(), (f"**{label}**", kind)):
            s = summarise(members)
            lines.append(
                f"| {s.sets} {name.replace('_', ' ')} | {s.reps} | {s.missed} | {s.invented} "
                f"| {1e3 * s.mean_rmse:.1f} mm/s | {1e3 * s.peak_rmse:.1f} mm/s "
                f"| {s.false_zupt} | {s.nees_mean:.1f} | {100 * s.nees_inside:.0f} % "
                f"| {100 * s.nees_above:.1f} % |"
            )
    return "\n".join(lines)


def study(
    seeds: range, *, two: bool = True, dtype: Any = np.float64, jobs: int | None = None
) -> list[Score]:
    """Scores of both kinds of set for each of ``seeds``."""
    with pool(jobs) as workers:
        return [
            one
            for rests in (False, True)
            for one in workers.map(
                partial(score_seed, rests=rests, two=two, dtype=dtype), seeds, chunksize=4
            )
        ]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m hil.accuracy", description=__doc__)
    parser.add_argument("--sets", type=int, default=40, help="sets of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--one-imu", action="store_true", help="without the follower")
    parser.add_argument("--float", action="store_true", help="in the firmware's own arithmetic")
    parser.add_argument("--jobs", type=int, help="processes; all processors if left out")
    options = parser.parse_args(argv)
    scores = study(
        range(options.first, options.first + options.sets),
        two=not options.one_imu,
        dtype=np.float32 if options.float else np.float64,
        jobs=options.jobs,
    )
    print(table(scores))
    wrong = faults(scores)
    for line in wrong:
        print(line)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
