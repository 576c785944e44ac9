# SPDX-License-Identifier: Apache-2.0
"""Offset, skew, jitter and sync error of the two nodes: pure functions of a recording.

:func:`analyse` computes everything once; :func:`measure` judges it, :func:`series` shows it. The
maths works on plain arrays: pairs of captures (:mod:`~hil.timesync.pairs`), lines through them
(:mod:`~hil.timesync.fit`), the true clocks (:mod:`~hil.timesync.truth`), the firmware's model
(:mod:`~hil.timesync.model`), pulses (:mod:`~hil.timesync.pulses`), counter wraps
(:mod:`~hil.timesync.ticks`).
"""

from hil.timesync.analysis import Sync, analyse
from hil.timesync.measures import measure
from hil.timesync.series import series

__all__ = ["Sync", "analyse", "measure", "series"]
