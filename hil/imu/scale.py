# SPDX-License-Identifier: Apache-2.0
"""Counts of the LSM6DSOX in SI units, with the chip's nominal scale (DS12814, table 2)."""

from __future__ import annotations

from typing import Final

import numpy as np

ACCEL_MPS2_PER_LSB_PER_G: Final = 3.05e-5 * 9.80665
GYRO_RADPS_PER_LSB_PER_DPS: Final = 3.5e-5 * (np.pi / 180.0)
"""30.5 ug and 35 udps a count, per unit of full scale."""
CLIPPED_LSB: Final = 32700
"""A saturated axis rests a little below the end of the 16 bits."""
