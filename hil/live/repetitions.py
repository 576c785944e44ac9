# SPDX-License-Identifier: Apache-2.0
"""Repetitions while the trace grows: at every moment what :mod:`hil.reps` finds in it so far.

The definition of a repetition looks at the whole trace: the range of the set decides what is
partial. So it is not repeated here step by step: the same function is applied to the trace up to
now, of which only those samples are kept that it can depend on. While the bar is quiet, one sample
every ``QUIET_STEP_S`` and the one most inclined in between stand for the rest.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.reps import RepetitionSet, of_outputs, repetitions
from hil.reps.find import ON_MPS, PARTIAL_SHARE
from hil.reps.trace import GAP_MAX_S
from hil.wire.messages import TICK_RATE_HZ

QUIET_STEP_S: Final = 0.8 * GAP_MAX_S
"""Samples further apart than ``GAP_MAX_S`` would end the trace."""
KEPT_MAX: Final = 200_000
"""Half an hour of a bar that never rests; the set is closed then and another begins."""
SETS_MAX: Final = 16

ROW: Final = np.dtype(
    [
        ("t_ticks", "<u8"),
        ("q", "<f4", 4),
        ("centre_velocity_mps", "<f4", 3),
        ("centre_height_m", "<f4"),
        ("flags", "<u2"),
    ]
)
"""As :func:`hil.reps.of_outputs` reads it."""
_NAMES: Final = {"t_ticks": "t_ticks_leader", "q": "quaternion"}
_NOTHING: Final = RepetitionSet((), ())


class Counter:
    """Repetitions of the set under way, and of the last few before it.

    A set is what :func:`hil.reps.of_recording` makes a trace of: it ends where the estimate pauses,
    because the sensor rested or the leader began anew.

    Attributes:
        finished: sets before the present one that had repetitions, oldest first.
    """

    def __init__(self, partial_share: float = PARTIAL_SHARE, kept_max: int = KEPT_MAX) -> None:
        self.finished: deque[RepetitionSet] = deque(maxlen=SETS_MAX)
        self._partial_share = partial_share
        self._kept_max = kept_max
        self._stale = False
        self._begin()

    def take(self, states: NDArray[Any]) -> None:
        """Records of ``ekf_state``, in the stream's order; those without a number are skipped."""
        rows = np.zeros(len(states), ROW)
        for name in ROW.names or ():
            rows[name] = states[_NAMES.get(name, name)]
        sound = np.isfinite(rows["q"]).all(axis=1) & np.isfinite(rows["centre_height_m"])
        rows = rows[sound & np.isfinite(rows["centre_velocity_mps"][:, 2])]
        t_s = rows["t_ticks"].astype(np.float64) / TICK_RATE_HZ
        quiet = np.abs(rows["centre_velocity_mps"][:, 2].astype(np.float64)) <= ON_MPS
        w, x, y, z = rows["q"].astype(np.float64).T
        incline = np.abs(x * z - w * y)
        for row, *of_row in zip(rows, t_s.tolist(), quiet.tolist(), incline.tolist(), strict=True):
            self._add(row.copy(), *of_row)

    @property
    def current(self) -> RepetitionSet:
        """The set under way."""
        if self._stale:
            waiting = np.array([row for row, _ in self._quiet], ROW)
            traces = of_outputs(np.concatenate([self._rows[: self._kept], waiting]))
            self._found = repetitions(traces[-1], self._partial_share) if traces else _NOTHING
            self._stale = False
        return self._found

    def _begin(self) -> None:
        self._rows = np.zeros(1024, ROW)
        self._kept = 0
        self._kept_t_s = self._t_s = float("-inf")
        self._quiet: list[tuple[Any, float]] = []
        self._was_quiet = False
        self._found = _NOTHING
        self._stale = False

    def _add(self, row: Any, t_s: float, quiet: bool, incline: float) -> None:
        pause = self._kept > 0 and not 0.0 < t_s - self._t_s <= GAP_MAX_S
        if pause or self._kept >= self._kept_max:
            if self.current.repetitions:
                self.finished.append(self.current)
            self._begin()
        if quiet and self._was_quiet:
            if t_s - self._kept_t_s > QUIET_STEP_S:
                self._thin()
            self._quiet.append((row, incline))
        else:
            # Either side of a crossing is needed to say when it was.
            self._thin()
            self._keep(row)
            self._kept_t_s = t_s
            self._stale = True
        self._t_s, self._was_quiet = t_s, quiet

    def _thin(self) -> None:
        if not self._quiet:
            return
        most = max(range(len(self._quiet)), key=lambda k: self._quiet[k][1])
        if most < len(self._quiet) - 1:
            self._keep(self._quiet[most][0])
        self._keep(self._quiet[-1][0])
        self._kept_t_s = self._t_s
        self._quiet.clear()

    def _keep(self, row: Any) -> None:
        if self._kept == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._kept] = row
        self._kept += 1
