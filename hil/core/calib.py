# SPDX-License-Identifier: Apache-2.0
"""The calibration maths of ``firmware/lib/calib`` on the host: fits, rests, Allan deviations.

The sensor measures ``raw = S a + b + noise``; the correction is ``a = M (raw - b)``. What the
fits do and when which is right stands in docs/calibration.md, sections 1 to 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.core import _core

STANDARD_GRAVITY_MPS2: Final = 9.80665
MAX_CONDITION: Final[float] = _core.CALIB_MAX_CONDITION
"""Condition number of the pose geometry above which a magnitude fit is refused."""
FLOOR_OF_INSTABILITY: Final[float] = _core.CALIB_FLOOR_OF_INSTABILITY
"""Flat floor of the Allan deviation over bias instability B (IEEE Std 952-1997, annex C)."""

FloatArray = NDArray[np.float64]
Status = Literal["converged", "bad_input", "too_few_poses", "poorly_spread", "not_converged"]


@dataclass(frozen=True, eq=False)
class AccelFit:
    """What a fit found. Only the numbers of a ``converged`` one mean anything.

    Attributes:
        status: how it ended.
        bias_mps2: (3,) b.
        matrix: (3, 3) M.
        bias_sigma_mps2, matrix_sigma: their standard errors.
        covariance: (9, 9) of M_xx M_yy M_zz b_x b_y b_z M_xy M_xz M_yz, b in m/s^2; zero where
            not fitted, and after a closed form.
        residuals_mps2: (n,) |M (raw - b)| - g of each pose; (0,) after a closed form.
        condition: of the pose geometry: 1.4 to 2 for good sets, see :data:`MAX_CONDITION`.
        iterations: of the damped Gauss-Newton.
    """

    status: Status
    bias_mps2: FloatArray
    matrix: FloatArray
    bias_sigma_mps2: FloatArray
    matrix_sigma: FloatArray
    covariance: FloatArray
    residuals_mps2: FloatArray
    condition: float
    iterations: int


@dataclass(frozen=True)
class Noise:
    """sigma^2(tau) = white^2 / tau + floor^2 + walk^2 tau / 3, in the unit of the samples.

    Attributes:
        white: N, unit times sqrt(s). A one-sided density, as datasheets give it, is sqrt(2) N.
        floor: F, the flat floor; bias instability is B = F / 0.664.
        walk: K, unit per sqrt(s).

    A kind of noise that the record is too short to show comes out as zero.
    """

    white: float
    floor: float
    walk: float

    @property
    def instability(self) -> float:
        """B, in the unit of the samples."""
        return self.floor / FLOOR_OF_INSTABILITY


def fit_faces(
    means_mps2: ArrayLike,
    *,
    square: bool = False,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
    sigma_mps2: float = 0.0,
) -> AccelFit:
    """Closed form from six level faces.

    Args:
        means_mps2: (6, 3) means of the faces +x -x +y -y +z -z, by the axis that points up.
        square: all of S, for a unit held square in a fixture; otherwise scale and bias only.
        sigma_mps2: standard error of one mean.

    Raises:
        ValueError: the shape is wrong.
    """
    means = _rows(means_mps2)
    if len(means) != 6:
        raise ValueError(f"{len(means)} faces: give the six, in the order +x -x +y -y +z -z")
    return _accel_fit(_core.calib_fit_faces(square, means, gravity_mps2, sigma_mps2))


def fit_magnitude(
    means_mps2: ArrayLike,
    *,
    symmetric: bool = True,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
    sigma_mps2: float = 0.0,
) -> AccelFit:
    """Least squares of |M (raw - b)| = g over still poses of any orientation.

    Args:
        means_mps2: (n, 3) mean of each pose.
        symmetric: M symmetric (n of 9 or more); otherwise diagonal (n of 6 or more).
        sigma_mps2: standard error of one mean; larger residuals enlarge the standard errors.

    Raises:
        ValueError: the shape is wrong.
    """
    means = _rows(means_mps2)
    return _accel_fit(_core.calib_fit_magnitude(symmetric, means, gravity_mps2, sigma_mps2))


def allan_deviation(y: ArrayLike, rate_hz: float) -> tuple[FloatArray, FloatArray, Noise]:
    """Overlapping Allan deviation of one axis at rest (Riley, NIST SP 1065, section 5.2.4).

    Args:
        y: (n,) evenly spaced samples.

    Returns:
        Averaging times in s, log-spaced up to a quarter of the record; deviations in the unit of
        ``y``; the noise fitted to them.

    Raises:
        ValueError: fewer than 8 samples, a number that is not finite, or an impossible rate.
    """
    taus, deviations, noise = _core.calib_allan(_axis(y, rate_hz), rate_hz)
    return np.array(taus), np.array(deviations), Noise(*noise)


def allan_variance(y: ArrayLike, length: int) -> float:
    """Overlapping Allan variance for averages over ``length`` samples of (n,) ``y``.

    Raises:
        ValueError: ``length`` is below 1 or above n / 2, or ``y`` as for :func:`allan_deviation`.
    """
    return _core.calib_allan_variance(_axis(y, 1.0), length)


def rest(y: ArrayLike, rate_hz: float) -> tuple[float, float, Noise]:
    """Mean of one axis at rest, its standard error and the noise.

    The standard error is the fitted Allan deviation at the length of the rest, so it has the
    bias's own wandering in it and does not fall for ever with more samples.

    Raises:
        ValueError: as for :func:`allan_deviation`.
    """
    mean, sigma, noise = _core.calib_rest(_axis(y, rate_hz), rate_hz)
    return mean, sigma, Noise(*noise)


def _rows(means_mps2: ArrayLike) -> FloatArray:
    means = np.ascontiguousarray(means_mps2, dtype=np.float64)
    if means.ndim != 2 or means.shape[1] != 3:
        raise ValueError(f"means of shape {means.shape}: give (n, 3), one row per pose")
    return means


def _axis(y: ArrayLike, rate_hz: float) -> FloatArray:
    samples = np.ascontiguousarray(y, dtype=np.float64)
    if samples.ndim != 1 or len(samples) < 8:
        raise ValueError(f"samples of shape {samples.shape}: give (n,) with n of 8 or more")
    if not np.isfinite(samples).all():
        raise ValueError("a sample is not finite: leave its record out")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise ValueError(f"a rate of {rate_hz} Hz: give the measured sample rate")
    return samples


def _accel_fit(found: dict[str, Any]) -> AccelFit:
    return AccelFit(
        status=found["status"],
        bias_mps2=np.array(found["bias_mps2"]),
        matrix=np.array(found["matrix"]).reshape(3, 3),
        bias_sigma_mps2=np.array(found["bias_sigma_mps2"]),
        matrix_sigma=np.array(found["matrix_sigma"]).reshape(3, 3),
        covariance=np.array(found["covariance"]).reshape(9, 9),
        residuals_mps2=np.array(found["residuals_mps2"]),
        condition=found["condition"],
        iterations=found["iterations"],
    )
