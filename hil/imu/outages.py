# SPDX-License-Identifier: Apache-2.0
"""Where the run itself ended the BLE link: what the leader could not get then, and for how long."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.budget import Conditions, judged
from hil.imu.batches import Batches
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import hold_s

UNDER_WAY_S: Final = 0.3
"""What was sent before the link ended may reach the leader's serial line this much later."""


@dataclass(frozen=True)
class Outage:
    """Sample indices ``first`` to ``end - 1`` that a link ended on request kept from the leader.

    ``duration_s`` is from the last batch before to the first after, less the time for which the
    node was told to stay away, which is ``hold_s``.
    """

    first: int
    end: int
    duration_s: float
    hold_s: float = 0.0

    @property
    def samples(self) -> int:
        return self.end - self.first


def asked_for(recording: Recording, copy: Batches) -> list[Outage]:
    """The hole in ``copy`` around each disconnection that the run asked for, where there is one."""
    hole = np.flatnonzero(copy.first[1:] > copy.end[:-1])
    before_s = copy.seen_t_ns_bench[hole] / 1e9
    after_s = copy.seen_t_ns_bench[hole + 1] / 1e9
    found = []
    for event in recording.events:
        at_s = event.t_ns_bench / 1e9
        around = np.flatnonzero((before_s <= at_s + UNDER_WAY_S) & (after_s > at_s))
        if event.kind != "disconnect" or around.size == 0:
            continue
        row, i = int(hole[around[-1]]), int(around[-1])
        duration_s = float(after_s[i] - before_s[i]) - hold_s(event)
        found.append(
            Outage(int(copy.end[row]), int(copy.first[row + 1]), duration_s, hold_s(event))
        )
    return found


def measure(recording: Recording, outages: Sequence[Outage], c: Conditions) -> list[Measurement]:
    """The longest outage, and whether a hold was obeyed; nothing where none was asked for."""
    asked = sum(event.kind == "disconnect" for event in recording.events)
    if asked == 0:
        return []
    return [
        *hold(recording, outages, c),
        judged(
            "imu.follower_at_leader.outage_s",
            max((o.duration_s for o in outages), default=math.nan),
            "L7",
            c,
            f"longest of {len(outages)} holes around {asked} disconnections that the run asked "
            "for, from the last batch before to the first after, less the hold asked for",
            details={"samples": [o.samples for o in outages]},
        ),
    ]


def hold(recording: Recording, outages: Sequence[Outage], c: Conditions) -> list[Measurement]:
    """By how much the outages outlasted the holds asked for; nothing where there was no hold."""
    asked = sum(hold_s(event) > 0 for event in recording.events)
    if asked == 0:
        return []
    found = [outage.duration_s for outage in outages if outage.hold_s > 0]
    return [
        judged(
            "imu.follower_at_leader.hold_exceeded_s",
            min(found) if len(found) == asked else math.nan,
            "L9",
            c,
            f"shortest of {len(found)} holes around {asked} disconnections with a hold, from the "
            "last batch before to the first after, less the hold; a hold without a hole fails",
        )
    ]
