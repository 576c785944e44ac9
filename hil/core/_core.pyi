# SPDX-License-Identifier: Apache-2.0
# What binding.cpp, calib_binding.cpp and reps_binding.cpp offer. Use hil.core, hil.core.calib and
# hil.core.reps, which check, name and document it.
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

TICKS_PER_S: int
ESTIMATOR_SHA256: str
MAX_FOLLOWER_SAMPLES: int

def default_params() -> dict[str, bool | int | float | list[float]]: ...

class Estimator64:
    record_bytes: int
    state_bytes: int
    def __init__(self, params: dict[str, Any]) -> None: ...
    def run(
        self,
        t_ticks: NDArray[np.int64],
        accel_mps2: NDArray[np.float64],
        gyro_radps: NDArray[np.float64],
        clipped: NDArray[np.bool_],
        t_sigma_s: NDArray[np.float64],
        t_ticks_f: NDArray[np.int64],
        accel_f: NDArray[np.float64],
        gyro_f: NDArray[np.float64],
        clipped_f: NDArray[np.bool_],
        t_sigma_f: NDArray[np.float64],
        arrival: NDArray[np.int64],
        covariances: bool,
        /,
    ) -> tuple[NDArray[np.uint8], NDArray[np.floating[Any]]]: ...
    def nav(self) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]: ...
    def set_nav(self, row: NDArray[np.float64], covariance: NDArray[np.float64], /) -> None: ...
    def copy(self) -> Self: ...
    def prefilter(self) -> tuple[float, float, float, float, float, float]: ...
    @staticmethod
    def layout() -> list[tuple[str, str, int, int]]: ...

class Estimator32(Estimator64): ...

CALIB_MAX_CONDITION: float
CALIB_FLOOR_OF_INSTABILITY: float

def calib_fit_faces(
    square: bool, means_mps2: NDArray[np.float64], gravity_mps2: float, sigma_mps2: float
) -> dict[str, Any]: ...
def calib_fit_magnitude(
    symmetric: bool, means_mps2: NDArray[np.float64], gravity_mps2: float, sigma_mps2: float
) -> dict[str, Any]: ...
def calib_allan(
    y: NDArray[np.float64], rate_hz: float
) -> tuple[list[float], list[float], tuple[float, float, float]]: ...
def calib_allan_variance(y: NDArray[np.float64], length: int) -> float: ...
def calib_rest(
    y: NDArray[np.float64], rate_hz: float
) -> tuple[float, float, tuple[float, float, float]]: ...

REPS_KEPT: int
REPS_STILL: int
REPS_FOLLOWER_LOST: int
REPS_CLIPPED: int

class Reps:
    def __init__(self) -> None: ...
    def push(
        self,
        t_ticks: NDArray[np.int64],
        velocity_z_mps: NDArray[np.float32],
        height_m: NDArray[np.float32],
        tilt_rad: NDArray[np.float32],
        flags: NDArray[np.uint8],
    ) -> tuple[list[int], bytes]: ...
    def end(self) -> tuple[list[int], bytes]: ...
