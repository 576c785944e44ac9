# SPDX-License-Identifier: Apache-2.0
"""What of the estimate is worth looking at."""

from __future__ import annotations

import numpy as np

from hil.fusion.inputs import runs
from hil.fusion.truth import judge
from hil.recording import Recording
from hil.series import Series
from hil.streams import frames
from hil.timesync.analysis import Sync


def series(recording: Recording, sync: Sync) -> list[Series]:
    """Vertical velocity of the bar's centre beside the truth; errors of velocity and attitude."""
    states = frames(recording, "leader", "ekf_state")
    found = runs(recording)
    if states.size == 0 or not found or "centre_velocity_mps" not in (states.dtype.names or ()):
        return []
    judged = judge(recording, sync, states[states["offset"] >= found[-1].begin])
    if judged is None or judged.t_s.size == 0:
        return []
    error_mmps = (judged.velocity_z_mps - judged.true_velocity_z_mps) * 1e3
    traces = [
        ("estimate", judged.velocity_z_mps),
        ("truth", judged.true_velocity_z_mps),
    ]
    return [
        *(
            Series(
                name=f"ekf.velocity_{title}",
                title=title,
                x_unit="s",
                y_unit="m/s",
                x=judged.t_s,
                y=values,
                clock="bench",
                x_label="time since the lift began",
                y_label="vertical velocity",
                plot="ekf.velocity",
                plot_title="Vertical velocity of the bar's centre",
                check="ekf.peak_velocity_rmse_mmps",
                caption="EKF frames of the leader, causal, at the times that they refer to; truth "
                "is the trajectory that the simulated bar followed.",
            )
            for title, values in traces
        ),
        Series(
            name="ekf.velocity_error",
            title="velocity error",
            x_unit="s",
            y_unit="mm/s",
            x=judged.t_s,
            y=error_mmps,
            clock="bench",
            x_label="time since the lift began",
            y_label="estimate less truth",
            check="ekf.mean_velocity_rmse_mmps",
            caption="Error of the vertical velocity of the bar's centre.",
        ),
        Series(
            name="ekf.tilt_error",
            title="inclination error",
            x_unit="s",
            y_unit="deg",
            x=judged.t_s,
            y=np.degrees(judged.tilt_error_rad),
            clock="bench",
            x_label="time since the lift began",
            y_label="angle to the true vertical",
            check="ekf.inclination_rmse_deg",
            caption="Angle between the estimated and the true vertical.",
        ),
    ]
