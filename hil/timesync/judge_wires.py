# SPDX-License-Identifier: Apache-2.0
"""Pulses that the boards see of each other through two wires: what does without an analyser.

Each node captures the other's pulse with the timer that made its own, so one clock has both ends of
the difference. Where the nodes disagree with each other, a wire or a capture is at fault.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import TICK_NS, judged
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, frames
from hil.timesync.analysis import Sync
from hil.timesync.judging import spread
from hil.wire.messages import PULSE_FLAGS

Float = NDArray[np.float64]

SIGN: Final = {"leader": 1.0, "follower": -1.0}
"""Own COMPARE minus capture of the other's pulse, to leader minus follower."""
CAPTURE_NS: Final = 2 * TICK_NS
"""The tick of the capture, and one for the pin to reach the timer through GPIOTE and PPI."""


def wire_errors(recording: Recording, sync: Sync) -> list[Measurement]:
    """``sync.wire_error_p99_ns`` and ``_max_ns``.

    Nothing where the boards are not wired to each other; unset where the wires carry nothing.
    """
    names = ("sync.wire_error_p99_ns", "sync.wire_error_max_ns")
    error_ns = {role: wire_error_ns(frames(recording, role, "pulse"), role, sync) for role in ROLES}
    both = np.concatenate(list(error_ns.values()))
    if both.size == 0 and not recording.provenance.host.get("wires"):
        return []
    if both.size == 0:
        how = "no node captured a pulse of the other while locked: look at the two pulse wires"
        return [judged(name, None, "G1", sync.conditions, how) for name in names]
    found = spread(both)
    how = (
        f"{both.size} pulses captured by the other node while locked, leader minus follower on the "
        "capturing node's clock"
    )
    details = {role: int(values.size) for role, values in error_ns.items()}
    details_ns = {f"{role}_mean_ns": float(np.mean(v)) for role, v in error_ns.items() if v.size}
    return [
        judged(
            name,
            found[kind],
            "G1",
            sync.conditions,
            how,
            uncertainty=CAPTURE_NS,
            details=details | details_ns,
        )
        for name, kind in zip(names, ("p99", "max"), strict=True)
    ]


def wire_error_ns(sent: NDArray[Any], role: str, sync: Sync) -> Float:
    """float64[n]: leader's pulse minus the follower's, as ``role`` saw both, ns."""
    flags = sent["flags"].astype(np.int64)
    seen = ((flags & PULSE_FLAGS["captured"]) != 0) & ((flags & PULSE_FLAGS["late"]) == 0)
    seen &= sync.settled(sent["scheduled_ticks_leader"].astype(np.int64))
    own, other = (
        sent[field][seen].astype(np.int64)
        for field in ("compare_ticks_node", "captured_ticks_node")
    )
    return np.asarray(SIGN[role] * (own - other) * TICK_NS, dtype=np.float64)
