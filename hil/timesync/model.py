# SPDX-License-Identifier: Apache-2.0
"""The leader's clock model, as its ``sync_state`` frames give it, evaluated while in use.

A model is in use from the moment its frame was sent until the next one is: a host that converts
times can know nothing newer. "Now" on the leader's clock, when a frame was sent, is the latest
time stamp that the leader had already sent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.timesync.truth import Truth
from hil.wire.codec import physical
from hil.wire.messages import BY_NAME, SYNC_STATES, TICK_RATE_HZ, Message

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

NS_PER_TICK = 1e9 / TICK_RATE_HZ


@dataclass(frozen=True, eq=False)
class Models:
    """One row per ``sync_state`` frame, in the order of sending.

    Attributes:
        now_ticks_leader: int64[n], latest stamp sent before the frame.
        until_ticks_leader: int64[n], when the next model of the same connection came.
        t_ref_ticks_leader: int64[n].
        offset_ticks, skew, residual_rms_ticks: float64[n].
        window_us, generation, state: int64[n].
    """

    now_ticks_leader: Int
    until_ticks_leader: Int
    t_ref_ticks_leader: Int
    offset_ticks: Float
    skew: Float
    residual_rms_ticks: Float
    window_us: Int
    generation: Int
    state: Int

    def __len__(self) -> int:
        return int(self.state.size)

    @property
    def locked(self) -> Mask:
        return np.asarray(self.state == SYNC_STATES["locked"], dtype=bool)

    def offset_at(self, row: Int, ticks_leader: Int | Float) -> Float:
        """float64[m]: follower minus leader ticks, by model ``row[m]`` at ``ticks_leader[m]``."""
        span = np.asarray(ticks_leader, dtype=np.float64) - self.t_ref_ticks_leader[row]
        return self.offset_ticks[row] + self.skew[row] * span

    def row_in_use(self, ticks_leader: Int | Float) -> Int:
        """int64[m]: the model in use at each instant; -1 before the first."""
        return (np.searchsorted(self.now_ticks_leader, ticks_leader, side="right") - 1).astype(
            np.int64
        )


@dataclass(frozen=True, eq=False)
class Progress:
    """How far the leader's clock had come at each point of its serial stream.

    Attributes:
        offset: int64[n], byte offsets of frames, ascending.
        ticks_leader: int64[n], latest stamp of the leader's clock in that or an earlier frame.
    """

    offset: Int
    ticks_leader: Int

    def at(self, offset: Int) -> Int:
        """int64[m]: the leader's clock when the frames at ``offset`` were sent."""
        if self.offset.size == 0:
            return np.zeros(offset.size, dtype=np.int64)
        before = np.searchsorted(self.offset, offset) - 1
        return self.ticks_leader[np.maximum(before, 0)]


def progress(
    captures: NDArray[Any], others: tuple[NDArray[Any], ...] = (), field: str = "t_ticks_node"
) -> Progress:
    """From the leader's ``sync_capture`` frames and others that carry its time in ``field``."""
    offset = np.concatenate([captures["offset"], *(o["offset"] for o in others)])
    stamps = [np.maximum(captures["tx_end_ticks_node"], captures["rx_end_ticks_node"])]
    ticks = np.concatenate([*stamps, *(o[field] for o in others)]).astype(np.int64)
    order = np.argsort(offset, kind="stable")
    # A stamp that fell back must not make "now" run backwards; the wrap check reports it.
    latest = np.maximum.accumulate(ticks[order]) if ticks.size else ticks
    return Progress(offset[order].astype(np.int64), latest)


def models(
    states: NDArray[Any], leader: Progress, table: Mapping[str, Message] = BY_NAME
) -> Models:
    """Read the leader's ``sync_state`` frames, by the protocol table they were written with."""
    generation = states["generation"].astype(np.int64)
    now = leader.at(states["offset"])
    end = leader.ticks_leader[-1:] if leader.ticks_leader.size else now[-1:]
    until = np.append(now[1:], end)[: now.size]
    if now.size:
        # A new connection starts a new model; the old one's use ends with its last frame.
        until = np.where(np.append(generation[1:] != generation[:-1], False), now, until)
    return Models(
        now_ticks_leader=now,
        until_ticks_leader=until,
        t_ref_ticks_leader=states["t_ref_ticks_leader"].astype(np.int64),
        offset_ticks=physical(states, "sync_state", "offset_ticks", table),
        skew=physical(states, "sync_state", "skew", table),
        residual_rms_ticks=physical(states, "sync_state", "residual_rms_ticks", table),
        window_us=states["window_us"].astype(np.int64),
        generation=generation,
        state=states["state"].astype(np.int64),
    )


@dataclass(frozen=True, eq=False)
class ModelError:
    """Error of the models against the truth, while locked and in use; float64[n] each.

    Attributes:
        t_ticks_leader: instants, ascending within each model's use.
        offset_ns: predicted minus true offset.
        skew_ppb: predicted minus true skew.
        row: int64[n], which model.
    """

    t_ticks_leader: Float
    offset_ns: Float
    skew_ppb: Float
    row: Int


def model_error(m: Models, truth: Truth, points: int = 4) -> ModelError:
    """Evaluate every locked model at ``points`` instants spread over the time it is in use."""
    rows = np.flatnonzero(m.locked & (m.until_ticks_leader >= m.now_ticks_leader))
    share = (np.arange(points) + 0.5) / points
    span = (m.until_ticks_leader - m.now_ticks_leader)[rows]
    grid = (m.now_ticks_leader[rows][:, None] + share[None, :] * span[:, None]).ravel()
    t = np.asarray(grid, dtype=np.float64)
    row = np.repeat(rows, points)
    return ModelError(
        t_ticks_leader=t,
        offset_ns=(m.offset_at(row, t) - truth.offset_ticks(t)) * NS_PER_TICK,
        skew_ppb=(m.skew[row] - truth.skew(t)) * 1e9,
        row=row,
    )


def locked_share(m: Models, away_ticks_leader: Int | None = None) -> float:
    """Share of the time since the first lock in which the model in use was locked.

    Args:
        away_ticks_leader: int64[k, 2], from and to: times for which the leader was told to stay
            away. Each is left out, and what follows it until the next lock, which convergence
            has a limit for; without a next lock only the time asked for is.
    """
    if not np.any(m.locked):
        return 0.0
    begin, end = m.now_ticks_leader[m.locked], m.until_ticks_leader[m.locked]
    total, held = int(m.until_ticks_leader[-1] - begin[0]), int(np.sum(end - begin))
    done = int(begin[0])
    for asked_from, asked_until in [] if away_ticks_leader is None else away_ticks_leader.tolist():
        later = begin[begin >= asked_until]
        since = max(asked_from, done)
        until = min(int(later[0]) if later.size else asked_until, int(m.until_ticks_leader[-1]))
        if until > since:
            total -= until - since
            held -= int(np.sum(np.maximum(np.minimum(end, until) - np.maximum(begin, since), 0)))
            done = until
    return held / total if total > 0 else 1.0


def time_to_lock_s(m: Models, first_event_ticks: dict[int, int]) -> dict[int, float]:
    """Generation -> seconds from its first connection event to its first locked model.

    Args:
        first_event_ticks: generation -> leader ticks of its first capture.

    A generation that never locks is given as infinity.
    """
    result: dict[int, float] = {}
    for generation, start in first_event_ticks.items():
        mine = m.locked & (m.generation == generation)
        lock = m.now_ticks_leader[mine]
        result[generation] = float(lock[0] - start) / TICK_RATE_HZ if lock.size else float("inf")
    return result
