# SPDX-License-Identifier: Apache-2.0
"""The state of the page: records in, frames for browsers out. No clock, no network, no thread.

A browser is told what has changed since what it was told last, so that one that was away for a
moment, or is slow, gets the newest state and not a queue of old ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.live.health import Health
from hil.live.repetitions import Counter
from hil.live.trail import ImuTrail, Trail, samples
from hil.live.words import LEVELS, worst
from hil.reps import Repetition, RepetitionSet
from hil.streams import ROLES
from hil.wire.codec import Decoded, physical
from hil.wire.messages import SYNC_STATES, TICK_RATE_HZ

BACK_S: Final = 1.0
"""Time that goes back by more is that of a leader that began anew."""
REPETITIONS_SHOWN: Final = 30

_T: Final = "t_ticks_leader"
_T_IMU: Final = "t_first_ticks_node"


@dataclass(frozen=True)
class About:
    """What the page shows, and how it is labelled.

    Attributes:
        kind: ``bench``, ``sim`` or ``replay``.
        label: in large letters, e.g. ``SIMULATION``; never missing.
        title: what is run or replayed.
        note: one sentence about where the numbers come from.
        roles: whose serial ports there are.
        simulated: no real radio and no real processor.
    """

    kind: str
    label: str
    title: str
    note: str
    roles: tuple[str, ...] = ROLES
    simulated: bool = False


@dataclass(frozen=True)
class Seen:
    """How much of the page a browser has been told."""

    epoch: int = -1
    t_s: float | None = None
    velocity: int = 0
    imu: tuple[int, ...] = (0, 0)
    repetitions: int = 0
    health: int = 0


@dataclass(frozen=True)
class Model:
    """The leader's clock model in force, of ``sync_state``; times in ticks."""

    state: int
    t_ref: float
    offset: float
    skew: float

    def leader(self, follower: NDArray[np.float64]) -> NDArray[np.float64]:
        """Times on the follower's clock, on the leader's."""
        near = follower - self.offset
        return np.asarray(near - self.skew * (near - self.t_ref))


class Page:
    """See the module."""

    def __init__(self, about: About) -> None:
        self.about = about
        self.ended = ""
        self._health = Health(about.roles, about.simulated)
        self._counter = Counter()
        self._epoch = 0
        self._versions = {"repetitions": 0, "health": 0}
        self._shown: dict[str, Any] = {"repetitions": None, "health": None}
        self._clear()

    def port(self, role: str, state: str, why: str = "") -> None:
        """The serial port of ``role`` is now ``open``, ``lost`` or still ``waiting``."""
        node = self._health.nodes[role]
        node.port, node.why = state, why

    def take(self, role: str, found: Decoded, now_s: float) -> None:
        """What a node's stream has brought; ``now_s`` is the host's time."""
        if role == "leader":
            self._leader(found)
        self._health.take(role, found, now_s)

    def refresh(self, now_s: float) -> None:
        """Bring what is derived up to ``now_s``, the host's time."""
        rows = [row.plain() for row in self._health.rows(now_s, self.ended)]
        level = worst([row["level"] for row in rows] + [self._health.fault_level()])
        health = {
            "rows": rows,
            "faults": self._health.fault_list(),
            "level": level,
            "state": LEVELS[level],
            "ended": self.ended,
            "port": self._health.nodes["leader"].port,
            "resting": self._health.resting,
        }
        for name, value in (("repetitions", self._repetitions()), ("health", health)):
            if value != self._shown[name]:
                self._shown[name] = value
                self._versions[name] += 1

    def since(self, seen: Seen) -> tuple[dict[str, Any], Seen]:
        """What a browser does not know yet, and how much it knows with it.

        When that is as much as before, there is nothing to tell.
        """
        t_s = _number(self._t_s, 4)
        frame: dict[str, Any] = {"t": t_s, "v": _number(self._velocity_mps, 3)}
        if seen.epoch != self._epoch:
            seen = Seen(self._epoch)
            frame["about"] = {k: v for k, v in vars(self.about).items() if k != "roles"}
        points = self._trail.since(seen.velocity)
        imu = {r: t.since(n) for (r, t), n in zip(self._imu.items(), seen.imu, strict=True)}
        if points:
            frame["velocity"] = points
        if any(imu.values()):
            frame["imu"] = imu
        if seen.repetitions != self._versions["repetitions"]:
            frame["repetitions"] = self._shown["repetitions"]
        if seen.health != self._versions["health"]:
            frame["health"] = self._shown["health"]
        return frame, Seen(
            self._epoch,
            t_s,
            self._trail.total,
            tuple(trail.total for trail in self._imu.values()),
            self._versions["repetitions"],
            self._versions["health"],
        )

    def _clear(self) -> None:
        self._epoch += 1
        self._trail = Trail(1, 3)
        self._imu = {role: ImuTrail() for role in ROLES}
        self._t_s = float("nan")
        self._velocity_mps = float("nan")
        self._model: Model | None = None

    def _leader(self, found: Decoded) -> None:
        states = found.messages["ekf_state"]
        batches = found.messages["imu_batch"]
        own = batches[batches["source"] == ROLES.index("leader")]
        newest = [r[f][-1] for r, f in ((states, _T), (own, _T_IMU)) if r.size]
        if newest:
            t_s = float(max(newest)) / TICK_RATE_HZ
            if t_s < self._t_s - BACK_S:
                self._clear()
            self._t_s = np.fmax(self._t_s, t_s)
        models = found.messages["sync_state"]
        if models.size:
            self._model = Model(
                int(models["state"][-1]),
                float(models["t_ref_ticks_leader"][-1]),
                float(physical(models[-1:], "sync_state", "offset_ticks", found.table)[0]),
                float(physical(models[-1:], "sync_state", "skew", found.table)[0]),
            )
        self._counter.take(states)
        velocity = states["centre_velocity_mps"][:, 2].astype(np.float64)
        for ticks, v in zip(states[_T].tolist(), velocity.tolist(), strict=True):
            self._trail.add(ticks / TICK_RATE_HZ, [v])
            self._velocity_mps = v
        if batches.size:
            self._batches(found)

    def _batches(self, found: Decoded) -> None:
        batch, ticks, values = samples(found)
        source = found.messages["imu_batch"]["source"][batch]
        for number, role in enumerate(ROLES):
            own = source == number
            if not own.any():
                continue
            if role == "leader":
                self._imu[role].take(ticks[own] / TICK_RATE_HZ, values[own])
            elif self._model and self._model.state != SYNC_STATES["unsynced"]:
                self._imu[role].take(self._model.leader(ticks[own]) / TICK_RATE_HZ, values[own])

    def _repetitions(self) -> dict[str, Any]:
        found = self._counter.current
        shown = [_shown(one) for one in found.repetitions[-REPETITIONS_SHOWN:]]
        last = self._counter.finished[-1] if self._counter.finished else None
        return {
            "count": len(found.full),
            "partial": len(found.partial),
            "sets": len(self._counter.finished),
            "loss_percent": _number(found.velocity_loss_percent, 1),
            "best_mps": _best(found),
            "repetitions": shown,
            "first": len(found.repetitions) - len(shown) + 1,
            "before": last and {"count": len(last.full), "best_mps": _best(last)},
        }


def _best(found: RepetitionSet) -> float | None:
    return max((_number(r.figures.mean_mps, 3) or 0.0 for r in found.full), default=None)


def _shown(one: Repetition) -> dict[str, Any]:
    f = one.figures
    return {
        "kind": one.kind,
        "start_s": _number(one.t_start_s, 3),
        "end_s": _number(one.t_end_s, 3),
        "mean_mps": _number(f.mean_mps, 3),
        "peak_mps": _number(f.peak_mps, 3),
        "range_m": _number(f.range_m, 3),
        "tilt_deg": _number(f.tilt_deg, 1),
    }


def _number(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None
