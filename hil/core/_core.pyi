# SPDX-License-Identifier: Apache-2.0
# What binding.cpp offers. Use hil.core, which checks, names and documents it.
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
