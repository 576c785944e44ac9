# SPDX-License-Identifier: Apache-2.0
"""From accepted poses and a rest of the gyroscope to a calibration, or to a refusal.

The correction is ``a = accel_matrix (raw - accel_bias_mps2)`` and
``w = raw - gyro_bias_radps``. docs/calibration.md, sections 1 to 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.calibration.poses import FACES, Pose
from hil.core import calib
from hil.core.calib import STANDARD_GRAVITY_MPS2, AccelFit
from hil.errors import HilError

FloatArray = NDArray[np.float64]

SCALE_LIMIT: Final = 0.10
"""Relative scale error; the datasheet has 1 % (DS12814, table 2), so 10 % is another fault."""
ACCEL_BIAS_LIMIT_MG: Final = 200.0
"""Per axis; the datasheet has 20 mg."""
GYRO_BIAS_LIMIT_DPS: Final = 20.0
"""Per axis; the datasheet has 1 dps."""
RESIDUAL_LIMIT_MG: Final = 5.0
"""Of one pose: some twenty times what noise and flicker leave of its mean."""
POSE_SIGMA_MG: Final = 0.2
"""Standard error of a pose's mean: 0.1 mg of noise, and the bias wandering between poses."""
GRAVITY_LIMITS_MPS2: Final = (9.76, 9.84)
"""What gravity is anywhere on the Earth's surface, with room."""
FREE_POSES: Final = 9
"""From so many poses on the misalignment is fitted, too."""


class Method(StrEnum):
    """How the accelerometer is solved."""

    LEVEL_FACES = "level_faces"
    """Closed form of six level faces: scale and bias."""
    SQUARE_FIXTURE = "square_fixture"
    """Linear least squares of six faces held square: misalignment to the fixture, too."""
    MAGNITUDE_DIAGONAL = "magnitude_diagonal"
    """Magnitudes of six poses or more: scale and bias, whatever the tilt."""
    MAGNITUDE_SYMMETRIC = "magnitude_symmetric"
    """Magnitudes of nine poses or more: scale, bias and skew of the axes."""


@dataclass(frozen=True, eq=False)
class GyroRest:
    """The gyroscope at rest.

    Attributes:
        bias_radps, bias_sigma_radps: (3,) mean, and its standard error with the bias's wandering.
        n: samples.
        rate_hz: their measured rate.
    """

    bias_radps: FloatArray
    bias_sigma_radps: FloatArray
    n: int
    rate_hz: float


@dataclass(frozen=True, eq=False)
class Calibration:
    """One unit's correction.

    Attributes:
        accel_bias_mps2: (3,) b.
        accel_matrix: (3, 3) M.
        gyro_bias_radps: (3,).
        accel_bias_sigma_mps2, accel_matrix_sigma, gyro_bias_sigma_radps: standard errors.
        residuals_mg: (n,) |M (raw - b)| - g of each pose, in the order given. Six poses have none
            by construction under six unknowns: then they prove nothing.
        method: how the accelerometer was solved.
        gravity_mps2: what it was scaled to.
    """

    accel_bias_mps2: FloatArray
    accel_matrix: FloatArray
    gyro_bias_radps: FloatArray
    accel_bias_sigma_mps2: FloatArray
    accel_matrix_sigma: FloatArray
    gyro_bias_sigma_radps: FloatArray
    residuals_mg: FloatArray
    method: Method
    gravity_mps2: float = STANDARD_GRAVITY_MPS2

    def accel(self, raw_mps2: FloatArray) -> FloatArray:
        """Corrected (n, 3) specific force."""
        return np.asarray((raw_mps2 - self.accel_bias_mps2) @ self.accel_matrix.T)

    def gyro(self, raw_radps: FloatArray) -> FloatArray:
        """Corrected (n, 3) angular rate."""
        return np.asarray(raw_radps - self.gyro_bias_radps)


def gyro_rest(gyro_radps: FloatArray, rate_hz: float) -> GyroRest:
    """Bias from (n, 3) samples of a rest of 60 s or so.

    Raises:
        ValueError: fewer than 8 samples, or one that is not finite.
    """
    axes = [calib.rest(axis, rate_hz) for axis in np.asarray(gyro_radps, np.float64).T]
    return GyroRest(
        np.array([mean for mean, _, _ in axes]),
        np.array([sigma for _, sigma, _ in axes]),
        len(gyro_radps),
        float(rate_hz),
    )


def solve(
    poses: Sequence[Pose],
    gyro: GyroRest,
    *,
    method: Method | None = None,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
) -> Calibration:
    """Solve, and refuse what no sound unit can give.

    Args:
        method: by default the magnitudes: with skew from :data:`FREE_POSES` poses on, without
            below that.
        gravity_mps2: at the place of calibration; see docs/calibration.md, section 2.

    Raises:
        HilError: poses are missing or badly spread, the fit did not settle, or its result is
            physically impossible.
    """
    low, high = GRAVITY_LIMITS_MPS2
    if not low <= gravity_mps2 <= high:
        raise HilError(
            f"gravity of {gravity_mps2:g} m/s^2 is found nowhere on the Earth",
            f"give {low} to {high}; standard gravity is {STANDARD_GRAVITY_MPS2}",
        )
    if method is None:
        many = len(poses) >= FREE_POSES
        method = Method.MAGNITUDE_SYMMETRIC if many else Method.MAGNITUDE_DIAGONAL
    fit = _fit(poses, method, gravity_mps2)
    if fit.status != "converged":
        raise _not_fitted(fit, len(poses))
    mg = gravity_mps2 * 1e-3
    all_means = np.array([pose.mean for pose in poses])
    corrected = np.linalg.norm((all_means - fit.bias_mps2) @ fit.matrix.T, axis=1)
    calibration = Calibration(
        fit.bias_mps2,
        fit.matrix,
        gyro.bias_radps,
        fit.bias_sigma_mps2,
        fit.matrix_sigma,
        gyro.bias_sigma_radps,
        (corrected - gravity_mps2) / mg,
        method,
        gravity_mps2,
    )
    check(calibration)
    return calibration


def check(calibration: Calibration) -> None:
    """Refuse what no sound unit can give.

    Raises:
        HilError: scale, bias, rate or a residual is beyond its limit, or not finite.
    """
    mg = calibration.gravity_mps2 * 1e-3
    numbers = (calibration.accel_bias_mps2, calibration.accel_matrix, calibration.gyro_bias_radps)
    if not all(np.isfinite(x).all() for x in (*numbers, calibration.residuals_mg)):
        raise HilError("the calibration is not finite", _MEND_POSES)
    stretch = np.linalg.svd(calibration.accel_matrix, compute_uv=False)
    scale_off = float(np.abs(1.0 / np.maximum(stretch, 1e-9) - 1.0).max())
    if scale_off > SCALE_LIMIT:
        raise HilError(
            f"the accelerometer's scale is off by {min(scale_off, 9.99):.0%}, "
            f"at most {SCALE_LIMIT:.0%}",
            f"take the faces again; {_MEND_RANGE}",
        )
    bias_mg = np.abs(calibration.accel_bias_mps2) / mg
    if bias_mg.max() > ACCEL_BIAS_LIMIT_MG:
        raise HilError(
            f"the accelerometer's {_axis(bias_mg)} bias is {bias_mg.max():.0f} mg, "
            f"at most {ACCEL_BIAS_LIMIT_MG:g}",
            "take the faces again, each with its own side up\nif it stays, the sensor is damaged",
        )
    gyro_dps = np.degrees(np.abs(calibration.gyro_bias_radps))
    if gyro_dps.max() > GYRO_BIAS_LIMIT_DPS:
        raise HilError(
            f"the gyroscope's {_axis(gyro_dps)} bias is {gyro_dps.max():.1f} dps, "
            f"at most {GYRO_BIAS_LIMIT_DPS:g}",
            "repeat the rest on a table that does not turn\nif it stays, the sensor is damaged",
        )
    worst = int(np.argmax(np.abs(calibration.residuals_mg)))
    residual_mg = float(calibration.residuals_mg[worst])
    # Level faces are an assumption, and tilt shows in the magnitudes: that is no fault of a pose.
    by_magnitude = calibration.method in (Method.MAGNITUDE_DIAGONAL, Method.MAGNITUDE_SYMMETRIC)
    if by_magnitude and abs(residual_mg) > RESIDUAL_LIMIT_MG:
        mend = f"take pose {worst + 1} again, lying still"
        if calibration.method is Method.MAGNITUDE_DIAGONAL:
            mend += f"\nor give {FREE_POSES} poses or more, so that skewed axes are fitted, too"
        raise HilError(
            f"pose {worst + 1} is {residual_mg:+.1f} mg from gravity after the fit, "
            f"at most {RESIDUAL_LIMIT_MG:g}",
            mend,
        )


_MEND_POSES: Final = "take the poses again, each lying still"
_MEND_RANGE: Final = "look at the full scale that the samples were converted with"


def _axis(values: FloatArray) -> str:
    return "xyz"[int(np.argmax(values))]


def _fit(poses: Sequence[Pose], method: Method, gravity_mps2: float) -> AccelFit:
    sigma_mps2 = POSE_SIGMA_MG * 1e-3 * gravity_mps2
    if method in (Method.LEVEL_FACES, Method.SQUARE_FIXTURE):
        by_face = {pose.face: pose for pose in poses if pose.face is not None}
        missing = [face for face in FACES if face not in by_face]
        if missing:
            raise HilError(
                f"faces are missing: {', '.join(missing)}",
                "hold each of these axes up for a pose",
            )
        return calib.fit_faces(
            [by_face[face].mean for face in FACES],
            square=method is Method.SQUARE_FIXTURE,
            gravity_mps2=gravity_mps2,
            sigma_mps2=sigma_mps2,
        )
    return calib.fit_magnitude(
        np.array([pose.mean for pose in poses]).reshape(-1, 3),
        symmetric=method is Method.MAGNITUDE_SYMMETRIC,
        gravity_mps2=gravity_mps2,
        sigma_mps2=sigma_mps2,
    )


def _not_fitted(fit: AccelFit, count: int) -> HilError:
    if fit.status == "too_few_poses":
        return HilError(
            f"{count} poses are too few for this fit",
            f"give the six faces, or {FREE_POSES} poses or more for skewed axes, too",
        )
    if fit.status == "poorly_spread":
        return HilError(
            f"the poses are too alike (condition {fit.condition:.3g}, "
            f"at most {calib.MAX_CONDITION:g})",
            "add poses with other sides up: all six faces, then edges and corners",
        )
    if fit.status == "bad_input":
        return HilError("a pose's mean is zero or not finite", _MEND_POSES)
    return HilError("the fit did not settle", f"{_MEND_POSES}\n{_MEND_RANGE}")
