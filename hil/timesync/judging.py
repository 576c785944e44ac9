# SPDX-License-Identifier: Apache-2.0
"""What the sync measurements share: spreads, and what to say when there is nothing to measure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.budget import judged
from hil.measure import Measurement
from hil.timesync.analysis import Sync

Float = NDArray[np.float64]


def absent(sync: Sync, what: str) -> tuple[float | None, str]:
    """Value and reason for a measure that needs the truth or ``what``, and has it not."""
    if not sync.truth:
        return (math.nan if sync.truth.due else None), f"not measured: {sync.truth.why}"
    return math.nan, f"nothing to measure: {what}"


def spread(error: Float) -> dict[str, float]:
    magnitude = np.abs(error)
    return {
        "p99": float(np.percentile(magnitude, 99)),
        "max": float(np.max(magnitude)),
        "rms": float(np.sqrt(np.mean(error**2))),
    }


def error_family(
    sync: Sync, prefix: str, error_ns: Float, how: str, nothing: str
) -> list[Measurement]:
    """``<prefix>_p99_ns``, ``_max_ns`` and ``_rms_ns`` on budget lines T1, T2 and T3."""
    lines = {"p99": "T1", "max": "T2", "rms": "T3"}
    if not sync.truth or error_ns.size == 0:
        value, why = absent(sync, nothing)
        return [
            judged(f"{prefix}_{kind}_ns", value, line, sync.conditions, why)
            for kind, line in lines.items()
        ]
    details = {"n": int(error_ns.size), "mean_ns": float(np.mean(error_ns))}
    return [
        judged(f"{prefix}_{kind}_ns", number, lines[kind], sync.conditions, how, details=details)
        for kind, number in spread(error_ns).items()
    ]
