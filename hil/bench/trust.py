# SPDX-License-Identifier: Apache-2.0
"""Is the capture of a run to be believed? It is held against what the nodes say that they did.

Only what the firmware claims to have done is asked of the analyser: a node that never made a
pulse is a failure of the product, which the checks find, and not of a wire.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hil.bench.analyser.capture import CaptureEdges, Progress
from hil.bench.analyser.edges import renamed
from hil.bench.analyser.selfcheck import Finding, check_capture
from hil.timesync.pulses import pulses
from hil.wire.codec import Decoded
from hil.wire.messages import TICK_RATE_HZ

CLAIMS: Mapping[str, str] = {
    "pulse": "pulse",
    "radio_end": "sync_capture",
    "imu_int1": "imu_batch",
}
"""Signal -> message that says that it moved."""


def findings(
    capture: CaptureEdges, streams: Mapping[str, Decoded], start_sample: int
) -> list[Finding]:
    """What is wrong with the capture of a run; empty when it is sound.

    Args:
        capture: its channels are called as a recording's, ``leader.pulse``.
        streams: role -> what the node said in this run.
        start_sample: what was before is another program's: the boards had not yet booted.
    """
    claimed = [name for name in capture.channels if _claimed(name, streams)]
    if not claimed or start_sample >= capture.samples:
        return []
    part = since(renamed(capture, {name: name for name in claimed}), max(0, start_sample))
    return check_capture(part, pulse_period_s=pulse_period_s(streams["leader"]))


def pulse_period_s(leader: Decoded) -> float | None:
    """Period of the leader's pulses by its own clock; None where they are not a steady train."""
    made = pulses(leader.messages["pulse"])
    if len(made) < 3 or np.any(made.late) or np.any(np.diff(made.index) != 1):
        return None
    steps = np.diff(made.scheduled_ticks_leader)
    return made.period_ticks / TICK_RATE_HZ if np.all(steps == steps[0]) else None


def since(capture: CaptureEdges, start_sample: int) -> CaptureEdges:
    """The capture from a sample on, as if it had begun there."""
    kept = capture.sample > start_sample
    initial = capture.initial.copy()
    # Of the changes of one channel the last one is assigned last, and holds.
    initial[capture.channel[~kept]] = capture.level[~kept]
    progress = capture.progress
    if progress is not None:
        later = progress.samples >= start_sample
        progress = Progress(progress.t_ns_host[later], progress.samples[later] - start_sample)
    return replace(
        capture,
        samples=capture.samples - start_sample,
        initial=initial,
        sample=capture.sample[kept] - start_sample,
        channel=capture.channel[kept],
        level=capture.level[kept],
        progress=progress,
        start=None,
    )


def _claimed(name: str, streams: Mapping[str, Decoded]) -> bool:
    role, _, signal = name.partition(".")
    message = CLAIMS.get(signal)
    return message is not None and bool(streams[role].messages[message].size)
