# SPDX-License-Identifier: Apache-2.0
"""Repetitions from the concentric phases of a trace.

:func:`hil.motion.repetitions.concentrics` says what a concentric phase is. Here they become
repetitions:

* Phases that climb on from half way (a clean, its front squat and its jerk) are one repetition:
  the next phase begins more than ``CLIMB_SHARE`` of the lift's height above its low, and ends more
  than ``CLIMB_M`` above its top. A repetition that went down only half way ends at the same top.
  The bar dips by ``DIP_M`` at least once on the way; going up to its hooks it does not.
* The set's range is the upper quartile of the ranges. What has less than ``partial_share`` of it is
  partial if the bar was lowered for it, and else no repetition at all: that is how a bar
  leaves its rack and comes back into it. A bar picked up from the floor and racked at the set's
  full range cannot be told from a repetition.
* The bar is lowered before it is lifted, except in sets that begin on the floor; of those, the
  eccentric phase is the one after the lift.

Heights are those at the end of a phase: the estimator corrects the height some 50 ms after a
turning point, and what lies before that has the drift of the way down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.motion.repetitions import Concentric, concentrics
from hil.reps.trace import Trace

Float = NDArray[np.float64]
Kind = Literal["full", "partial"]
Start = Literal["touch-and-go", "paused", "from rest"]

PARTIAL_SHARE: Final = 0.6
TRAVEL_MIN_M: Final = 0.10
"""Shorter rises are sway, bounces and steps: 70 mm is a hard bounce of plates."""
PEAK_MIN_MPS: Final = 0.15
ON_MPS: Final = 0.05
CLIMB_SHARE: Final = 0.35
CLIMB_M: Final = 0.10
DIP_M: Final = 0.08
LOWERED_SHARE: Final = 0.5
"""A descent of this share of the rise that follows it is that rise's eccentric phase."""
PAUSE_S: Final = 0.3
"""From bar lowered to bar rising: competition benches and pin squats take longer, bounces less."""
JOIN_S: Final = 0.3
"""Descents no further apart are one: hands hesitate, plates touch softly."""


@dataclass(frozen=True)
class Figures:
    """What is reported of one repetition; times in s, all of the bar's centre.

    Attributes:
        mean_mps, peak_mps: concentric velocity; of several phases, of the fastest.
        time_to_peak_s: from the beginning of that phase to its peak.
        eccentric_s: how long the bar was lowered; NaN if it was not.
        pause_s: from lowered to rising; NaN without an eccentric phase before the lift.
        range_m: from the lowest to the highest point of the lift.
        tilt_deg: largest angle between bar and horizontal, by amount, with the sign that it had.
    """

    mean_mps: float
    peak_mps: float
    time_to_peak_s: float
    eccentric_s: float
    pause_s: float
    range_m: float
    tilt_deg: float


@dataclass(frozen=True)
class Repetition:
    """One repetition: ``phases`` are its concentric phases, one or more."""

    kind: Kind
    start: Start
    phases: tuple[Concentric, ...]
    figures: Figures

    @property
    def t_start_s(self) -> float:
        return self.phases[0].t_start_s

    @property
    def t_end_s(self) -> float:
        return self.phases[-1].t_end_s


@dataclass(frozen=True)
class RepetitionSet:
    """All repetitions of one trace, in order of time; rises that were none are in ``racking``."""

    repetitions: tuple[Repetition, ...]
    racking: tuple[Concentric, ...]

    @property
    def full(self) -> list[Repetition]:
        return [r for r in self.repetitions if r.kind == "full"]

    @property
    def partial(self) -> list[Repetition]:
        return [r for r in self.repetitions if r.kind == "partial"]

    @property
    def velocity_loss_percent(self) -> float:
        """From the fastest to the last full repetition, by mean velocity; NaN below two."""
        means = [r.figures.mean_mps for r in self.full]
        return 100.0 * (1.0 - means[-1] / max(means)) if len(means) > 1 else float("nan")


@dataclass(frozen=True)
class _Descent:
    t_start_s: float
    t_end_s: float
    travel_m: float


@dataclass(frozen=True)
class _Lift:
    """Concentric phases that belong together, and heights on the trace's scale."""

    phases: tuple[Concentric, ...]
    low_m: float
    top_m: float

    @property
    def range_m(self) -> float:
        return self.top_m - self.low_m


def repetitions(trace: Trace, partial_share: float = PARTIAL_SHARE) -> RepetitionSet:
    """The repetitions of one trace.

    Args:
        partial_share: below this share of the set's range a repetition is partial.

    Raises:
        ValueError: ``partial_share`` is not between 0 and 1.
    """
    if not 0.0 < partial_share < 1.0:
        raise ValueError(f"partial_share {partial_share} is not between 0 and 1")
    t, v = trace.t_s, trace.velocity_z_mps
    descents = _descents(t, v)
    lifts = _joined(trace, concentrics(t, v, ON_MPS, TRAVEL_MIN_M, PEAK_MIN_MPS), descents)
    if not lifts:
        return RepetitionSet((), ())
    set_range_m = float(np.quantile([lift.range_m for lift in lifts], 0.75))
    before = [
        _longest(descents, a.phases[-1].t_end_s if a else t[0], b.phases[0].t_start_s)
        for a, b in zip([None, *lifts[:-1]], lifts, strict=True)
    ]
    found: list[tuple[Kind, int]] = []
    racking: list[Concentric] = []
    for k, lift in enumerate(lifts):
        down = before[k]
        if lift.range_m >= partial_share * set_range_m:
            found.append(("full", k))
        elif down and down.travel_m >= LOWERED_SHARE * lift.range_m:
            found.append(("partial", k))
        else:
            racking += lift.phases
    first = next((k for kind, k in found if kind == "full"), 0)
    down = before[first]
    from_floor = down is None or down.travel_m < LOWERED_SHARE * lifts[first].range_m
    result = []
    for kind, k in found:
        lift, own = lifts[k], before[k]
        end_s = lifts[k + 1].phases[0].t_start_s if k + 1 < len(lifts) else float(t[-1])
        if own and own.travel_m < LOWERED_SHARE * lift.range_m:
            own = None
        after = _longest(descents, lift.phases[-1].t_end_s, end_s)
        result.append(_repetition(trace, kind, lift, own, after if from_floor else own))
    return RepetitionSet(tuple(result), tuple(racking))


def _joined(
    trace: Trace, phases: Sequence[Concentric], descents: Sequence[_Descent]
) -> list[_Lift]:
    ends = np.searchsorted(trace.t_s, [p.t_end_s for p in phases])
    lifts: list[_Lift] = []
    for phase, end in zip(phases, np.minimum(ends, len(trace.t_s) - 1).tolist(), strict=True):
        top = float(trace.height_m[end])
        low = top - phase.travel_m
        last = lifts[-1] if lifts else None
        if last and _climbs(last, low, top, descents, phase.t_start_s):
            lifts[-1] = _Lift((*last.phases, phase), last.low_m, top)
        else:
            lifts.append(_Lift((phase,), low, top))
    return lifts


def _climbs(
    last: _Lift, low_m: float, top_m: float, descents: Sequence[_Descent], until_s: float
) -> bool:
    higher = low_m > last.low_m + CLIMB_SHARE * last.range_m and top_m > last.top_m + CLIMB_M
    dip = _longest(descents, last.phases[-1].t_end_s, until_s)
    return higher and (len(last.phases) > 1 or (dip is not None and dip.travel_m >= DIP_M))


def _descents(t: Float, v: Float) -> list[_Descent]:
    """Spans in which the bar goes down; those less than ``JOIN_S`` apart are one."""
    down = np.concatenate([[False], v < -ON_MPS, [False]])
    begins, ends = (np.flatnonzero(down[1:] != down[:-1])[k::2] for k in (0, 1))
    height = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    found: list[_Descent] = []
    for a, b in zip(begins.tolist(), (ends - 1).tolist(), strict=True):
        one = _Descent(float(t[a]), float(t[b]), float(height[a] - height[b]))
        last = found[-1] if found else None
        # A rise in between, however short, parts the descents of two lifts.
        if last and one.t_start_s - last.t_end_s < JOIN_S and not _rises(t, v, last, one):
            one = _Descent(last.t_start_s, one.t_end_s, last.travel_m + one.travel_m)
            found.pop()
        found.append(one)
    return found


def _rises(t: Float, v: Float, a: _Descent, b: _Descent) -> bool:
    between = slice(*np.searchsorted(t, [a.t_end_s, b.t_start_s]))
    return bool(np.any(v[between] > ON_MPS))


def _longest(descents: Sequence[_Descent], after_s: float, until_s: float) -> _Descent | None:
    # Half a step of room: phases end by interpolation, descents on samples.
    inside = [d for d in descents if d.t_start_s >= after_s - 0.01 and d.t_end_s <= until_s + 0.01]
    return max(inside, key=lambda d: d.travel_m, default=None)


def _repetition(
    trace: Trace, kind: Kind, lift: _Lift, before: _Descent | None, eccentric: _Descent | None
) -> Repetition:
    main = max(lift.phases, key=lambda p: p.peak_mps)
    begin_s = lift.phases[0].t_start_s
    pause_s = begin_s - before.t_end_s if before else float("nan")
    spans = [begin_s, lift.phases[-1].t_end_s]
    if eccentric:
        spans += [eccentric.t_start_s, eccentric.t_end_s]
    inside = slice(*np.searchsorted(trace.t_s, [min(spans), max(spans)]))
    tilt = np.degrees(trace.tilt_rad[inside])
    start: Start = "from rest"
    if before:
        start = "paused" if pause_s >= PAUSE_S else "touch-and-go"
    return Repetition(
        kind,
        start,
        lift.phases,
        Figures(
            mean_mps=main.mean_mps,
            peak_mps=main.peak_mps,
            time_to_peak_s=main.t_peak_s - main.t_start_s,
            eccentric_s=eccentric.t_end_s - eccentric.t_start_s if eccentric else float("nan"),
            pause_s=pause_s,
            range_m=lift.range_m,
            tilt_deg=float(tilt[np.argmax(np.abs(tilt))]),
        ),
    )
