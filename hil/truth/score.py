# SPDX-License-Identifier: Apache-2.0
"""Errors of the estimate against an aligned reference, and what they justify to change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.motion.repetitions import Concentric, concentrics, match
from hil.reps import Trace, repetitions
from hil.truth.align import GAP_S, Alignment, align, estimate_at, pieces
from hil.truth.reference import Reference, ReferenceError

Float = NDArray[np.float64]

INDEPENDENT_S: Final = 0.5
"""Errors of the estimate closer together than this say the same: they are integrals."""
SIGNIFICANT: Final = 5.0
"""Standard deviations at which an effect is real enough to change a parameter for it."""
SHARE_MIN: Final = 0.10
"""Share of the error's variance that a change must take away to be worth it."""
GAIN_MIN: Final = 0.01
MOVES_MPS: Final = 0.05
MOVES_S: Final = 0.1
RIVAL_SHARE: Final = 0.95


@dataclass(frozen=True, eq=False)
class Comparison:
    """The estimate less the reference, in m/s, where both are known.

    Attributes:
        t_s: float64[n], on the leader's clock.
        estimate_mps: float64[n], vertical velocity over the same spans as the reference's.
        error_mps: float64[n], of the vertical velocity; the reference has its sign turned if it
            counts downwards, and nothing else done to it.
        pairs: (reference, estimate) concentric phases of each repetition; ``missed`` are the
            reference's without a partner, ``invented`` the estimate's.
        suggestions: sentences, each with the figures that justify it; empty when none is.
    """

    alignment: Alignment
    t_s: Float
    estimate_mps: Float
    error_mps: Float
    pairs: Sequence[tuple[Concentric, Concentric]]
    missed: Sequence[Concentric]
    invented: Sequence[Concentric]
    suggestions: Sequence[str]

    @property
    def rmse_mps(self) -> float:
        return float(np.sqrt(np.mean(self.error_mps**2)))

    @property
    def bias_mps(self) -> float:
        return float(np.mean(self.error_mps))

    @property
    def p95_mps(self) -> float:
        """95th percentile of the error's amount."""
        return float(np.percentile(np.abs(self.error_mps), 95))


def compare(traces: Sequence[Trace], reference: Reference) -> Comparison:
    """The reference against the longest trace.

    Raises:
        ReferenceError: it cannot be aligned.
    """
    if not traces:
        raise ReferenceError("the recording has no estimate", "look at it with: hil replay")
    trace = max(traces, key=lambda one: one.t_s[-1] - one.t_s[0])
    a = align(trace, reference)
    found = pieces(reference)
    estimate, inside = estimate_at(trace, found, a)
    theirs = a.sign * found.velocity_mps
    t_s = a.leader_s(found.t_s)
    error = (estimate - theirs)[inside]
    t_in = t_s[inside]
    ours = [
        phase
        for r in repetitions(trace).repetitions
        for phase in r.phases
        if t_in[0] <= phase.t_start_s and phase.t_end_s <= t_in[-1]
    ]
    pairs, missed, invented = match(_phases(t_in, theirs[inside]), ours)
    # A phase of the estimate in a gap of the reference was seen by one only.
    invented = [p for p in invented if not _in_gap(t_in, p)]
    # The reference's smaller rises (racking, catches) are no repetitions of the estimate either.
    least = 0.6 * min((a.travel_m for a, _ in pairs), default=0.0)
    missed = [p for p in missed if p.travel_m >= least]
    suggestions = _suggestions(trace, a, t_in, theirs[inside], error)
    return Comparison(a, t_in, estimate[inside], error, pairs, missed, invented, suggestions)


def _phases(t_s: Float, v: Float) -> list[Concentric]:
    """Concentric phases of the reference, none across a gap.

    Smoothed over three samples or 25 ms, for noise crosses the threshold back and forth.
    """
    found: list[Concentric] = []
    cuts = np.flatnonzero(np.diff(t_s) > GAP_S) + 1
    for t, x in zip(np.split(t_s, cuts), np.split(v, cuts), strict=True):
        if len(t) < 5:
            continue
        width = max(3, round(0.025 / float(np.median(np.diff(t)))) | 1)
        kernel = np.full(width, 1.0 / width)
        ends = np.pad(x, width // 2, mode="edge")
        found += concentrics(t, np.convolve(ends, kernel, "valid"))
    return found


def _in_gap(t_s: Float, phase: Concentric) -> bool:
    inside = t_s[(t_s >= phase.t_start_s) & (t_s <= phase.t_end_s)]
    edges = np.concatenate([[phase.t_start_s], inside, [phase.t_end_s]])
    return bool(np.diff(edges).max() > GAP_S)


def _suggestions(trace: Trace, a: Alignment, t_s: Float, theirs: Float, error: Float) -> list[str]:
    found = []
    if a.rival > RIVAL_SHARE * a.correlation:
        found.append(
            f"another shift fits nearly as well (correlation {a.rival:.3f} against "
            f"{a.correlation:.3f}): the alignment may be off by a repetition; give a reference "
            "that begins before the set"
        )
    if abs(a.gain - 1.0) > max(GAIN_MIN, SIGNIFICANT * a.gain_sigma):
        found.append(
            f"the reference reads {a.gain:.3f} ± {a.gain_sigma:.3f} times the estimate: calibrate "
            "the reference's scale, or the accelerometers: hil calibrate"
        )
    found += _lever(trace, t_s, error)
    found += _false_zupt(trace, t_s, theirs)
    return found


def _lever(trace: Trace, t_s: Float, error: Float) -> list[str]:
    """A wrong x of the lever arm shows as an error in proportion to the rate of tilt.

    The centre's velocity is v - R (w x r); its vertical part changes with r_x by minus the rate at
    which the bar's axis turns upwards, times its cosine (docs/estimator.md, section 7.3).
    """
    rise = np.gradient(np.sin(trace.tilt_rad), trace.t_s)
    rate = np.interp(t_s, trace.t_s, rise)
    rate, rest = rate - rate.mean(), error - error.mean()
    power, variance = float(rate @ rate), float(rest @ rest)
    if power <= 0.0 or variance <= 0.0:
        return []
    slope = float(rate @ rest) / power
    share = slope * slope * power / variance
    independent = max(float(t_s[-1] - t_s[0]) / INDEPENDENT_S, 3.0)
    strength = math.sqrt(share * (independent - 2.0) / max(1.0 - share, 1e-9))
    if share < SHARE_MIN or strength < SIGNIFICANT:
        return []
    return [
        f"{100.0 * share:.0f} % of the error goes with the bar's rate of tilt, as it would were "
        f"the leader {1e3 * slope:+.0f} mm further out along the bar than lever_leader_m says "
        f"({strength:.0f} standard deviations): measure where it sits"
    ]


def _false_zupt(trace: Trace, t_s: Float, theirs: Float) -> list[str]:
    """Zero-velocity updates while the reference moves for longer than noise would."""
    at = np.minimum(np.searchsorted(trace.t_s, t_s), len(trace.t_s) - 1)
    still = trace.zupt[at]
    if not still.any():
        return []
    # What the reference says at rest is its own constant error.
    wrong = still & (np.abs(theirs - np.median(theirs[still])) > MOVES_MPS)
    padded = np.concatenate([[False], wrong, [False]])
    turns = np.flatnonzero(padded[1:] != padded[:-1])
    longest = max(
        (float(t_s[b - 1] - t_s[a]) for a, b in zip(turns[::2], turns[1::2], strict=True)),
        default=0.0,
    )
    if longest < MOVES_S:
        return []
    return [
        f"zero-velocity updates while the reference moved faster than {MOVES_MPS:g} m/s, for up to "
        f"{longest:.2f} s: the detector's thresholds are too wide: hil tune zupt"
    ]
