# SPDX-License-Identifier: Apache-2.0
"""The leader's steps repeated on the host, and its frames held against them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.core import Estimator
from hil.divergence import Divergence
from hil.fusion.inputs import Run

FIELDS: Final[Mapping[str, str]] = {
    "position_m": "p",
    "velocity_mps": "v",
    "quaternion": "q",
    "accel_bias_mps2": "b_a",
    "gyro_bias_radps": "b_g",
    "variance": "variance",
    "innovation": "innovation",
    "nis": "nis",
    "gate": "gate",
    "centre_velocity_mps": "centre_velocity_mps",
    "centre_height_m": "centre_height_m",
}
"""Field of an EKF frame -> field of the core's output."""
BASELINE: Final[Mapping[str, str]] = {
    "quaternion": "q_madgwick",
    "divergence_rad": "divergence_rad",
}
"""The same for an ATTITUDE frame."""


@dataclass(frozen=True)
class Comparison:
    """EKF and ATTITUDE frames against the host's steps.

    Attributes:
        compared: EKF frames that the host has a step for.
        differing: of them, those in which any bit differs.
        unknown: frames of steps that the host does not have.
        first: the first difference, or None.
    """

    compared: int
    differing: int
    unknown: int
    first: Divergence | None


def host_steps(run: Run, dtype: Any = np.float32) -> NDArray[np.void]:
    """Outputs of the core for ``run``."""
    fed = run.samples
    estimator = Estimator(run.params, dtype)
    return estimator.run(fed.leader, fed.follower, fed.arrival).outputs


def compare(host: NDArray[np.void], states: NDArray[Any], baselines: NDArray[Any]) -> Comparison:
    """Bit by bit: frames of one run against the host's outputs in float32."""
    sent, ours = _paired(host, "step", states, "step")
    differs = _differ(sent, ours, FIELDS)
    differs |= sent["flags"] != ours["flags"]
    differs |= sent["t_ticks_leader"].astype(np.int64) != ours["t_ticks"]
    # Each EKF frame has an ATTITUDE frame of the same time.
    attitude, same = _paired(ours, "t_ticks", baselines, "t_ticks_leader")
    wrong = same["step"][_differ(attitude, same, BASELINE)]
    differs |= np.isin(ours["step"], wrong)
    return Comparison(
        compared=len(sent),
        differing=int(np.sum(differs)),
        unknown=len(states) - len(sent),
        first=_first(sent, ours, differs),
    )


def _paired(
    ours: NDArray[Any], our_key: str, sent: NDArray[Any], key: str
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows of ``sent`` that have a row of ``ours`` of the same key, and those rows."""
    if len(ours) == 0:
        return sent[:0], ours
    wanted = sent[key].astype(np.int64)
    at = np.clip(np.searchsorted(ours[our_key], wanted), 0, len(ours) - 1)
    known = ours[our_key][at] == wanted
    return sent[known], ours[at[known]]


def _differ(sent: NDArray[Any], ours: NDArray[Any], names: Mapping[str, str]) -> NDArray[np.bool_]:
    """bool[n]: rows in which any bit of any of these fields differs."""
    differs = np.zeros(len(sent), dtype=bool)
    for theirs, mine in names.items():
        differs |= np.any(_bits(sent[theirs]) != _bits(ours[mine]), axis=1)
    return differs


def _bits(values: NDArray[Any]) -> NDArray[np.int64]:
    """(n, k) bit patterns of float32 values; every NaN is one and the same."""
    width = int(np.prod(values.shape[1:]))
    flat = np.ascontiguousarray(values, dtype=np.float32).reshape(len(values), width)
    bits = flat.view(np.int32).astype(np.int64)
    return np.where(np.isnan(flat), np.int64(0x7FC00000), bits)


def _first(
    sent: NDArray[Any], ours: NDArray[np.void], differs: NDArray[np.bool_]
) -> Divergence | None:
    if not differs.any():
        return None
    row = int(np.argmax(differs))
    step = int(sent["step"][row])
    for f, g in FIELDS.items():
        a = np.atleast_1d(sent[f][row]).astype(np.float32)
        b = np.atleast_1d(ours[g][row]).astype(np.float32)
        apart = np.flatnonzero(_bits(a)[:, 0] != _bits(b)[:, 0])
        if apart.size:
            k = int(apart[0])
            host_bits, target_bits = (int(v[k : k + 1].view(np.uint32)[0]) for v in (b, a))
            return Divergence(step, f"{f}[{k}]", host_bits, target_bits, float(b[k]), float(a[k]))
    return Divergence(step, "flags, time or baseline", 0, 0, float("nan"), float("nan"))
