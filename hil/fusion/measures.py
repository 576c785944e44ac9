# SPDX-License-Identifier: Apache-2.0
"""The EKF suite: the same on target and host, as the reference has it, and true."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hil.budget import Conditions, judged
from hil.core import ESTIMATOR_SHA256
from hil.fusion.inputs import Run, runs
from hil.fusion.parity import repeat
from hil.fusion.replay import compare, host_steps
from hil.fusion.truth import Judged, judge
from hil.measure import Measurement
from hil.parity import attitude_error_rad, relative_errors
from hil.recording import Recording
from hil.streams import frames, table
from hil.timesync.analysis import Sync


def expected(recording: Recording) -> bool:
    """Whether the leader's firmware has an estimator: by the protocol table that it speaks."""
    message = table(recording, "leader").get("ekf_state")
    fields = () if message is None else message.fields
    return recording.provenance.source in ("sim", "bench") and any(
        f.name == "centre_velocity_mps" for f in fields
    )


def measure(recording: Recording, sync: Sync) -> list[Measurement]:
    """All measurements of the EKF suite; none where no estimator ran."""
    if not expected(recording):
        return []
    found = runs(recording)
    c = sync.conditions
    if not found:
        how = "no IMU batch in the leader's stream"
        return [judged("ekf.core_mismatches", math.nan, "K1", c, how)]
    try:
        repeated = [*firmware(recording, found, c), *reference(found[-1], c)]
    except ValueError as error:
        how = f"the batches in the leader's stream cannot be fed to the estimator: {error}"
        repeated = [judged("ekf.core_mismatches", math.nan, "K1", c, how)]
    return [*repeated, *truth(recording, sync, found[-1])]


def firmware(recording: Recording, found: Sequence[Run], c: Conditions) -> list[Measurement]:
    """Frames of the firmware against the host's core in float32, fed the same batches."""
    image = recording.provenance.manifests.get("leader", {})
    if image.get("estimator_sha256", ESTIMATOR_SHA256) != ESTIMATOR_SHA256:
        how = "the image has another estimator than the host's core: record anew to compare"
        return [judged("ekf.core_mismatches", None, "K1", c, how)]
    states = frames(recording, "leader", "ekf_state")
    baselines = frames(recording, "leader", "attitude")
    compared = differing = unknown = 0
    first = None
    for run in found:
        host = host_steps(run)
        inside = (states["offset"] >= run.begin) & (states["offset"] < run.end)
        beside = (baselines["offset"] >= run.begin) & (baselines["offset"] < run.end)
        result = compare(host, states[inside], baselines[beside])
        compared += result.compared
        differing += result.differing
        unknown += result.unknown
        first = first or result.first
    how = (
        f"{compared} EKF frames of {len(found)} starts against the host's core in float32, fed "
        "the batches of the leader's stream in its order; every bit of state, variances, "
        "innovation, flags and baseline counts"
    )
    value = float(differing + unknown) if compared else math.nan
    return [
        judged(
            "ekf.core_mismatches",
            value,
            "K1",
            c,
            how + (f". First difference: {first}" if first else ""),
            details={"differing": differing, "unknown_steps": unknown},
        ),
        judged(
            "ekf.frames_per_step",
            compared / sum(len(run.samples.leader.t_ticks) for run in found),
            "K2",
            c,
            "EKF frames over samples of the leader's IMU",
        ),
    ]


def reference(run: Run, c: Conditions) -> list[Measurement]:
    """The core against the NumPy reference over the run's first seconds."""
    repeated = repeat(run)
    ours, single, theirs = repeated.double, repeated.single, repeated.reference
    how = f"{len(theirs)} steps from the start of the run, the same samples in both"
    if not repeated.comparable:
        how += "; the alignments ended apart, or never"
        return [judged("ekf.reference_error", math.nan, "K3", c, how)]
    # The baseline's step has a fixed length: near its minimum the last bits choose the direction.
    relative = {k: v for k, v in relative_errors(ours, theirs).items() if k != "q_madgwick"}
    velocity = np.abs(single["v"].astype(np.float64) - theirs["v"]).max()
    worst = max(relative, key=lambda name: relative[name])
    return [
        judged(
            "ekf.reference_error",
            relative[worst],
            "K3",
            c,
            f"core in double against the reference: largest relative error, in {worst}; {how}",
            details=relative,
        ),
        judged(
            "ekf.float_velocity_error_mps",
            float(velocity),
            "K4",
            c,
            f"core in float32 against the reference: largest difference of velocity; {how}",
        ),
        judged(
            "ekf.float_attitude_error_deg",
            float(np.degrees(attitude_error_rad(single, theirs).max())),
            "K5",
            c,
            f"core in float32 against the reference: largest angle; {how}",
        ),
    ]


def truth(recording: Recording, sync: Sync, run: Run) -> list[Measurement]:
    """Repetitions and inclination against the simulated bar's; nothing where it is not known."""
    states = frames(recording, "leader", "ekf_state")
    found = judge(recording, sync, states[states["offset"] >= run.begin])
    if found is None:
        return []
    c = sync.conditions
    how = f"{found.t_s.size} EKF frames against the trajectory that the simulated bar followed"
    tilt_deg = np.degrees(found.tilt_error_rad[found.levelled])
    return [
        *repetitions(found, c),
        judged("ekf.false_zupt_frames", float(found.false_zupt), "K6", c, how),
        judged(
            "ekf.inclination_rmse_deg",
            float(np.sqrt(np.mean(tilt_deg**2))) if tilt_deg.size else math.nan,
            "K7",
            c,
            f"angle between estimated and true vertical from the first stillness on; {how}",
        ),
    ]


def repetitions(found: Judged, c: Conditions) -> list[Measurement]:
    """Mean and peak velocity of the concentric phases, causal, against the truth."""
    lines = ("M1", "M2") if found.rests else ("M3", "M4")
    how = f"{len(found.pairs)} concentric phases of the bar's centre, no smoothing"
    mean = np.array([b.mean_mps - a.mean_mps for a, b in found.pairs]) * 1e3
    peak = np.array([b.peak_mps - a.peak_mps for a, b in found.pairs]) * 1e3
    return [
        judged(
            "ekf.mean_velocity_rmse_mmps",
            float(np.sqrt(np.mean(mean**2))) if mean.size else math.nan,
            lines[0],
            c,
            how,
            details={"mean_velocity": _table(found, "mean_mps")},
        ),
        judged(
            "ekf.peak_velocity_rmse_mmps",
            float(np.sqrt(np.mean(peak**2))) if peak.size else math.nan,
            lines[1],
            c,
            how,
            details={"peak_velocity": _table(found, "peak_mps")},
        ),
        judged(
            "ekf.repetitions_wrong",
            float(len(found.missed) + len(found.invented)),
            "K6",
            c,
            f"{len(found.missed)} missed, {len(found.invented)} invented; {how}",
        ),
    ]


def _table(found: Judged, which: str) -> list[dict[str, Any]]:
    """One row per true concentric phase that the estimate has, in order of time."""
    rows = []
    for true, estimated in found.pairs:
        a, b = getattr(true, which) * 1e3, getattr(estimated, which) * 1e3
        rows.append(
            {
                "begins at, s": round(true.t_start_s, 2),
                "true, mm/s": round(a, 1),
                "estimate, mm/s": round(b, 1),
                "error, mm/s": round(b - a, 1),
            }
        )
    return rows
