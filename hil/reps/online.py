# SPDX-License-Identifier: Apache-2.0
"""The firmware's detector (:mod:`hil.core.reps`) against the definition (:mod:`hil.reps.find`).

The definition looks at a whole set, the detector at what has come so far; the last report of each
number is what both must agree on. docs/repetitions.md says what may differ until then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.core.reps import STILL, Detector, Reports
from hil.reps.find import Repetition, RepetitionSet
from hil.reps.trace import Trace
from hil.wire.messages import REP_FLAGS, REP_KINDS, TICK_RATE_HZ

SAME_S: Final = 0.01
"""Repetitions that begin no further apart are the same one."""
UNSAID_S: Final = 0.5
"""What ends so late in a stream is not reported yet: see ``REST_S`` in reps.cpp."""
FIGURES: Final = ("mean_mps", "peak_mps", "time_to_peak_s", "eccentric_s", "pause_s", "range_m")


def detected(trace: Trace) -> Reports:
    """What the detector says of a trace, its end included."""
    detector = Detector()
    t_ticks = np.rint(trace.t_s * TICK_RATE_HZ).astype(np.int64)
    said = detector.push(
        t_ticks, trace.velocity_z_mps, trace.height_m, trace.tilt_rad, STILL * trace.zupt
    )
    late = detector.end()
    return Reports(
        np.concatenate([said.frames, late.frames]), np.concatenate([said.sample, late.sample])
    )


def latest(frames: NDArray[Any]) -> NDArray[Any]:
    """The last frame of each repetition, in order of time; without those taken back."""
    last = {(int(f["set"]), int(f["number"])): k for k, f in enumerate(frames)}
    kept: NDArray[Any] = frames[np.array(sorted(last.values()), np.int64)]
    kept = kept[kept["kind"] != REP_KINDS["none"]]
    return kept[np.argsort(kept["t_start_ticks_leader"], kind="stable")]


@dataclass(frozen=True, eq=False)
class Agreement:
    """Frames held against the definition.

    Attributes:
        pairs: frame and repetition that begin at the same time.
        only_said, only_found: frames without a repetition, and the other way round.
        differing: what is not the same in a pair, in words: kind, phases, start.
        velocity_error_mps: largest difference of a mean or peak velocity; NaN without a pair.
        figure_error: largest difference of each figure, in its unit.
    """

    pairs: list[tuple[Any, Repetition]]
    only_said: list[Any]
    only_found: list[Repetition]
    differing: list[str]
    figure_error: dict[str, float]

    @property
    def velocity_error_mps(self) -> float:
        return max(self.figure_error["mean_mps"], self.figure_error["peak_mps"])

    @property
    def wrong(self) -> int:
        """Repetitions that are not the same in both."""
        return len(self.only_said) + len(self.only_found) + len(self.differing)


def agreement(
    frames: NDArray[Any], found: Sequence[RepetitionSet], until_s: float = float("inf")
) -> Agreement:
    """The last frames of all repetitions against those of the definition.

    Args:
        until_s: repetitions that end later may be missing in the frames.
    """
    said = list(latest(frames))
    pairs: list[tuple[Any, Repetition]] = []
    only_found: list[Repetition] = []
    differing: list[str] = []
    error = dict.fromkeys(FIGURES, float("nan"))
    for r in (r for one in found for r in one.repetitions):
        near = [k for k, f in enumerate(said) if abs(_seconds(f, "t_start") - r.t_start_s) < SAME_S]
        if near:
            pairs.append((said.pop(near[0]), r))
        elif r.t_end_s <= until_s:
            only_found.append(r)
    for frame, r in pairs:
        differing += _differences(frame, r)
        for name in FIGURES:
            a, b = float(frame[name]), float(getattr(r.figures, name))
            error[name] = float(np.fmax(error[name], abs(a - b)))
    return Agreement(pairs, said, only_found, differing, error)


def _seconds(frame: Any, which: str) -> float:
    return float(frame[f"{which}_ticks_leader"]) / TICK_RATE_HZ


def _differences(frame: Any, r: Repetition) -> list[str]:
    flags = int(frame["flags"])
    start = "from rest"
    if flags & REP_FLAGS["lowered"]:
        start = "paused" if flags & REP_FLAGS["paused"] else "touch-and-go"
    known = [name for name in FIGURES if np.isfinite(getattr(r.figures, name))]
    pairs = {
        "kind": (REP_KINDS[r.kind], int(frame["kind"])),
        "phases": (len(r.phases), int(frame["phases"])),
        "start": (r.start, start),
        "known figures": (known, [name for name in FIGURES if np.isfinite(frame[name])]),
    }
    at = f"{r.t_start_s:.2f} s"
    return [f"{at}: {what} {a}, said {b}" for what, (a, b) in pairs.items() if a != b]
