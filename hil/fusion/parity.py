# SPDX-License-Identifier: Apache-2.0
"""A run's first seconds through the NumPy reference and through the core, once for all uses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hil.fusion.inputs import Run
from hil.parity import SCALES, first_steps, run_core, run_reference

Float = NDArray[np.float64]

REFERENCE_STEPS: Final = 4000
"""The reference is NumPy, and three hundred times slower than the core: ten seconds are enough to
show a difference, and longer ones are for the unit tests."""

STATES: Final = {
    "p": "position",
    "v": "velocity",
    "q": "attitude",
    "b_a": "accelerometer bias",
    "b_g": "gyroscope bias",
    "variance": "variances",
}
"""Field of an output -> what it is called."""


@dataclass(frozen=True, eq=False)
class Repeated:
    """Outputs of the same steps: core in double, core in float32, reference."""

    double: NDArray[np.void]
    single: NDArray[np.void]
    reference: NDArray[np.void]

    @property
    def comparable(self) -> bool:
        """Whether there is any step, and all three have the same ones."""
        steps = self.reference["step"]
        return len(steps) > 0 and all(
            np.array_equal(one["step"], steps) for one in (self.double, self.single)
        )


_KEPT: WeakKeyDictionary[Run, Repeated] = WeakKeyDictionary()


def repeat(run: Run) -> Repeated:
    """The first :data:`REFERENCE_STEPS` steps of ``run``. Kept for as long as the run lives."""
    if run not in _KEPT:
        cut = first_steps(run.samples, REFERENCE_STEPS)
        _KEPT[run] = Repeated(
            run_core(cut, run.params),
            run_core(cut, run.params, np.float32),
            run_reference(cut, run.params),
        )
    return _KEPT[run]


def state_errors(ours: NDArray[np.void], theirs: NDArray[np.void], name: str) -> Float:
    """float64[k]: largest relative difference of the elements of one state, step by step.

    Relative to the same scale as :func:`hil.parity.relative_errors`, so that the largest of all
    steps is what that one says.
    """
    a, b = (x[name].astype(np.float64).reshape(len(x), -1) for x in (ours, theirs))
    scale = np.maximum(np.abs(b).max(axis=0), SCALES.get(name, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.nan_to_num(np.abs(a - b) / scale, nan=0.0)
    return np.asarray(relative.max(axis=1), dtype=np.float64)
