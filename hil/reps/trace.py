# SPDX-License-Identifier: Apache-2.0
"""What repetitions are found in: the estimate of the bar's centre over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import RecordingError
from hil.fusion.inputs import runs
from hil.fusion.replay import host_steps
from hil.recording import Recording
from hil.reference.estimator import Flag
from hil.streams import frames
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]

GAP_MAX_S: Final = 0.25
"""A longer pause of the estimate ends a trace: a repetition cannot be told across it."""


@dataclass(frozen=True, eq=False)
class Trace:
    """The estimate of the bar's centre without a gap.

    Attributes:
        t_s: float64[n], increasing, on the leader's clock; the time that the state refers to.
        velocity_z_mps: float64[n], upwards.
        height_m: float64[n], above where the estimate began; it may jump where it is corrected.
        tilt_rad: float64[n], angle of the bar's axis above the horizontal, leader's end up.
        zupt: bool[n], a zero-velocity update was taken.
    """

    t_s: Float
    velocity_z_mps: Float
    height_m: Float
    tilt_rad: Float
    zupt: NDArray[np.bool_]


def of_outputs(outputs: NDArray[Any]) -> list[Trace]:
    """Traces of the core's outputs (:attr:`hil.core.Result.outputs`)."""
    return _traces(outputs, "t_ticks", "q")


def of_recording(recording: Recording) -> list[Trace]:
    """Traces of the leader's EKF frames, or of the host's core where there are none.

    Raises:
        RecordingError: neither frames nor batches of the leader's IMU.
    """
    sent = frames(recording, "leader", "ekf_state")
    if {"centre_velocity_mps", "centre_height_m"} <= set(sent.dtype.names or ()) and sent.size:
        return _traces(sent, "t_ticks_leader", "quaternion")
    try:
        found = [trace for run in runs(recording) for trace in of_outputs(host_steps(run))]
    except ValueError as error:
        raise RecordingError(
            f"the batches in the leader's stream cannot be fed to the estimator: {error}",
            "look at the recording with: hil replay",
        ) from error
    if not found:
        raise RecordingError(
            "the recording has neither EKF frames nor IMU batches of the leader",
            "record with an image that has the estimator: hil build",
        )
    return found


def _traces(rows: NDArray[Any], time: str, attitude: str) -> list[Trace]:
    t_s = rows[time].astype(np.float64) / TICK_RATE_HZ
    velocity = rows["centre_velocity_mps"].astype(np.float64)[:, 2]
    height = rows["centre_height_m"].astype(np.float64).reshape(len(rows))
    w, x, y, z = rows[attitude].astype(np.float64).T
    # Third row, first column of the matrix of q: how much of the bar's axis points upwards.
    tilt = np.arcsin(np.clip(2.0 * (x * z - w * y), -1.0, 1.0))
    zupt = (rows["flags"] & int(Flag.ZUPT)) != 0
    finite = np.isfinite(velocity) & np.isfinite(height) & np.isfinite(tilt)
    step = np.diff(t_s[finite])
    columns = [c[finite] for c in (t_s, velocity, height, tilt, zupt)]
    cuts = np.flatnonzero((step <= 0.0) | (step > GAP_MAX_S)) + 1
    pieces = zip(*(np.split(c, cuts) for c in columns), strict=True)
    return [Trace(*piece) for piece in pieces if len(piece[0]) > 2]
