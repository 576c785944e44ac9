# SPDX-License-Identifier: Apache-2.0
"""The noise of a recording's sensor at rest: Allan deviation of its longest unbroken stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.calibration.allan import Wander, allan_of
from hil.core.calib import STANDARD_GRAVITY_MPS2
from hil.errors import HilError
from hil.imu.batches import batches
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, GYRO_RADPS_PER_LSB_PER_DPS
from hil.recording import Recording
from hil.streams import ROLES, frames
from hil.wire.messages import TICK_RATE_HZ

SHORTEST_S: Final = 5.0
STILL_STD_DPS: Final = 0.5
STILL_STD_MG: Final = 20.0


@dataclass(frozen=True, eq=False)
class RestNoise:
    """Noise of one unit.

    Attributes:
        seconds: length of the rest.
        rate_hz: measured rate.
    """

    seconds: float
    rate_hz: float
    accel: Wander
    gyro: Wander


def rest_noise(recording: Recording, role: str) -> RestNoise:
    """Noise of ``role``'s sensor, which must have been at rest throughout.

    Raises:
        HilError: too short, or it moved.
    """
    b = batches(recording, role, role)
    sent = frames(recording, role, "imu_batch")
    if len(b) < 2:
        raise HilError(f"the recording holds no samples of the {role}")
    # The boot check's decision shifts the bias: that is a break, too.
    corrected = ~b.has("uncorrected")
    broken = (b.first[1:] != b.end[:-1]) | (corrected[1:] != corrected[:-1])
    breaks = np.flatnonzero(broken) + 1
    begins, ends = np.append(0, breaks), np.append(breaks, len(b))
    longest = int(np.argmax([b.count[i:j].sum() for i, j in zip(begins, ends, strict=True)]))
    rows = slice(int(begins[longest]), int(ends[longest]))
    start = int(b.count[: rows.start].sum())
    counts = b.samples[start : start + int(b.count[rows].sum())].astype(np.float64)
    rate_hz = TICK_RATE_HZ / float(np.median(b.period_ticks[rows]))
    seconds = len(counts) / rate_hz
    if seconds < SHORTEST_S:
        raise HilError(
            f"the longest unbroken stream of the {role} lasts {seconds:.1f} s, "
            f"at least {SHORTEST_S:g} are needed",
            "record a longer rest: an hour shows the bias instability",
        )
    own = sent[sent["source"] == ROLES.index(role)]
    gyro = counts[:, :3] * (float(own["gyro_fs_dps"][-1]) * GYRO_RADPS_PER_LSB_PER_DPS)
    accel = counts[:, 3:] * (float(own["accel_fs_g"][-1]) * ACCEL_MPS2_PER_LSB_PER_G)
    turn_dps, shake_mg = (
        np.degrees(gyro.std(axis=0)).max(),
        accel.std(axis=0).max() / (STANDARD_GRAVITY_MPS2 * 1e-3),
    )
    if turn_dps > STILL_STD_DPS or shake_mg > STILL_STD_MG:
        raise HilError(
            f"the {role} was not at rest: its rate varies by {turn_dps:.2f} dps, its acceleration "
            f"by {shake_mg:.1f} mg",
            "record it lying on a floor, with nobody near",
        )
    return RestNoise(
        seconds, rate_hz, allan_of(accel, rate_hz, "accel"), allan_of(gyro, rate_hz, "gyro")
    )
