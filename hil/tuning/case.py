# SPDX-License-Identifier: Apache-2.0
"""What a tuner runs the estimator on: one start's inputs and what is true of it, as plain arrays.

A case holds all that its evaluation needs, so it can be sent to a machine that has no recordings.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil import timesync
from hil.core import TICKS_PER_S, Samples
from hil.errors import RecordingError
from hil.fusion.inputs import Run, runs
from hil.fusion.truth import lift_of
from hil.motion.lifts import Lift, seeded_set
from hil.parity import batch
from hil.recording import load
from hil.reference.params import Params
from hil.reference.study import simulate
from hil.timesync.truth import NodeClock

Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Known:
    """The motion that a simulated bar followed.

    Attributes:
        start_s: when the lift began in true time.
        rests: the bar is put down between the repetitions.
        clock: the leader's; None where its ticks are true time.
    """

    lift: Lift
    start_s: float
    rests: bool
    clock: NodeClock | None

    def t_s(self, t_ticks: NDArray[np.int64]) -> Float:
        """float64[n], time since the lift began."""
        if self.clock is None:
            return t_ticks / TICKS_PER_S - self.start_s
        return self.clock.true_ns(t_ticks.astype(np.float64)) / 1e9 - self.start_s


@dataclass(frozen=True, eq=False)
class Case:
    """One start of the estimator; ``known`` is None where the truth is not known."""

    name: str
    run: Run
    known: Known | None

    @cached_property
    def digest(self) -> str:
        """Hash of inputs, parameters and truth: copies of one recording have the same."""
        found = hashlib.sha256()
        for samples in (self.run.samples.leader, self.run.samples.follower):
            _add(found, samples)
        found.update(np.ascontiguousarray(self.run.samples.arrival, np.int64).tobytes())
        for field in fields(Params):
            found.update(repr(np.asarray(getattr(self.run.params, field.name)).tolist()).encode())
        if self.known is not None:
            said = (self.known.lift.name, self.known.lift.seed, self.known.start_s)
            found.update(repr((said, self.known.rests, self.known.clock)).encode())
            t = np.linspace(0.0, self.known.lift.duration_s, 1000)
            found.update(np.ascontiguousarray(self.known.lift.trajectory.z(t)[0]).tobytes())
        return found.hexdigest()


def _add(found: hashlib._Hash, samples: Samples) -> None:
    for column in samples.columns():
        found.update(column.tobytes())


def of_recording(file: Path) -> list[Case]:
    """Every start in a recording, with the truth where the recording knows it.

    Raises:
        RecordingError: no batches of the leader's IMU.
    """
    recording = load(file)
    found = runs(recording)
    if not found:
        raise nothing(file)
    name = file.parent.name
    known = None
    if (lift := lift_of(recording)) is not None and (truth := timesync.analyse(recording).truth):
        known = Known(*lift, truth.clocks["leader"])
    return [
        Case(f"{name}{f', start {k + 1}' if len(found) > 1 else ''}", run, known)
        for k, run in enumerate(found)
    ]


def nothing(file: Path) -> RecordingError:
    """What is said of a recording that no estimator can be run on."""
    return RecordingError(
        f"no IMU batch in the leader's stream of {file}: there is nothing to tune on",
        "record with an image that has the estimator: hil build",
    )


def of_seed(seed: int, rests: bool) -> Case:
    """The simulated set of the accuracy study with this seed."""
    lift = seeded_set(seed, rests)
    samples = batch(*simulate(lift, seed))
    name = f"{lift.name}, seed {seed}, {'with rests' if rests else 'touch and go'}"
    return Case(name, Run(samples, Params(), 0, 0), Known(lift, 0.0, rests, None))
