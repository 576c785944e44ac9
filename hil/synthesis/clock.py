# SPDX-License-Identifier: Apache-2.0
"""A node's TIMER on true time, as a plan has it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.synthesis.plan import Plan
from hil.synthesis.radio import TICKS_PER_US

Float = NDArray[np.float64]


class Clock:
    """One node's TIMER."""

    def __init__(self, plan: Plan, role: str) -> None:
        self._model = plan.node(role).clock
        self._start_us = plan.node(role).timer_start_us

    def ticks(self, true_us: float | Float) -> Float:
        """Whole microseconds of local time, as the simulator's TIMER counts, in ticks."""
        local_us = np.rint(self._model.local_us(true_us))
        return np.asarray((local_us - self._start_us) * TICKS_PER_US)

    def true_us(self, ticks: float | Float) -> Float:
        local_us = np.asarray(ticks) / TICKS_PER_US + self._start_us
        return np.asarray(self._model.true_us(local_us))

    def compare_edge_ns(self, ticks: float) -> int:
        """When the pin changes: COMPARE falls onto the grid of whole microseconds below it."""
        local_us = math.floor(ticks / TICKS_PER_US) + self._start_us
        return round(float(self._model.true_us(local_us)) * 1e3)
