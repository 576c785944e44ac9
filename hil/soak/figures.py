# SPDX-License-Identifier: Apache-2.0
"""Statistics of a long recording over its hours, and their trends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError
from hil.recording import Recording
from hil.streams import ROLES, frames, seen_t_ns_bench
from hil.timesync import analyse
from hil.timesync.model import model_error
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]

SHORTEST_S: Final = 1800.0
PARTS: Final = 24
STUDENT_T: Final = 2.074
"""97.5 % quantile of Student's t with PARTS - 2 degrees of freedom."""
HOUR_S: Final = 3600.0
RIG_EVENT: Final = "rig"
"""Events of this kind hold ``rss_kib``: memory of the process that records."""
LOSSES: Final = {
    "link_stats": ("batches_lost", "tx_dropped"),
    "system": ("uart_dropped",),
}


@dataclass(frozen=True)
class Track:
    """One quantity over the run.

    Attributes:
        t_s, value: float64[n].
        rms: the root mean square is looked at, not the mean.
        allowed: change over the whole run that is no drift, in ``unit``.
        grows: only a growth is bad; None: any change.
    """

    name: str
    unit: str
    t_s: Float
    value: Float
    allowed: float
    rms: bool = False
    grows: bool | None = None

    def over(self, begin_s: float, end_s: float) -> float:
        """The statistic over a span; NaN where nothing is known."""
        inside = self.value[(self.t_s >= begin_s) & (self.t_s < end_s)]
        if not inside.size:
            return float("nan")
        return float(np.sqrt(np.mean(inside**2)) if self.rms else np.mean(inside))


@dataclass(frozen=True)
class Trend:
    """A line through the statistics of the run's parts.

    Attributes:
        change: over the whole run, by the line.
        half_width: of its 95 % confidence interval.
        drifts: the change is beyond what is allowed, and the interval excludes zero.
    """

    change: float
    half_width: float
    drifts: bool


@dataclass(frozen=True)
class Row:
    track: Track
    hours: tuple[float, ...]
    trend: Trend | None


@dataclass(frozen=True)
class Soak:
    """What a long run was like; ``losses``: counter -> how many in all."""

    duration_s: float
    rows: tuple[Row, ...]
    losses: dict[str, int]

    @property
    def sound(self) -> bool:
        return not any(self.losses.values()) and not any(
            row.trend is not None and row.trend.drifts for row in self.rows
        )


def figures(recording: Recording) -> Soak:
    """Everything about a long recording.

    Raises:
        HilError: it is shorter than :data:`SHORTEST_S`.
    """
    ends = [int(s.block_t_ns_bench[-1]) for s in recording.serial.values() if s.data.size]
    duration_s = max(ends, default=0) / 1e9
    if duration_s < SHORTEST_S:
        raise HilError(
            f"the recording lasts {duration_s:.0f} s; trends need {SHORTEST_S:.0f} s",
            "hil record fixtures/scenarios/soak.toml -o my-soak takes six hours of simulated time",
        )
    # What is left after the last whole hour is one more column only if it can say something.
    hours = np.arange(0.0, max(duration_s - SHORTEST_S / 2, 1.0), HOUR_S)
    rows = tuple(
        Row(
            track,
            tuple(track.over(begin, begin + HOUR_S) for begin in hours.tolist()),
            trend(track, duration_s),
        )
        for track in tracks(recording)
    )
    return Soak(duration_s, rows, losses(recording))


def trend(track: Track, duration_s: float) -> Trend | None:
    """The line through PARTS equal parts of the run; None where fewer are known.

    Neighbouring samples are not independent, so the line goes through means of parts that are long
    beside any of the run's own rhythms; ordinary least squares, Student's t for the interval.
    """
    edges = np.linspace(0.0, duration_s, PARTS + 1)
    value = np.array([track.over(a, b) for a, b in pairwise(edges.tolist())])
    if not np.isfinite(value).all():
        return None
    x = np.linspace(-0.5, 0.5, PARTS + 1)
    x = (x[:-1] + x[1:]) / 2
    change = float(x @ value / (x @ x))
    rest = value - value.mean() - change * x
    half_width = STUDENT_T * float(np.sqrt(rest @ rest / (PARTS - 2) / (x @ x)))
    bad = abs(change) if track.grows is None else change if track.grows else -change
    return Trend(change, half_width, bad > track.allowed and bad > half_width)


def tracks(recording: Recording) -> Iterator[Track]:
    """What is followed through the run."""
    sync = analyse(recording)
    if sync.truth and np.any(sync.models.locked):
        error = model_error(sync.models, sync.truth)
        t_s, error_ns = error.t_ticks_leader / TICK_RATE_HZ, error.offset_ns
        allowed_ns = 0.1 * float(np.sqrt(np.mean(error_ns**2)))
        yield Track("sync error, rms", "ns", t_s, error_ns, allowed_ns, rms=True)
        yield Track("sync error, mean", "ns", t_s, error_ns, allowed_ns)
    for role in ROLES:
        health = frames(recording, role, "system")
        at_s = seen_t_ns_bench(recording, role, health) / 1e9
        for field, name, allowed, grows in (
            ("stack_free_min_b", "stack left", 32.0, False),
            ("heap_used_b", "heap in use", 32.0, True),
        ):
            value = health[field].astype(np.float64)
            yield Track(f"{name}, {role}", "B", at_s, value, allowed, grows=grows)
    memory = [(e.t_ns_bench / 1e9, e.data["rss_kib"]) for e in recording.events if _is_rig(e.data)]
    if memory:
        at_s, kib = np.array(memory, dtype=np.float64).T
        yield Track("memory of the rig", "KiB", at_s, kib, 2048.0, grows=True)


def losses(recording: Recording) -> dict[str, int]:
    """Counter and role -> how much it grew in all; resets to zero do not hide it."""
    found = {}
    for role in ROLES:
        for message, fields in LOSSES.items():
            for field in fields:
                count = frames(recording, role, message)[field].astype(np.int64)
                steps = np.diff(count, prepend=0)
                found[f"{field}, {role}"] = int(steps[steps > 0].sum())
    return found


def _is_rig(data: object) -> bool:
    return isinstance(data, dict) and isinstance(data.get("rss_kib"), int)
