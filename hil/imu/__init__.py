# SPDX-License-Identifier: Apache-2.0
"""The IMU streams of a recording: FIFO throughput, rate, gaps, delivery to the leader."""

from hil.imu.measures import measure
from hil.imu.series import series

__all__ = ["measure", "series"]
