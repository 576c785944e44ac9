# SPDX-License-Identifier: Apache-2.0
"""Steps by what they did, and what each kind costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.pil import layout
from hil.pil.emulator import TargetRun
from hil.reference.estimator import Flag

_RIGID: Final = int(Flag.RIGID | Flag.RIGID_GATED)
_STILL: Final = int(Flag.ZUPT | Flag.ZUPT_GATED | Flag.GRAVITY)
_RARE: Final = int(Flag.ROUND_TRIP | Flag.ROUND_TRIP_GATED | Flag.ANCHOR | Flag.BOUND)

_Chosen = Callable[[NDArray[np.uint32], NDArray[np.int64]], NDArray[np.bool_]]

FULL: Final = "rigid-body update"
"""Prefilter, prediction, rigid-body update and detector, and no other update."""

_KINDS: Final[dict[str, _Chosen]] = {
    "no update, no follower": lambda f, n: ((f & (_RIGID | _STILL | _RARE)) == 0) & (n == 0),
    "no update, follower samples": lambda f, n: ((f & (_RIGID | _STILL | _RARE)) == 0) & (n > 0),
    FULL: lambda f, n: ((f & _RIGID) != 0) & ((f & (_STILL | _RARE)) == 0),
    "zero velocity": lambda f, n: ((f & _STILL) != 0) & ((f & (_RIGID | _RARE)) == 0),
    "zero velocity and rigid-body": lambda f, n: (
        ((f & _STILL) != 0) & ((f & _RIGID) != 0) & ((f & _RARE) == 0)
    ),
    "round trip or bound": lambda f, n: (f & _RARE) != 0,
}


@dataclass(frozen=True)
class Kind:
    """Instructions of the steps of one kind; zeros when there was none."""

    name: str
    steps: int
    mean: float
    max: int


def estimated(run: TargetRun) -> NDArray[np.bool_]:
    """(n,) steps after the alignment."""
    found: NDArray[np.bool_] = run.outputs["status"] == layout.STATUS.index("ESTIMATED")
    return found


def members(run: TargetRun, kind: str) -> NDArray[np.bool_]:
    """(n,) steps of a kind."""
    return estimated(run) & _KINDS[kind](run.outputs["flags"], run.followers)


def at_rest(run: TargetRun) -> NDArray[np.bool_]:
    """(n,) steps on which a zero-velocity update was tried."""
    still: NDArray[np.bool_] = (run.outputs["flags"] & _STILL) != 0
    return estimated(run) & still


def by_kind(run: TargetRun) -> list[Kind]:
    """Every kind; each step after the alignment is in exactly one."""
    return [
        _kind("aligning", run, ~estimated(run)),
        *(_kind(name, run, members(run, name)) for name in _KINDS),
        _kind("all after the alignment", run, estimated(run)),
    ]


def _kind(name: str, run: TargetRun, chosen: NDArray[np.bool_]) -> Kind:
    counts = run.instructions[chosen]
    if not len(counts):
        return Kind(name, 0, 0.0, 0)
    return Kind(name, len(counts), float(counts.mean()), int(counts.max()))
