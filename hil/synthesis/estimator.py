# SPDX-License-Identifier: Apache-2.0
"""The leader's clock model as a synthetic recording has it: a straight line by normal equations.

Written apart from :mod:`hil.timesync` on purpose: a check must not be tested against itself.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.synthesis.plan import Plan
from hil.synthesis.radio import CONNECT_S, Events

Float = NDArray[np.float64]

REPORT_EVENTS = 2
"""The follower's stamps of an event reach the leader this many events later."""
WINDOW_S = 2.0
MIN_PAIRS = 8
STATES = {"unsynced": 0, "converging": 1, "locked": 2, "holdover": 3}


@dataclass(frozen=True)
class State:
    """One model: follower = leader + offset + skew * (leader - t_ref)."""

    true_us: float
    generation: int
    t_ref: int
    offset: float
    skew: float
    rms: float
    pairs: int
    state: int

    def follower_ticks(self, leader_ticks: float) -> float:
        return leader_ticks + self.offset + self.skew * (leader_ticks - self.t_ref)


def states(plan: Plan, table: Events) -> list[State]:
    """The models that the leader would have, one every ``plan.state_period_s``."""
    rows = np.flatnonzero(table.paired)
    if rows.size == 0:
        return []
    t = np.asarray(0.5 * (table.l_tx[rows] + table.l_rx[rows]), dtype=np.float64)
    forward = table.f_rx[rows] - table.l_tx[rows]
    backward = table.f_tx[rows] - table.l_rx[rows]
    offset = np.asarray((forward + backward) / 2.0, dtype=np.float64)
    generation = table.generation[rows]
    delay_us = REPORT_EVENTS * plan.conn_interval_us + 300
    available_us = table.true_us[rows] + delay_us
    result = []
    steps = int((plan.duration_s - CONNECT_S - 0.3) / plan.state_period_s)
    for step in range(steps):
        now_us = (CONNECT_S + 0.2 + step * plan.state_period_s) * 1e6
        last = int(np.searchsorted(available_us, now_us, side="right"))
        if last == 0:
            continue
        newest = t[last - 1]
        first = int(np.searchsorted(t, newest - WINDOW_S * 16e6, side="right"))
        first = max(first, int(np.searchsorted(generation, generation[last - 1])))
        result.append(_fit(plan, now_us, t[first:last], offset[first:last], generation[last - 1]))
    return result


def _fit(plan: Plan, now_us: float, t: Float, y: Float, generation: int) -> State:
    t_ref = int(t[-1])
    x = (t - t_ref) / 16e6
    if t.size < MIN_PAIRS:
        return State(now_us, int(generation), t_ref, float(y[-1]), 0.0, 0.0, t.size, 0)
    design = np.stack([np.ones_like(x), x], axis=1)
    (level, slope), *_ = np.linalg.lstsq(design, y - y[0], rcond=None)
    rms = float(np.std(y - y[0] - level - slope * x))
    state = STATES["locked"] if -x[0] >= plan.lock_after_s else STATES["converging"]
    return State(
        true_us=now_us,
        generation=int(generation),
        t_ref=t_ref,
        offset=float(level + y[0]),
        skew=plan.skew_sign * float(slope) / 16e6,
        rms=rms,
        pairs=int(t.size),
        state=state,
    )


def locked(models: list[State], true_us: float) -> State | None:
    """The latest model at ``true_us``, if it is locked."""
    at = bisect_left(models, true_us, key=lambda m: m.true_us) - 1
    return models[at] if at >= 0 and models[at].state == STATES["locked"] else None
