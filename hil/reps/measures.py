# SPDX-License-Identifier: Apache-2.0
"""The leader's REP frames held against the definition of repetitions; part of the EKF suite."""

from __future__ import annotations

import math

from hil.budget import Conditions, judged
from hil.measure import Measurement
from hil.recording import Recording
from hil.reps.find import repetitions
from hil.reps.online import UNSAID_S, agreement
from hil.reps.trace import of_recording
from hil.streams import frames, table


def measure(recording: Recording, c: Conditions) -> list[Measurement]:
    """Both measurements, of a recording that has EKF frames.

    They are unset where the protocol table has no ``rep``, and the velocities also where nobody
    lifts.
    """
    if "rep" not in table(recording, "leader"):
        how = "the protocol table of the recording has no REP frames: record anew"
        return [judged("ekf.rep_frames_wrong", None, "K8", c, how)]
    sent = frames(recording, "leader", "ekf_state")
    if not sent.size:
        how = "no EKF frame, so nothing to find repetitions in"
        return [judged("ekf.rep_frames_wrong", math.nan, "K8", c, how)]
    traces = of_recording(recording)
    until_s = float(traces[-1].t_s[-1]) - UNSAID_S if traces else 0.0
    held = agreement(
        frames(recording, "leader", "rep"), [repetitions(trace) for trace in traces], until_s
    )
    how = (
        f"the last REP frame of each repetition against hil.reps of the EKF frames: "
        f"{len(held.pairs)} alike in time, {len(held.only_said)} said and not found, "
        f"{len(held.only_found)} found and not said"
    )
    more = f". Differing: {'; '.join(held.differing)}" if held.differing else ""
    return [
        judged("ekf.rep_frames_wrong", float(held.wrong), "K8", c, how + more),
        judged(
            "ekf.rep_velocity_error_mmps",
            held.velocity_error_mps * 1e3 if held.pairs else None,
            "K9",
            c,
            how if held.pairs else f"nobody lifts: {how}",
            details=held.figure_error if held.pairs else None,
        ),
    ]
