# SPDX-License-Identifier: Apache-2.0
"""The calibration that a node applied, repeated in float32 bit for bit.

Written from docs/calibration.md, section "On the target"; the node's own code is
``firmware/lib/calib/calib_correct.c``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.imu.batches import Batches
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, CLIPPED_LSB, GYRO_RADPS_PER_LSB_PER_DPS
from hil.recording import Recording
from hil.streams import ROLES, frames

COUNT_MAX: Final = 32767
STATUS: Final = ("accel_bias_mps2", "accel_matrix", "gyro_bias_radps")
Counts = NDArray[np.int16]
Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Correction:
    """One calibration at one pair of full scales.

    Attributes:
        accel_bias_lsb, gyro_bias_lsb: float32[3].
        accel_matrix: float32[3, 3].
    """

    accel_bias_lsb: Float32
    accel_matrix: Float32
    gyro_bias_lsb: Float32

    def apply(self, raw: Counts) -> Counts:
        """What the node makes of counts, int16[n, 6], gyro x y z, accel x y z."""
        exact = raw.astype(np.float32)
        c = exact[:, 3:] - self.accel_bias_lsb
        m = self.accel_matrix
        accel = np.stack(
            [(m[i, 0] * c[:, 0] + m[i, 1] * c[:, 1]) + m[i, 2] * c[:, 2] for i in range(3)], axis=1
        )
        corrected = np.concatenate([exact[:, :3] - self.gyro_bias_lsb, accel], axis=1)
        counts = np.rint(np.clip(corrected, -COUNT_MAX, COUNT_MAX)).astype(np.int16)
        # An axis at the end of its range is passed on, so that clipping stays visible.
        return np.where(np.abs(raw.astype(np.int32)) >= CLIPPED_LSB, raw, counts)


def correction(recording: Recording, role: str) -> Correction | None:
    """The one correction of a run; None where nothing was corrected, or not by one and the same.

    A node that was calibrated within the run has several: its samples are then not compared.
    """
    found = in_force(recording, role)
    sent = frames(recording, role, "imu_batch")
    sent = sent[sent["source"] == ROLES.index(role)]
    if found is None or sent.size == 0:
        return None
    accel = np.float32(sent["accel_fs_g"][-1] * ACCEL_MPS2_PER_LSB_PER_G)
    gyro = np.float32(sent["gyro_fs_dps"][-1] * GYRO_RADPS_PER_LSB_PER_DPS)
    return Correction(
        found["accel_bias_mps2"].astype(np.float32) / accel,
        found["accel_matrix"].astype(np.float32).reshape(3, 3),
        found["gyro_bias_radps"].astype(np.float32) / gyro,
    )


def changed(recording: Recording, role: str) -> bool:
    """Whether the node was calibrated, or forgot its calibration, within the run."""
    ready = decided(recording, role)
    return any(np.any(ready[name] != ready[name][-1]) for name in STATUS) if ready.size else False


def decided(recording: Recording, role: str) -> NDArray[Any]:
    """The CAL status frames since the boot check; none where the protocol is older than it."""
    status = frames(recording, role, "cal_status")
    known = "raw" in (status.dtype.names or ())
    return status[status["ready"] == 1] if known else status[:0]


def in_force(recording: Recording, role: str) -> Any | None:
    """The last CAL status since the boot check, when all since then name the same values."""
    ready = decided(recording, role)
    if ready.size == 0 or changed(recording, role):
        return None
    # A node never says so, but a damaged frame may.
    return ready[-1] if all(np.all(np.isfinite(ready[name][-1])) for name in STATUS) else None


def expected_counts(
    b: Batches, of_batch: NDArray[np.int64], raw: Counts, c: Correction | None
) -> Counts:
    """What the stream should hold where the chip measured ``raw``.

    Args:
        of_batch: int64[n], the batch of ``b`` that each row of ``raw`` was streamed in.
    """
    if c is None:
        return raw
    uncorrected = b.has("uncorrected")[of_batch]
    return np.where(uncorrected[:, np.newaxis], raw, c.apply(raw))
