# SPDX-License-Identifier: Apache-2.0
"""What of the calibration is worth looking at: the bias in force, before and after the check."""

from __future__ import annotations

import numpy as np

from hil.calibration.measures import expected
from hil.recording import Recording
from hil.series import Series
from hil.streams import ROLES, frames, seen_t_ns_bench


def series(recording: Recording) -> list[Series]:
    """The gyroscope bias that each node subtracts, axis by axis."""
    return [found for role in ROLES if expected(recording, role) for found in bias(recording, role)]


def bias(recording: Recording, role: str) -> list[Series]:
    """Three traces over the node's CAL frames."""
    sent = frames(recording, role, "cal_status")
    if sent.size == 0:
        return []
    seen_s = np.maximum.accumulate(seen_t_ns_bench(recording, role, sent)) / 1e9
    dps = np.degrees(sent["gyro_bias_radps"].astype(np.float64))
    return [
        Series(
            name=f"cal.{role}.bias_{axis}",
            title=axis,
            x_unit="s",
            y_unit="dps",
            x=seen_s,
            y=dps[:, k],
            clock="bench",
            y_label="gyroscope bias in force",
            plot=f"cal.{role}.bias",
            plot_title=f"Bias in force, {role}",
            check=f"cal.{role}.branch_wrong",
            caption="What the node subtracts from its gyroscope: the stored record, and from the "
            "boot check's decision on what the check found, unless it refused. The decisions are "
            "a table under the check.",
        )
        for k, axis in enumerate("xyz")
    ]
