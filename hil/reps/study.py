# SPDX-License-Identifier: Apache-2.0
"""Repetitions counted over many seeded sets: ``python -m hil.reps.study --sets 100``.

The sets are those of :mod:`hil.accuracy`; how many repetitions each has is what its lift was
asked for. Every set that is not counted right is listed, and the exit code is then 1. Sets of
which a pause was misread are listed too: in a slow eccentric the velocity may drift by more than
``hil.reps.find.ON_MPS`` before the turn corrects it, and the rest of the way down looks like one.
"""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from hil.core import Estimator
from hil.motion.lifts import LIFTS, TOUCH_AND_GO, WITH_RESTS, seeded_set
from hil.parity import batch
from hil.process.pool import pool
from hil.reference.params import Params
from hil.reference.study import simulate
from hil.reps.find import repetitions
from hil.reps.trace import of_outputs


@dataclass(frozen=True)
class Count:
    """One set: how many repetitions it has, and what was found.

    Attributes:
        bounced: of the full ones after the first, those found to be touch and go.
    """

    name: str
    seed: int
    rests: bool
    asked: int
    full: int
    partial: int
    bounced: int

    @property
    def right(self) -> bool:
        """Every repetition counted, none invented, none of them partial."""
        return (self.full, self.partial) == (self.asked, 0)

    @property
    def starts_right(self) -> bool:
        """All touch and go, or none: after a snatch the bar is on the floor as after any rest."""
        return self.bounced == (0 if self.rests else self.asked - 1)

    def __str__(self) -> str:
        return (
            f"{self.name}, seed {self.seed}, {'with rests' if self.rests else 'touch and go'}: "
            f"{self.asked} repetitions, found {self.full} full and {self.partial} partial, "
            f"{self.bounced} touch and go"
        )


def asked(seed: int, rests: bool) -> tuple[str, int]:
    """Name and number of repetitions of :func:`hil.motion.lifts.seeded_set`."""
    names = WITH_RESTS if rests else TOUCH_AND_GO
    name = names[seed % len(names)]
    if name == "touch_and_go_ten":
        return name, 10
    return name, int(inspect.signature(LIFTS[name]).parameters["reps"].default)


def count(seed: int, rests: bool) -> Count:
    """One set through the core, and its repetitions counted."""
    name, reps = asked(seed, rests)
    samples = batch(*simulate(seeded_set(seed, rests), seed))
    outputs = Estimator(Params()).run(samples.leader, samples.follower, samples.arrival).outputs
    found = [repetitions(trace) for trace in of_outputs(outputs)]
    return Count(
        name,
        seed,
        rests,
        reps,
        sum(len(one.full) for one in found),
        sum(len(one.partial) for one in found),
        sum(r.start == "touch-and-go" for one in found for r in one.full[1:]),
    )


def study(seeds: range, jobs: int | None = None) -> list[Count]:
    """Both kinds of set for each of ``seeds``."""
    with pool(jobs) as workers:
        return [
            one
            for rests in (False, True)
            for one in workers.map(partial(count, rests=rests), seeds, chunksize=4)
        ]


def main(argv: Sequence[str] | None = None) -> int:
    """Count, list what is wrong, and say how many sets were right."""
    parser = argparse.ArgumentParser(prog="python -m hil.reps.study", description=__doc__)
    parser.add_argument("--sets", type=int, default=100, help="sets of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, help="processes; all processors if left out")
    options = parser.parse_args(argv)
    counts = study(range(options.first, options.first + options.sets), options.jobs)
    for one in counts:
        if not (one.right and one.starts_right):
            print(one)
    right = sum(one.right for one in counts)
    print(
        f"{right} of {len(counts)} sets counted right, {sum(one.asked for one in counts)} "
        f"repetitions; pauses right in {sum(one.starts_right for one in counts)} sets"
    )
    return 0 if right == len(counts) else 1


if __name__ == "__main__":
    sys.exit(main())
