# SPDX-License-Identifier: Apache-2.0
"""The IMU streams of a recording: rate, gaps, sample times, delivery to the leader; the FIFO."""

from hil.imu.fifo import measure as measure_fifo
from hil.imu.measures import measure
from hil.imu.series import series

__all__ = ["measure", "measure_fifo", "series"]
