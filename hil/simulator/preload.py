# SPDX-License-Identifier: Apache-2.0
"""A calibration in a simulated node's flash, put there as a host does it, before a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hil.bench.port import SerialPort
from hil.build import BabbleSim
from hil.calibration.tool.unit import Unit
from hil.motion.imu_model import ChipErrors, chip_errors
from hil.scenario import Scenario, StoredCalibration
from hil.simulator.arguments import DEVICES, node_seed
from hil.simulator.desk import Desk


def store(
    babblesim: BabbleSim, executable: Path, scenario: Scenario, role: str, flash: Path
) -> None:
    """Start the node alone, have it store its calibration, and leave its flash in ``flash``.

    Raises:
        RigError: the node did not take it.
    """
    node = scenario.node(role)
    assert node.calibration is not None
    errors = chip_errors(scenario.seed, role, node.imu.errors)
    # The chip's identity comes from seed and number: the same as in the run to come.
    seed, number = node_seed(scenario, role), DEVICES.index(role)
    with (
        Desk(babblesim, executable, errors, seed=seed, number=number, flash=flash) as desk,
        SerialPort(desk.port) as port,
    ):
        unit = Unit(port, role)
        unit.connect()
        device_id = int(unit.hello["device_id"])
        unit.write_record({"device_id": device_id, **of_chip(errors, node.calibration)})


def of_chip(errors: ChipErrors, stored: StoredCalibration) -> dict[str, Any]:
    """The record that a perfect calibration of this chip would give, its gyroscope's bias off."""
    gyro = errors.gyro_bias_radps + np.radians(stored.gyro_offset_dps)
    return {
        "created_unix_s": 0,
        "temperature_cdegc": 2500,
        "accel_bias_mps2": np.float32(errors.accel_bias_mps2).tolist(),
        "accel_matrix": np.float32(np.linalg.inv(errors.accel_matrix)).ravel().tolist(),
        "gyro_bias_radps": np.float32(gyro).tolist(),
    }
