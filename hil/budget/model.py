# SPDX-License-Identifier: Apache-2.0
"""What a line of the error budget is: limits under conditions, with their arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hil.measure import Limits


@dataclass(frozen=True)
class Conditions:
    """What a limit may depend on.

    Attributes:
        conn_interval_us: connection interval in use.
        phy: 1 or 2 (Mbit/s).
        simulated: the radio is simulated (or the recording synthetic).
        lossy: the channel is meant to corrupt packets.
    """

    conn_interval_us: float
    phy: int = 2
    simulated: bool = True
    lossy: bool = False


@dataclass(frozen=True)
class Case:
    """The limit of a line under one condition."""

    condition: str
    applies: Callable[[Conditions], bool]
    low: float | None = None
    high: float | None = None
    marginal: float = 0.0


@dataclass(frozen=True)
class Line:
    """One line of the budget.

    Attributes:
        id: what a measurement cites.
        quantity: what is limited.
        unit: unit of the limits.
        arithmetic: how the limits follow from the sources, with numbers.
        cases: the first one whose condition holds applies.
    """

    id: str
    quantity: str
    unit: str
    arithmetic: str
    cases: tuple[Case, ...]

    def limits(self, conditions: Conditions) -> Limits:
        """The limits under ``conditions``.

        Raises:
            LookupError: no case of this line covers them.
        """
        for case in self.cases:
            if case.applies(conditions):
                return Limits(case.low, case.high, case.marginal)
        raise LookupError(f"budget line {self.id} has no case for {conditions}")
