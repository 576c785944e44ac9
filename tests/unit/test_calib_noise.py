# SPDX-License-Identifier: Apache-2.0
"""``hil noise``: the densities that a simulated chip was given come out, and motion is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil.calibration.noise import rest_noise
from hil.errors import HilError
from hil.motion.imu_model import ACCEL_LSB_G, ACCEL_NOISE_UG_RTHZ, GYRO_LSB_DPS
from hil.motion.imu_model import GYRO_NOISE_MDPS_RTHZ as GYRO
from hil.recording import Recording, load

RECORDINGS = Path(__file__).parents[2] / "fixtures/recordings"
NOMINAL_HZ = 417.0


@pytest.fixture(scope="module")
def still() -> Recording:
    return load(RECORDINGS / "cal-boot/recording.mcap")


def density(chip: float, lsb: float, rate_hz: float) -> float:
    """What must be seen: noise made for the nominal rate, and the rounding of counts."""
    variance = chip**2 * NOMINAL_HZ / 2.0 + lsb**2 / 12.0
    return float(np.sqrt(variance / (rate_hz / 2.0)))


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_densities_are_the_simulated_chips(still: Recording, role: str) -> None:
    found = rest_noise(still, role)
    accel = density(ACCEL_NOISE_UG_RTHZ[16], 1e6 * ACCEL_LSB_G[16], found.rate_hz)
    gyro = density(GYRO, 1e3 * GYRO_LSB_DPS[2000], found.rate_hz)
    # Some four thousand samples: the density is known to 2 %.
    np.testing.assert_allclose(found.accel.density, accel, rtol=0.07)
    np.testing.assert_allclose(found.gyro.density, gyro, rtol=0.07)


def test_the_step_of_the_boot_check_is_no_noise(still: Recording) -> None:
    """The follower's bias changes by 0.8 dps when it is decided: never within what is looked at."""
    assert rest_noise(still, "follower").seconds < 19.5


def test_a_lift_is_no_rest() -> None:
    with pytest.raises(HilError, match="was not at rest"):
        rest_noise(load(RECORDINGS / "clean-7ms5/recording.mcap"), "leader")
