# SPDX-License-Identifier: Apache-2.0
"""Recordings: a whole run on one clock, in one MCAP file that survives what happens to files.

``docs/recording-format.md`` describes the file. :class:`Writer` makes one while the run goes
on, :func:`load` reads it, :class:`Recording` is what the checks see.
"""

from hil.recording.clock import ClockModel, WanderTerm
from hil.recording.model import (
    EDGE_CHANNELS,
    IMU_TRUTH_FLAGS,
    SOURCES,
    Edges,
    Event,
    ImuTruth,
    Integrity,
    Provenance,
    Recording,
    SerialStream,
)
from hil.recording.reader import load
from hil.recording.writer import Writer

__all__ = [
    "EDGE_CHANNELS",
    "IMU_TRUTH_FLAGS",
    "SOURCES",
    "ClockModel",
    "Edges",
    "Event",
    "ImuTruth",
    "Integrity",
    "Provenance",
    "Recording",
    "SerialStream",
    "WanderTerm",
    "Writer",
    "load",
]
