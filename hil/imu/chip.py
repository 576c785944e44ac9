# SPDX-License-Identifier: Apache-2.0
"""What a node says about its IMU chip: its FIFO counters, its rate, whether there is one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.recording import Recording
from hil.streams import frames, seen_t_ns_bench, table

Int = NDArray[np.int64]

FIFO_WORDS: Final = 512
"""What the FIFO of the LSM6DSOX holds; a sample instant takes two words."""


@dataclass(frozen=True, eq=False)
class FifoStats:
    """The ``fifo_stats`` frames of one node, in the order of sending.

    Attributes:
        raw: the frames.
        t_ticks: int64[n], node's clock, when counted.
        seen_t_ns_bench: int64[n].
        odr_hz: nominal rate of the sensor; NaN without a frame that says it.
        decimation: samples of the sensor to one of the stream; 1 without.
    """

    raw: NDArray[Any]
    t_ticks: Int
    seen_t_ns_bench: Int
    odr_hz: float
    decimation: int

    def __len__(self) -> int:
        return int(self.raw.size)

    def count(self, field: str) -> Int:
        """int64[n]: a counter."""
        return np.asarray(self.raw[field].astype(np.int64))

    def last(self, field: str) -> float:
        """The last value of a counter; NaN when no frame came."""
        return float(self.raw[field][-1]) if len(self) else float("nan")

    def since_setup(self) -> FifoStats:
        """The frames after the IMU was last started anew, which sets its counters to zero."""
        fell = np.flatnonzero(np.diff(self.count("samples")) < 0) + 1
        start = int(fell[-1]) if fell.size else 0
        return FifoStats(
            self.raw[start:],
            self.t_ticks[start:],
            self.seen_t_ns_bench[start:],
            self.odr_hz,
            self.decimation,
        )


def fifo_stats(recording: Recording, role: str) -> FifoStats:
    """The FIFO counters that ``role`` reported."""
    sent = frames(recording, role, "fifo_stats")
    told = sent.size > 0 and has_chip(recording, role)
    return FifoStats(
        raw=sent,
        t_ticks=sent["t_ticks_node"].astype(np.int64),
        seen_t_ns_bench=seen_t_ns_bench(recording, role, sent),
        odr_hz=float(sent["odr_hz"][-1]) if told else math.nan,
        decimation=max(1, int(sent["decimation"][-1])) if told else 1,
    )


def rests(recording: Recording, role: str) -> int:
    """How often the sensor of ``role`` rested and was woken."""
    stats = fifo_stats(recording, role)
    return int(stats.last("wake_ups")) if len(stats) and has_chip(recording, role) else 0


def has_chip(recording: Recording, role: str) -> bool:
    """Whether the samples of ``role`` come from a sensor.

    Nodes made them up until their protocol table learnt to tell the sensor's rate.
    """
    told = table(recording, role).get("fifo_stats")
    return told is not None and any(field.name == "odr_hz" for field in told.fields)
