# SPDX-License-Identifier: Apache-2.0
"""From a value to a measurement: the limits come from the budget, never from the check."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from hil.budget.lines import LINES
from hil.budget.model import Conditions, Line
from hil.measure import Limits, Measurement

BY_ID: Final = {line.id: line for line in LINES}


def line(line_id: str) -> Line:
    """The line called ``line_id``.

    Raises:
        LookupError: there is none.
    """
    try:
        return BY_ID[line_id]
    except KeyError:
        raise LookupError(f"the error budget has no line {line_id}") from None


def judged(
    name: str,
    value: float | None,
    line_id: str,
    conditions: Conditions,
    how: str,
    *,
    uncertainty: float = 0.0,
    scale: float = 1.0,
    unit: str = "",
    clock: str = "",
    details: Mapping[str, Any] | None = None,
) -> Measurement:
    """A measurement with the limits of budget line ``line_id`` under ``conditions``.

    Args:
        scale: what the line's limits are multiplied by, where the line speaks of a share and
            the value is a count or a rate; ``unit`` is then the unit of the value.
    """
    budget_line = line(line_id)
    limits = budget_line.limits(conditions)
    return Measurement(
        name=name,
        value=value,
        unit=unit or budget_line.unit,
        limits=Limits(
            None if limits.low is None else limits.low * scale,
            None if limits.high is None else limits.high * scale,
            limits.marginal * scale,
        ),
        budget=line_id,
        how=how,
        uncertainty=uncertainty,
        clock=clock,
        details=details or {},
    )
