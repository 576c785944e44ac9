# SPDX-License-Identifier: Apache-2.0
"""The core over a recording with other parameters, beside the ones that the image had."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil import timesync
from hil.errors import RecordingError
from hil.fusion.inputs import runs
from hil.fusion.replay import host_steps
from hil.fusion.truth import Judged, judge
from hil.motion.repetitions import Concentric, match
from hil.recording import Recording
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.reps import of_outputs, repetitions
from hil.tuning.parameters import ParameterError, changed
from hil.wire.messages import TICK_RATE_HZ

Span = tuple[float, float]


@dataclass(frozen=True)
class Outcome:
    """What one choice of parameters makes of a recording; times in s on the leader's clock.

    Attributes:
        phases: the fastest concentric phase of each repetition, full or partial.
        zupt_spans_s: first and last step of each uninterrupted run of zero-velocity updates.
        judged: the last start against the truth; None where it is not known.
    """

    params: Params
    phases: Sequence[Concentric]
    zupt_spans_s: Sequence[Span]
    judged: Judged | None

    @property
    def zupt_s(self) -> float:
        """Time in zero-velocity updates."""
        return sum(b - a for a, b in self.zupt_spans_s)

    @property
    def errors_mps(self) -> tuple[float, float]:
        """RMSE of mean and of peak velocity over the phases of which the truth is known."""
        pairs = self.judged.pairs if self.judged else ()
        if not pairs:
            return math.nan, math.nan
        mean = [b.mean_mps - a.mean_mps for a, b in pairs]
        peak = [b.peak_mps - a.peak_mps for a, b in pairs]
        return float(np.sqrt(np.mean(np.square(mean)))), float(np.sqrt(np.mean(np.square(peak))))


@dataclass(frozen=True)
class Rerun:
    """``default`` has the parameters of the image, ``other`` the changed ones."""

    default: Outcome
    other: Outcome

    def paired(self) -> list[tuple[Concentric | None, Concentric | None]]:
        """Phases of both in order of time; None where only one has it."""
        pairs, gone, new = match(list(self.default.phases), list(self.other.phases))
        rows: list[tuple[Concentric | None, Concentric | None]] = [
            *pairs,
            *((one, None) for one in gone),
            *((None, one) for one in new),
        ]
        return sorted(rows, key=lambda row: next(p.t_start_s for p in row if p))


def rerun(recording: Recording, settings: Sequence[str]) -> Rerun:
    """The core in the firmware's own arithmetic, with the image's parameters and with changed ones.

    Args:
        settings: NAME=VALUE each (:func:`hil.tuning.parameters.changed`).

    Raises:
        ParameterError: a setting is wrong, or the core refuses the parameters.
        RecordingError: the recording has no batches of the leader's IMU.
    """
    found = runs(recording)
    if not found:
        raise RecordingError(
            "no IMU batch in the leader's stream: there is nothing to run the estimator over",
            "record with an image that has the estimator: hil build",
        )
    other = [replace(run, params=changed(run.params, settings)) for run in found]
    try:
        return Rerun(
            *(
                _outcome(recording, [host_steps(run) for run in each], each[-1].params)
                for each in (found, other)
            )
        )
    except ValueError as error:
        raise ParameterError(
            f"the estimator refuses these parameters or samples: {error}",
            "give other values, or look at the recording with: hil replay",
        ) from error


def _outcome(recording: Recording, outputs: Sequence[NDArray[np.void]], params: Params) -> Outcome:
    sets = [repetitions(trace) for one in outputs for trace in of_outputs(one)]
    return Outcome(
        params,
        [max(r.phases, key=lambda p: p.peak_mps) for one in sets for r in one.repetitions],
        [span for one in outputs for span in zupt_spans_s(one)],
        judge(recording, timesync.analyse(recording), as_frames(outputs[-1])),
    )


def zupt_spans_s(outputs: NDArray[np.void]) -> list[Span]:
    """First and last time of each run of steps with an accepted zero-velocity update."""
    on = (outputs["flags"] & int(Flag.ZUPT)) != 0
    padded = np.concatenate([[False], on, [False]])
    turns = np.flatnonzero(padded[1:] != padded[:-1])
    t_s = outputs["t_ticks"] / TICK_RATE_HZ
    return [
        (float(t_s[a]), float(t_s[b - 1]))
        for a, b in zip(turns[::2].tolist(), turns[1::2].tolist(), strict=True)
    ]


def as_frames(outputs: NDArray[np.void]) -> NDArray[Any]:
    """The core's outputs under the names of EKF frames, as far as the truth is held to them."""
    names = {
        "t_ticks_leader": "t_ticks",
        "flags": "flags",
        "centre_velocity_mps": "centre_velocity_mps",
        "quaternion": "q",
    }
    rows = np.zeros(
        len(outputs),
        [(name, outputs.dtype[own].base, outputs.dtype[own].shape) for name, own in names.items()],
    )
    for name, own in names.items():
        rows[name] = outputs[own]
    return rows
