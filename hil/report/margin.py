# SPDX-License-Identifier: Apache-2.0
"""How much of what the error budget allows was used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

Number = float | int | str | None


def used(measurement: Mapping[str, Any]) -> float | None:
    """Share of the allowance that the value takes: 0 nothing, 1 the limit, beyond 1 over it.

    The value over an upper limit; the lower limit over the value, or of a share what it lacks to
    one; between two limits the distance from their middle over half of their distance. Where
    nothing is allowed, 0 or infinity. None where that cannot be said: no value, no limit, or a
    limit on the far side of zero.
    """
    value = _number(measurement["value"])
    low, high = (_number(measurement["limits"][side]) for side in ("low", "high"))
    if value is None or not math.isfinite(value):
        return None
    if low is not None and high is not None:
        return _over(abs(value - 0.5 * (low + high)), 0.5 * (high - low))
    if high is not None and high >= 0.0:
        return _over(max(value, 0.0), high)
    if low is not None and 0.0 < low < 1.0 and value <= 1.0 and measurement["unit"] == "1":
        return _over(1.0 - value, 1.0 - low)
    if low is not None and low > 0.0:
        return _over(low, max(value, 0.0))
    return None


def percent(share: float | None) -> str:
    """``share`` in words: 56 %, over, or a dash."""
    if share is None:
        return "–"
    if share > 9.995:
        return "over"
    return f"{100.0 * share:.0f} %"


def _over(part: float, whole: float) -> float:
    if part == 0.0:
        return 0.0
    return part / whole if whole > 0.0 else math.inf


def _number(value: Number) -> float | None:
    return None if value is None else float(value)
