# SPDX-License-Identifier: Apache-2.0
"""What the checks may say of imported samples, with which nothing else of a run came along."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, frames
from hil.wire.messages import MESSAGES

KEPT: Final = ("imu.", "link.")
"""Beginnings of the names that samples, and the file that they are in, can answer for."""
NEEDS_SYNC: Final = ("I5", "I6")
"""Budget lines of the follower's times on the leader's clock, which only clock models give."""
RADIO: Final = ("L3", "L4")
"""Budget lines of what the nodes count about their link and queues."""
PERIOD: Final = "I3"
"""Budget line of the period that a node measured; in an import it is whatever gives the times back
exactly."""
NOT_THERE: Final = "not applicable: imported samples came without "


def is_bare(recording: Recording) -> bool:
    """Is it an import that holds batches of samples and no other message of the protocol?"""
    found = {
        message.name
        for role in ROLES
        for message in MESSAGES
        if frames(recording, role, message.name).size
    }
    return recording.provenance.source == "import" and found == {"imu_batch"}


def applicable(measurements: Sequence[Measurement], recording: Recording) -> list[Measurement]:
    """``measurements``, without the values that imported samples cannot have.

    A check of the samples themselves stays as it is, and so fails where the leader's are missing.
    """
    alone = not any(
        np.any(frames(recording, role, "imu_batch")["source"] == ROLES.index("follower"))
        for role in ROLES
    )
    silent = (
        frames(recording, "leader", "imu_batch").size > 0
        and not frames(recording, "follower", "imu_batch").size
    )
    missing = [_missing(one, alone, silent) for one in measurements]
    return [
        replace(one, value=None, how=NOT_THERE + what) if what else one
        for one, what in zip(measurements, missing, strict=True)
    ]


def _missing(one: Measurement, alone: bool, silent: bool) -> str:
    """What a measurement needed and did not get; empty where it stands."""
    if not one.name.startswith(KEPT) or one.budget in RADIO:
        return "the messages of a node"
    if one.budget == PERIOD and one.value is not None:
        return "a period that a node measured"
    if one.value is None or not math.isnan(one.value):
        return ""
    if one.budget in NEEDS_SYNC:
        return "models of the clocks"
    if alone and one.name.startswith("imu.follower"):
        return "a follower"
    return "a serial stream of the follower" if silent and one.budget == "L2" else ""
