# SPDX-License-Identifier: Apache-2.0
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Layout = tuple[int, int, int, int, int, int]

def take_apart(
    data: NDArray[np.uint8], layouts: Sequence[Layout]
) -> tuple[
    NDArray[np.int64],
    NDArray[np.int64],
    NDArray[np.int32],
    int,
    int,
    int,
    int,
    int,
    list[tuple[NDArray[np.uint8], NDArray[np.uint8]]],
]: ...
