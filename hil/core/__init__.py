# SPDX-License-Identifier: Apache-2.0
"""The firmware's estimator (``firmware/lib/estimator``, C++) on the host, in float or double.

The whole loop over a recording runs in C++::

    estimator = Estimator(Params(rate_hz=416.0))
    result = estimator.run(leader, follower, arrival)
    result.outputs["centre_velocity_mps"]        # (k, 3)

Only conversion and argument checks happen here. What the numbers mean stands in
docs/estimator.md; the same algorithms for the reader are in :mod:`hil.reference`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.core import _core
from hil.reference.params import Params

TICKS_PER_S = _core.TICKS_PER_S
"""Ticks of the leader's clock in a second."""
ESTIMATOR_SHA256 = _core.ESTIMATOR_SHA256
"""Hash of the sources that this core was built from."""
MAX_FOLLOWER_SAMPLES = _core.MAX_FOLLOWER_SAMPLES
"""Most follower samples that may ride on one step."""

FloatArray = NDArray[np.float64]
Columns = tuple[NDArray[np.int64], FloatArray, FloatArray, NDArray[np.bool_], FloatArray]
"""Times, forces, rates, clip flags and time uncertainties: see :class:`Samples`."""


def ticks(t_s: FloatArray) -> NDArray[np.int64]:
    """Seconds to ticks of the leader's clock, to the nearest: at most 31.25 ns off."""
    return np.rint(np.asarray(t_s, dtype=np.float64) * TICKS_PER_S).astype(np.int64)


def seconds(t_ticks: NDArray[np.int64]) -> FloatArray:
    """Ticks of the leader's clock to seconds."""
    return np.asarray(t_ticks) / float(TICKS_PER_S)


@dataclass(frozen=True)
class Samples:
    """n samples of one IMU in SI units, sensor frame, oldest first.

    Attributes:
        t_ticks: (n,) sample times on the leader's clock.
        accel_mps2, gyro_radps: (n, 3).
        clipped: (n,) any axis at the end of its range; none if left out.
        t_sigma_s: (n,) standard deviation of ``t_ticks`` against the leader's clock (follower
            only); zero if left out.
    """

    t_ticks: NDArray[np.int64]
    accel_mps2: FloatArray
    gyro_radps: FloatArray
    clipped: NDArray[np.bool_] | None = None
    t_sigma_s: FloatArray | None = None

    def columns(self) -> Columns:
        """The arrays as the core takes them, in the order of the attributes.

        Raises:
            ValueError: times are not integers, or an array has the wrong shape.
        """
        t = np.asarray(self.t_ticks)
        if t.ndim != 1 or (t.size and not np.issubdtype(t.dtype, np.integer)):
            raise ValueError(
                f"t_ticks is {t.dtype} of shape {t.shape}: give (n,) integers, see hil.core.ticks"
            )
        n = len(t)
        clipped = np.zeros(n, np.bool_) if self.clipped is None else self.clipped
        t_sigma_s = np.zeros(n) if self.t_sigma_s is None else self.t_sigma_s
        columns = (
            np.ascontiguousarray(t, dtype=np.int64),
            np.ascontiguousarray(self.accel_mps2, dtype=np.float64),
            np.ascontiguousarray(self.gyro_radps, dtype=np.float64),
            np.ascontiguousarray(clipped, dtype=np.bool_),
            np.ascontiguousarray(t_sigma_s, dtype=np.float64),
        )
        shapes: tuple[tuple[int, ...], ...] = ((n,), (n, 3), (n, 3), (n,), (n,))
        for attribute, array, wanted in zip(fields(self), columns, shapes, strict=True):
            if array.shape != wanted:
                raise ValueError(
                    f"{attribute.name} has shape {array.shape}, its {n} times need {wanted}: "
                    "give one row per sample"
                )
        return columns


NOTHING = Samples(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
"""No samples: a follower that never speaks."""


@dataclass(frozen=True)
class Nav:
    """The navigation state; frames and units as in docs/estimator.md, section 1.

    Attributes:
        covariance: (15, 15), of the error state (dp, dv, dtheta, db_a, db_g).
    """

    p: FloatArray = field(default_factory=lambda: np.zeros(3))
    v: FloatArray = field(default_factory=lambda: np.zeros(3))
    q: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    b_a: FloatArray = field(default_factory=lambda: np.zeros(3))
    b_g: FloatArray = field(default_factory=lambda: np.zeros(3))
    covariance: FloatArray = field(default_factory=lambda: np.zeros((15, 15)))


@dataclass(frozen=True)
class Result:
    """What a run gave.

    Attributes:
        outputs: (k,) structured, one row per leader step from the end of the alignment on. Fields:
            ``t_ticks`` (time the state refers to), ``step`` (index of the leader sample), ``p``
            ``v`` ``b_a`` ``b_g`` (3), ``q`` (4), ``variance`` (15), ``centre_velocity_mps`` (3),
            ``centre_height_m``, ``innovation`` (3), ``nis``, ``gate``, ``q_madgwick`` (4),
            ``divergence_rad``, ``flags`` (bits of :class:`hil.reference.estimator.Flag`).
        covariances: (k, 15, 15) after each of these steps, or (0, 15, 15) when not asked for.
    """

    outputs: NDArray[np.void]
    covariances: NDArray[np.floating[Any]]

    @property
    def t_s(self) -> FloatArray:
        """(k,) time that each output refers to."""
        return seconds(self.outputs["t_ticks"])


class Estimator:
    """The estimator with its state. ``dtype`` float32 is the firmware's own arithmetic."""

    def __init__(self, params: Params | None = None, dtype: Any = np.float64) -> None:
        """
        Raises:
            ValueError: a parameter is impossible, or ``dtype`` is neither float32 nor float64.
        """
        kinds = {np.dtype(np.float32): _core.Estimator32, np.dtype(np.float64): _core.Estimator64}
        if np.dtype(dtype) not in kinds:
            raise ValueError(f"dtype {np.dtype(dtype)}: the core runs in float32 or float64")
        self.params = params or Params()
        self._core: _core.Estimator64 = kinds[np.dtype(dtype)](as_dict(self.params))

    def run(
        self,
        leader: Samples,
        follower: Samples = NOTHING,
        arrival: NDArray[np.int64] | None = None,
        *,
        covariances: bool = False,
    ) -> Result:
        """Step through a batch; another call goes on where this one ended.

        Args:
            leader: in order of time.
            follower: in order of arrival.
            arrival: for each follower sample, the index of the leader sample on whose step it is
                in; see :func:`arrivals`. Needed as soon as there are follower samples.
            covariances: also return P after every step.

        Raises:
            ValueError: an array does not fit, or a leader sample was refused; then the state is
                that after the sample before.
        """
        if arrival is None:
            if len(follower.t_ticks):
                raise ValueError("follower samples without arrival: see hil.core.arrivals")
            arrival = np.zeros(0, np.int64)
        rides = np.ascontiguousarray(arrival, dtype=np.int64)
        rows, matrices = self._core.run(*leader.columns(), *follower.columns(), rides, covariances)
        return Result(rows.view(self.dtype)[:, 0], matrices)

    def step(self, leader: Samples, follower: Samples = NOTHING) -> NDArray[np.void] | None:
        """One leader sample, ``leader`` of length 1, and the follower samples that have arrived.

        Returns:
            One row of :attr:`Result.outputs`, or ``None`` while aligning.

        Raises:
            ValueError: as for :meth:`run`, or more than one leader sample.
        """
        if len(leader.t_ticks) != 1:
            raise ValueError(f"{len(leader.t_ticks)} leader samples in one step: use run")
        arrival = np.zeros(len(follower.t_ticks), np.int64)
        outputs = self.run(leader, follower, arrival).outputs
        return outputs[0] if len(outputs) else None

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Of one output row."""
        layout = self._core.layout()
        return np.dtype(
            {
                "names": [name for name, _, _, _ in layout],
                "formats": [f if n == 1 else (f, (n,)) for _, f, n, _ in layout],
                "offsets": [offset for _, _, _, offset in layout],
                "itemsize": self._core.record_bytes,
            }
        )

    @property
    def nav(self) -> Nav:
        """A copy of the navigation state; assign to set it."""
        row, covariance = (np.asarray(x, np.float64) for x in self._core.nav())
        return Nav(row[0:3], row[3:6], row[6:10], row[10:13], row[13:16], covariance)

    @nav.setter
    def nav(self, nav: Nav) -> None:
        row = np.concatenate([nav.p, nav.v, nav.q, nav.b_a, nav.b_g]).astype(np.float64)
        covariance = np.ascontiguousarray(nav.covariance, dtype=np.float64)
        if row.shape != (16,) or covariance.shape != (15, 15):
            raise ValueError("nav needs p, v, b_a, b_g of 3, q of 4 and a 15 x 15 covariance")
        if not (np.isfinite(row).all() and np.isfinite(covariance).all()):
            raise ValueError("nav is not finite: give finite numbers")
        self._core.set_nav(row, covariance)

    @property
    def butterworth(self) -> tuple[float, float, float, float, float, float]:
        """b0, b1, b2, a1, a2 of the Butterworth prefilter; the delay of the chosen one, samples."""
        return self._core.prefilter()

    @property
    def state_bytes(self) -> int:
        """Memory of parameters, coefficients and state together, on this host."""
        return self._core.state_bytes

    def copy(self) -> Estimator:
        """Another estimator in the same state; neither sees the other's further steps."""
        other = object.__new__(Estimator)
        other.params, other._core = self.params, self._core.copy()
        return other


def arrivals(
    t_leader_ticks: NDArray[np.int64], t_arrival_ticks: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(m,) index of the first leader step at or after each arrival.

    Args:
        t_leader_ticks: (n,) increasing.
        t_arrival_ticks: (m,) when each follower sample is in the leader's hands, never falling.
            Arrivals after the last step must be left out: the core refuses index n.
    """
    return np.searchsorted(t_leader_ticks, t_arrival_ticks).astype(np.int64)


def as_dict(params: Params) -> dict[str, Any]:
    """Parameters by name, as the core takes them: vectors and matrices as flat lists."""
    values = {f.name: getattr(params, f.name) for f in fields(params)}
    return {
        name: value.ravel().tolist() if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    }


def default_params() -> dict[str, Any]:
    """Defaults of the C++ side, in the form of :func:`as_dict`."""
    return _core.default_params()
