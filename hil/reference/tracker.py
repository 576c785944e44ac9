# SPDX-License-Identifier: Apache-2.0
"""The interface that every tracker here shares: samples of a sensor in, an estimate out.

docs/estimators.md has the equations of each. A tracker is at a sensor, not at a bar: what it says
holds for the sensor that it was fed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from hil.reference.attitude import FloatArray, from_gravity
from hil.reference.estimator import Estimator, Flag, Sample
from hil.reference.params import Params


@dataclass(frozen=True)
class Estimate:
    """What a tracker says after one sample.

    Attributes:
        t_s: time that it refers to.
        q: (4,) attitude, sensor to world, z up; yaw is zero where the tracker began.
        v, p: (3,) velocity, m/s, and position, m, of the sensor in that world.
        still: the tracker takes the sensor to be at rest and holds its velocity at zero.
    """

    t_s: float
    q: FloatArray
    v: FloatArray
    p: FloatArray
    still: bool


class Tracker(Protocol):
    """One sample at a time, in order of time.

    ``None`` while it aligns. The second sensor's samples, those that have arrived since the step
    before, are for those trackers that know what to do with them.
    """

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None: ...


@dataclass
class Alignment:
    """Means over the first ``span_s``: how each one-sensor tracker here begins, lying still."""

    span_s: float = 0.5
    count: int = 0
    t_first_s: float = 0.0
    accel: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro: FloatArray = field(default_factory=lambda: np.zeros(3))

    def done(self, sample: Sample) -> bool:
        """Take a sample in; True once the span is over."""
        if self.count == 0:
            self.t_first_s = sample.t_s
        self.count += 1
        self.accel = self.accel + (sample.accel_mps2 - self.accel) / self.count
        self.gyro = self.gyro + (sample.gyro_radps - self.gyro) / self.count
        return sample.t_s - self.t_first_s >= self.span_s

    @property
    def q(self) -> FloatArray:
        """Level by the mean force, yaw zero."""
        return from_gravity(self.accel)


class Slower:
    """A tracker whose counts are of samples, at a rate that they were meant for: fed block means.

    There is an estimate on the last sample of each block only, for the middle of the block.
    """

    def __init__(self, tracker: Tracker, block: int) -> None:
        self.tracker, self.block = tracker, block
        self.waiting: list[Sample] = []

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None:
        self.waiting.append(sample)
        if len(self.waiting) < self.block:
            return None
        rows, self.waiting = self.waiting, []
        mean = Sample(
            sum(row.t_s for row in rows) / len(rows),
            np.mean([row.accel_mps2 for row in rows], axis=0),
            np.mean([row.gyro_radps for row in rows], axis=0),
            any(row.clipped for row in rows),
        )
        return self.tracker.step(mean)


class OwnReference:
    """The reference of this project's own estimator, under the shared interface."""

    def __init__(self, params: Params | None = None) -> None:
        self.estimator = Estimator(params or Params())

    def step(self, sample: Sample, others: Sequence[Sample] = ()) -> Estimate | None:
        out = self.estimator.step(sample, others)
        if out is None:
            return None
        return Estimate(out.t_s, out.q, out.v, out.p, bool(out.flags & Flag.ZUPT))
