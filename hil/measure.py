# SPDX-License-Identifier: Apache-2.0
"""Measurements as data: a value, its limits, its uncertainty, and the verdict they imply.

A verdict is never stored, it follows from the numbers:

===============  ==============================================================================
``unset``        nothing was measured (the source cannot give this value); ``how`` says why
``inconclusive`` the uncertainty interval straddles a limit, so neither verdict can be trusted
``fail``         the value, uncertainty allowed for, is outside the limits
``marginal``     inside the limits, but within the marginal band next to one of them
``pass``         inside the limits and clear of the band
===============  ==============================================================================
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


class Verdict(enum.StrEnum):
    PASS = "pass"  # noqa: S105 (a verdict, not a password)
    MARGINAL = "marginal"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"
    UNSET = "unset"

    @property
    def ok(self) -> bool:
        """True for the verdicts that let a run pass."""
        return self in (Verdict.PASS, Verdict.MARGINAL, Verdict.UNSET)


@dataclass(frozen=True)
class Limits:
    """Closed interval in which a value is acceptable; ``None`` is no limit on that side.

    ``marginal`` is the width, in the value's unit, of the band inside each limit in which a
    passing value is called marginal.
    """

    low: float | None = None
    high: float | None = None
    marginal: float = 0.0

    def __post_init__(self) -> None:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"limits are crossed: low {self.low} > high {self.high}")
        if self.marginal < 0:
            raise ValueError(f"marginal band is negative: {self.marginal}")

    def __str__(self) -> str:
        match self.low, self.high:
            case None, None:
                return "none"
            case None, high:
                return f"<= {high:g}"
            case low, None:
                return f">= {low:g}"
            case low, high if low == high:
                return f"= {low:g}"
            case low, high:
                return f"{low:g} .. {high:g}"

    def contains(self, value: float) -> bool:
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


@dataclass(frozen=True)
class Measurement:
    """One measured quantity.

    Attributes:
        name: dotted, lower case: ``sync.error_p99``.
        value: in ``unit``; ``None`` when it could not be measured; NaN is a fault and fails.
        unit: SI unit or ``"1"``.
        limits: where the value must lie.
        budget: line of ``docs/error-budget.md`` that the limits come from.
        how: one sentence: from what, by what, over how many.
        uncertainty: half width, in ``unit``, of the interval the true value lies in.
        clock: clock the value refers to, where that matters.
        details: further numbers for views; JSON-able.
    """

    name: str
    value: float | None
    unit: str
    limits: Limits
    budget: str
    how: str
    uncertainty: float = 0.0
    clock: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        if self.value is None:
            return Verdict.UNSET
        if math.isnan(self.value):
            return Verdict.FAIL
        low, high = self.value - self.uncertainty, self.value + self.uncertainty
        inside = self.limits.contains(low), self.limits.contains(high)
        if not any(inside):
            # Both ends outside may still enclose a narrow acceptable interval.
            return Verdict.INCONCLUSIVE if self._encloses(low, high) else Verdict.FAIL
        if not all(inside):
            return Verdict.INCONCLUSIVE
        return Verdict.MARGINAL if self._is_marginal() else Verdict.PASS

    def _encloses(self, low: float, high: float) -> bool:
        bounds = [b for b in (self.limits.low, self.limits.high) if b is not None]
        return any(low < b < high for b in bounds)

    def _is_marginal(self) -> bool:
        assert self.value is not None
        low, high, band = self.limits.low, self.limits.high, self.limits.marginal
        near_low = low is not None and self.value < low + band
        near_high = high is not None and self.value > high - band
        return near_low or near_high

    def to_json(self) -> dict[str, Any]:
        """Plain data for ``report.json``; non-finite values become strings."""

        def plain(x: float | None) -> float | str | None:
            return x if x is None or math.isfinite(x) else repr(x)

        return {
            "name": self.name,
            "value": plain(self.value),
            "unit": self.unit,
            "limits": {
                "low": plain(self.limits.low),
                "high": plain(self.limits.high),
                "marginal": self.limits.marginal,
            },
            "verdict": self.verdict.value,
            "uncertainty": plain(self.uncertainty),
            "budget": self.budget,
            "how": self.how,
            "clock": self.clock,
            "details": dict(self.details),
        }
