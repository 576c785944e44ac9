# SPDX-License-Identifier: Apache-2.0
"""Statistics of a long recording over its hours, and their trends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hil.budget import line
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
"""Events of this kind hold ``rss_kib``, memory of the process that records, and ``chunks``, how
many it has written to the recording: its index is in memory until the end."""
RIG_SETTLED_S: Final = 300.0
"""Until then the recorder's buffers grow to what the largest chunk so far has needed: in a run of
six hours by 3.7 % of its memory in the first minute and 0.9 % in the four after, 0.5 % in the next
five."""
LOSSES_LINE: Final = "L4"
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
        name, title: for programs, and for people.
        line: of the error budget, which says what change over the whole run is no drift.
        scale: what the line's limit is multiplied by, to be in ``unit``.
        grows: only a growth is bad; None: any change.
        begin_s: from when on it is followed.
    """

    name: str
    title: str
    unit: str
    t_s: Float
    value: Float
    line: str
    scale: float = 1.0
    rms: bool = False
    grows: bool | None = None
    begin_s: float = 0.0

    @property
    def allowed(self) -> float:
        """Change over the run that is no drift, in ``unit``."""
        high = line(self.line).cases[0].high
        assert high is not None
        return high * self.scale

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
        change: from when on the track is followed to the end, by the line.
        half_width: of its 95 % confidence interval.
        significant: size of the change in the bad direction; 0 when the interval holds zero.
        drifts: that is beyond what is allowed.
    """

    change: float
    half_width: float
    significant: float
    drifts: bool

    @property
    def words(self) -> str:
        """``+12.3 ± 4``, in the track's unit."""
        return f"{'+' if self.change >= 0 else ''}{short(self.change)} ± {short(self.half_width)}"


@dataclass(frozen=True)
class Row:
    """A track, its statistic in each hour and in each of PARTS parts, and the trend."""

    track: Track
    hours: tuple[float, ...]
    parts: tuple[float, ...]
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


_KEPT: WeakKeyDictionary[Recording, Soak] = WeakKeyDictionary()


def short(value: float) -> str:
    """Three digits, or all before the point; never a power of ten for what people count in."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def duration_s(recording: Recording) -> float:
    """Until the last block of serial bytes began, by the bench's clock."""
    ends = [int(s.block_t_ns_bench[-1]) for s in recording.serial.values() if s.data.size]
    return max(ends, default=0) / 1e9


def is_long(recording: Recording) -> bool:
    """Whether trends can be told."""
    return duration_s(recording) >= SHORTEST_S


def figures(recording: Recording) -> Soak:
    """Everything about a long recording.

    A recording never changes, so its figures are kept for as long as it lives.

    Raises:
        HilError: it is shorter than :data:`SHORTEST_S`.
    """
    kept = _KEPT.get(recording)
    if kept is None:
        kept = _KEPT[recording] = _figures(recording)
    return kept


def _figures(recording: Recording) -> Soak:
    lasted_s = duration_s(recording)
    if not is_long(recording):
        raise HilError(
            f"the recording lasts {lasted_s:.0f} s; trends need {SHORTEST_S:.0f} s",
            "hil record fixtures/scenarios/soak.toml -o my-soak takes six hours of simulated time",
        )
    # What is left after the last whole hour is one more column only if it can say something.
    hours = np.arange(0.0, max(lasted_s - SHORTEST_S / 2, 1.0), HOUR_S)
    rows = tuple(
        Row(
            track,
            tuple(track.over(begin, begin + HOUR_S) for begin in hours.tolist()),
            parts := in_parts(track, lasted_s),
            trend(track, parts),
        )
        for track in tracks(recording)
    )
    return Soak(lasted_s, rows, losses(recording))


def part_edges_s(track: Track, lasted_s: float) -> Float:
    """float64[PARTS + 1]: where the parts of the run begin and end."""
    return np.linspace(track.begin_s, lasted_s, PARTS + 1)


def in_parts(track: Track, lasted_s: float) -> tuple[float, ...]:
    """The statistic of each of PARTS equal parts of the run."""
    edges_s = part_edges_s(track, lasted_s)
    return tuple(track.over(a, b) for a, b in pairwise(edges_s.tolist()))


def trend(track: Track, parts: Sequence[float]) -> Trend | None:
    """The line through PARTS equal parts of the run; None where fewer are known.

    Neighbouring samples are not independent, so the line goes through means of parts that are long
    beside any of the run's own rhythms; ordinary least squares, Student's t for the interval.
    """
    value = np.array(parts)
    if not np.isfinite(value).all():
        return None
    x = np.linspace(-0.5, 0.5, PARTS + 1)
    x = (x[:-1] + x[1:]) / 2
    value -= value.mean()
    change = float(x @ value / (x @ x))
    rest = value - change * x
    half_width = STUDENT_T * float(np.sqrt(rest @ rest / (PARTS - 2) / (x @ x)))
    bad = abs(change) if track.grows is None else change if track.grows else -change
    significant = bad if bad > half_width else 0.0
    return Trend(change, half_width, significant, significant > track.allowed)


def tracks(recording: Recording) -> Iterator[Track]:
    """What is followed through the run."""
    sync = analyse(recording)
    if sync.truth and np.any(sync.models.locked):
        error = model_error(sync.models, sync.truth)
        t_s, error_ns = error.t_ticks_leader / TICK_RATE_HZ, error.offset_ns
        of = ("ns", t_s, error_ns, "D1", float(np.sqrt(np.mean(error_ns**2))))
        yield Track("sync_rms_change", "sync error, rms", *of, rms=True)
        yield Track("sync_mean_change", "sync error, mean", *of)
    for role in ROLES:
        health = frames(recording, role, "system")
        at_s = seen_t_ns_bench(recording, role, health) / 1e9
        for field, name, title, grows in (
            ("stack_free_min_b", "stack_loss", "stack left", False),
            ("heap_used_b", "heap_growth", "heap in use", True),
        ):
            value = health[field].astype(np.float64)
            yield Track(
                *(f"{role}.{name}", f"{title}, {role}", "B", at_s, value, "D2"), grows=grows
            )
    rig = [e for e in recording.events if _is_rig(e.data)]
    if rig:
        seen = [(e.t_ns_bench / 1e9, e.data["rss_kib"], e.data["chunks"]) for e in rig]
        at_s, kib, chunks = np.array(seen, dtype=np.float64).T
        settled = int(np.searchsorted(at_s[:-1], RIG_SETTLED_S))
        yield Track(
            *("rig.memory_growth", "memory of the rig", "KiB", at_s, kib, "D3"),
            scale=float(chunks[-1] - chunks[settled]),
            grows=True,
            begin_s=RIG_SETTLED_S,
        )


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
    return isinstance(data, dict) and all(
        isinstance(data.get(name), int) for name in ("rss_kib", "chunks")
    )
