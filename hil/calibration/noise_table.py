# SPDX-License-Identifier: Apache-2.0
"""A sensor's noise as a table for the terminal."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from hil.calibration.noise import RestNoise


def table(role: str, found: RestNoise) -> Table:
    """White noise, bias instability, and the Allan deviation at three averaging times."""
    shown = Table(
        title=f"{role}: {found.seconds:.0f} s of rest at {found.rate_hz:.1f} Hz",
        title_justify="left",
        caption="Noise density is one-sided, as in datasheets. Instability: - where the rest is "
        "too short to show it.",
        caption_justify="left",
    )
    for heading in ("sensor", "axis", "noise", "", "instability", ""):
        shown.add_column(heading, justify="left" if heading in ("sensor", "axis", "") else "right")
    for sensor, wander in (("accelerometer", found.accel), ("gyroscope", found.gyro)):
        for i, axis in enumerate("xyz"):
            floor = float(wander.instability[i])
            shown.add_row(
                sensor if i == 0 else "",
                axis,
                f"{wander.density[i]:.1f}",
                wander.density_unit,
                f"{floor:.3g}" if floor > 0 and np.isfinite(floor) else "-",
                wander.instability_unit,
            )
    return shown
