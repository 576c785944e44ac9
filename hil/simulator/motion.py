# SPDX-License-Identifier: Apache-2.0
"""What the simulated chips feel: one rigid bar, two chips with errors of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hil.errors import ScenarioError
from hil.motion import motion_file
from hil.motion.bar import GRAVITY_MPS2, Bar
from hil.motion.imu_model import ACCEL_NOISE_UG_RTHZ, GYRO_NOISE_MDPS_RTHZ, chip_errors
from hil.motion.lifts import Lift, named
from hil.scenario import ImuScenario, Motion, Scenario

DEFAULT_ODR_HZ = 417.0
DEFAULT_ACCEL_FS_G = 16


def lift(motion: Motion) -> Lift:
    """The lift that a scenario names.

    Raises:
        ScenarioError: there is none of that name, or it has no way with rests.
    """
    try:
        return named(motion.lift, motion.seed, motion.rests)
    except ValueError as error:
        raise ScenarioError(f"[motion]: {error}") from error


def write(path: Path, scenario: Scenario, role: str) -> None:
    """Write the motion file of the IMU ``role``; the scenario has a motion."""
    motion = scenario.motion
    assert motion is not None
    errors = chip_errors(scenario.seed, role, scenario.node(role).imu.errors)
    motion_file.write(
        path,
        lift(motion).trajectory,
        Bar(),
        role,
        errors=errors,
        start_s=motion.start_s,
        handled_s=motion.handled_s,
    )


def noise(settings: ImuScenario) -> tuple[float, float]:
    """Noise of each sample: m/s^2 and rad/s, rms. White up to half the sample rate."""
    if not settings.noise:
        return 0.0, 0.0
    bandwidth = np.sqrt((settings.odr_hz or DEFAULT_ODR_HZ) / 2.0)
    density = ACCEL_NOISE_UG_RTHZ[settings.accel_fs_g or DEFAULT_ACCEL_FS_G]
    accel_mps2 = density * 1e-6 * GRAVITY_MPS2 * bandwidth
    gyro_radps = np.radians(GYRO_NOISE_MDPS_RTHZ * 1e-3) * bandwidth
    return float(accel_mps2), float(gyro_radps)
