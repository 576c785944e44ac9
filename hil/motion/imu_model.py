# SPDX-License-Identifier: Apache-2.0
"""What an LSM6DSOX puts out on an ideal motion: noise, errors, range and counts.

Figures are ST's typical ones (LSM6DSOX datasheet DS12814, table 2, high-performance mode).
The errors of :class:`ErrorSpread` default to what is left after a six-position calibration and
a boot-time gyroscope bias; ``UNCALIBRATED`` is the part as it comes off the reel.

Each sample is the instantaneous ideal value plus errors. The chip's own anti-alias filter is
not modelled: below 100 Hz it is flat, and its delay is a property of the driver's time stamp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.motion.bar import GRAVITY_MPS2, Bar, Trajectory, at_point
from hil.motion.curves import FloatArray
from hil.recording import ClockModel

ACCEL_LSB_G = {2: 0.061e-3, 4: 0.122e-3, 8: 0.244e-3, 16: 0.488e-3}
GYRO_LSB_DPS = {125: 4.375e-3, 250: 8.75e-3, 500: 17.5e-3, 1000: 35e-3, 2000: 70e-3}
ACCEL_NOISE_UG_RTHZ = {2: 70.0, 4: 75.0, 8: 80.0, 16: 110.0}
GYRO_NOISE_MDPS_RTHZ = 3.8


@dataclass(frozen=True)
class ImuConfig:
    """How the chip is set up.

    ``odr_error`` is the chip's own relative rate error: ST's logs run 6.8 % slow.
    """

    odr_hz: float = 416.0
    odr_error: float = 0.0
    accel_fs_g: int = 16
    gyro_fs_dps: int = 2000

    def __post_init__(self) -> None:
        if self.accel_fs_g not in ACCEL_LSB_G:
            raise ValueError(f"no full scale of {self.accel_fs_g} g: choose {list(ACCEL_LSB_G)}")
        if self.gyro_fs_dps not in GYRO_LSB_DPS:
            raise ValueError(
                f"no full scale of {self.gyro_fs_dps} dps: choose {list(GYRO_LSB_DPS)}"
            )

    @property
    def rate_hz(self) -> float:
        """True sample rate."""
        return self.odr_hz * (1.0 + self.odr_error)

    @property
    def accel_lsb_mps2(self) -> float:
        return ACCEL_LSB_G[self.accel_fs_g] * GRAVITY_MPS2

    @property
    def gyro_lsb_radps(self) -> float:
        return float(np.radians(GYRO_LSB_DPS[self.gyro_fs_dps]))


@dataclass(frozen=True)
class ErrorSpread:
    """Standard deviations from which one chip's errors are drawn, per axis.

    Attributes:
        accel_bias_mps2, gyro_bias_radps: turn-on bias.
        accel_walk_mps2_rts, gyro_walk_radps_rts: bias random walk per square root of second.
        accel_scale, gyro_scale: relative scale error.
        accel_misalign_rad, gyro_misalign_rad: small rotations and skews of the axes.
        accel_noise_mps2_rthz, gyro_noise_radps_rthz: one-sided white noise density; ``None``
            takes the datasheet's value for the full scale.
    """

    accel_bias_mps2: float = 0.01
    gyro_bias_radps: float = float(np.radians(0.1))
    accel_walk_mps2_rts: float = 1e-4
    gyro_walk_radps_rts: float = 2e-6
    accel_scale: float = 1e-3
    gyro_scale: float = 1e-3
    accel_misalign_rad: float = 1e-3
    gyro_misalign_rad: float = 1e-3
    accel_noise_mps2_rthz: float | None = None
    gyro_noise_radps_rthz: float | None = None


CALIBRATED = ErrorSpread()
UNCALIBRATED = ErrorSpread(
    accel_bias_mps2=0.2,
    gyro_bias_radps=float(np.radians(1.0)),
    accel_scale=1e-2,
    gyro_scale=1e-2,
    accel_misalign_rad=1e-2,
    gyro_misalign_rad=1e-2,
)
IDEAL = ErrorSpread(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
POPULATIONS = {"ideal": IDEAL, "calibrated": CALIBRATED, "uncalibrated": UNCALIBRATED}


@dataclass(frozen=True)
class ChipErrors:
    """One chip's errors: measured = matrix @ true + bias + walk + noise."""

    accel_bias_mps2: FloatArray
    gyro_bias_radps: FloatArray
    accel_matrix: FloatArray
    gyro_matrix: FloatArray
    spread: ErrorSpread


@dataclass(frozen=True)
class ImuStream:
    """n samples of one IMU.

    Attributes:
        t_true_s: (n,) when the sample was taken.
        t_node_s: (n,) the same instants on the node's clock.
        accel_lsb, gyro_lsb: (n, 3) int16, sensor frame, as the chip's FIFO holds them.
        accel_mps2, gyro_radps: (n, 3) the counts in SI units.
        clipped: (n,) True where any axis of either sensor is at the end of its range.
        accel_bias_mps2, gyro_bias_radps: (n, 3) true bias at each sample, walk included.
    """

    t_true_s: FloatArray
    t_node_s: FloatArray
    accel_lsb: NDArray[np.int16]
    gyro_lsb: NDArray[np.int16]
    accel_mps2: FloatArray
    gyro_radps: FloatArray
    clipped: NDArray[np.bool_]
    accel_bias_mps2: FloatArray
    gyro_bias_radps: FloatArray


def draw_errors(rng: np.random.Generator, spread: ErrorSpread = CALIBRATED) -> ChipErrors:
    """One chip from the population."""

    def matrix(scale: float, misalign: float) -> FloatArray:
        m = np.eye(3) + misalign * rng.standard_normal((3, 3))
        m[np.diag_indices(3)] = 1.0 + scale * rng.standard_normal(3)
        return m

    return ChipErrors(
        spread.accel_bias_mps2 * rng.standard_normal(3),
        spread.gyro_bias_radps * rng.standard_normal(3),
        matrix(spread.accel_scale, spread.accel_misalign_rad),
        matrix(spread.gyro_scale, spread.gyro_misalign_rad),
        spread,
    )


def chip_errors(seed: int, role: str, population: str) -> ChipErrors:
    """The errors of one simulated chip: the same for the same seed, role and population."""
    rng = np.random.default_rng([seed, sorted(Bar().mounts).index(role)])
    return draw_errors(rng, POPULATIONS[population])


def measure(
    specific_force_mps2: FloatArray,
    rate_radps: FloatArray,
    t_true_s: FloatArray,
    *,
    config: ImuConfig,
    errors: ChipErrors,
    rng: np.random.Generator,
    clock: ClockModel | None = None,
) -> ImuStream:
    """Put an ideal motion, (n, 3) each in the sensor frame, through one chip."""
    s = errors.spread
    accel_density = s.accel_noise_mps2_rthz
    if accel_density is None:
        accel_density = ACCEL_NOISE_UG_RTHZ[config.accel_fs_g] * 1e-6 * GRAVITY_MPS2
    gyro_density = s.gyro_noise_radps_rthz
    if gyro_density is None:
        gyro_density = float(np.radians(GYRO_NOISE_MDPS_RTHZ * 1e-3))
    n, dt = len(t_true_s), 1.0 / config.rate_hz
    # A one-sided density over the Nyquist band: variance = density^2 * rate / 2.
    bandwidth = np.sqrt(config.rate_hz / 2.0)

    def walk(step: float) -> FloatArray:
        return np.cumsum(step * np.sqrt(dt) * rng.standard_normal((n, 3)), axis=0)

    accel_bias = errors.accel_bias_mps2 + walk(s.accel_walk_mps2_rts)
    gyro_bias = errors.gyro_bias_radps + walk(s.gyro_walk_radps_rts)
    accel = specific_force_mps2 @ errors.accel_matrix.T + accel_bias
    accel = accel + accel_density * bandwidth * rng.standard_normal((n, 3))
    gyro = rate_radps @ errors.gyro_matrix.T + gyro_bias
    gyro = gyro + gyro_density * bandwidth * rng.standard_normal((n, 3))
    accel_lsb, gyro_lsb = (
        np.clip(np.rint(x / lsb), -32768, 32767).astype(np.int16)
        for x, lsb in ((accel, config.accel_lsb_mps2), (gyro, config.gyro_lsb_radps))
    )
    clipped = is_clipped(accel_lsb, gyro_lsb)
    return ImuStream(
        t_true_s,
        (clock or ClockModel()).local_us(t_true_s * 1e6) * 1e-6,
        accel_lsb,
        gyro_lsb,
        accel_lsb * config.accel_lsb_mps2,
        gyro_lsb * config.gyro_lsb_radps,
        clipped,
        accel_bias,
        gyro_bias,
    )


def is_clipped(accel_lsb: NDArray[np.int16], gyro_lsb: NDArray[np.int16]) -> NDArray[np.bool_]:
    """(n,) True where any of the six counts is within 0.1 % of the end of its range."""
    limit = 32735
    low, high = np.minimum(accel_lsb, gyro_lsb), np.maximum(accel_lsb, gyro_lsb)
    clipped: NDArray[np.bool_] = np.any((low <= -limit) | (high >= limit), axis=1)
    return clipped


def sample(
    trajectory: Trajectory,
    bar: Bar,
    role: str,
    seed: int,
    *,
    config: ImuConfig | None = None,
    spread: ErrorSpread = CALIBRATED,
    clock: ClockModel | None = None,
    t_first_s: float = 0.0,
) -> ImuStream:
    """The stream of the IMU ``role`` (a key of ``bar.mounts``) over a whole trajectory.

    Seeds separate chips: the same seed and role give the same chip and the same noise.

    Raises:
        ValueError: ``role`` is no mount of this bar.
    """
    if role not in bar.mounts:
        raise ValueError(f"the bar has no IMU '{role}': mounts are {', '.join(bar.mounts)}")
    config = config or ImuConfig()
    rng = np.random.default_rng([seed, sorted(bar.mounts).index(role)])
    errors = draw_errors(rng, spread)
    n = int((trajectory.duration_s - t_first_s) * config.rate_hz)
    t = t_first_s + np.arange(n) / config.rate_hz
    ideal = at_point(trajectory(t), bar.mounts[role])
    return measure(
        ideal.specific_force_mps2,
        ideal.rate_radps,
        t,
        config=config,
        errors=errors,
        rng=rng,
        clock=clock,
    )
