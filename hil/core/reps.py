# SPDX-License-Identifier: Apache-2.0
"""The firmware's detector of repetitions (``firmware/lib/reps``, C++) on the host.

What its reports mean stands in docs/repetitions.md; the definition is :mod:`hil.reps`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.core import _core
from hil.wire.messages import BY_NAME
from hil.wire.records import record_type

KEPT: Final[int] = _core.REPS_KEPT
"""Lifts of one set that are kept; older ones are reported no more."""
STILL: Final[int] = _core.REPS_STILL
FOLLOWER_LOST: Final[int] = _core.REPS_FOLLOWER_LOST
CLIPPED: Final[int] = _core.REPS_CLIPPED
"""Bits of a sample's flags."""


@dataclass(frozen=True, eq=False)
class Reports:
    """What the detector said.

    Attributes:
        frames: (k,) the fields of the wire's ``rep``, in the order of sending.
        sample: int64[k], the sample with which each was sent; -1 at the end of the set.
    """

    frames: NDArray[Any]
    sample: NDArray[np.int64]


class Detector:
    """The detector with its state."""

    def __init__(self) -> None:
        self._core = _core.Reps()

    def push(
        self,
        t_ticks: NDArray[np.int64],
        velocity_z_mps: NDArray[Any],
        height_m: NDArray[Any],
        tilt_rad: NDArray[Any],
        flags: NDArray[Any] | None = None,
    ) -> Reports:
        """Take n samples of the bar's centre, each (n,); another call goes on behind them.

        Args:
            flags: bits STILL, FOLLOWER_LOST, CLIPPED; none if left out.

        Raises:
            ValueError: columns of different lengths.
        """
        t = np.ascontiguousarray(t_ticks, dtype=np.int64)
        v, h, tilt = (
            np.ascontiguousarray(c, dtype=np.float32) for c in (velocity_z_mps, height_m, tilt_rad)
        )
        bits = np.zeros(len(t), np.uint8) if flags is None else flags
        return _reports(*self._core.push(t, v, h, tilt, np.ascontiguousarray(bits, np.uint8)))

    def end(self) -> Reports:
        """End the set: what is still to be said of it."""
        return _reports(*self._core.end())


def _reports(samples: list[int], payloads: bytes) -> Reports:
    message = BY_NAME["rep"]
    whole = record_type(message)
    sent = np.dtype([(f.name, whole[f.name]) for f in message.fields])
    return Reports(np.frombuffer(payloads, sent), np.array(samples, np.int64))
