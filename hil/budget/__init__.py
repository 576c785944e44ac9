# SPDX-License-Identifier: Apache-2.0
"""The error budget: every limit that a check uses, with the arithmetic that it comes from.

``docs/error-budget.md`` is the same budget for people; ``tests/unit/test_budget.py`` reads that
page and holds it against this package, so that neither can drift from the other.

A line has an id (``T1``), a quantity, and one or more cases: the limit under a condition. The
first case whose condition holds is the limit that applies.
"""

from hil.budget.judge import BY_ID, judged, line
from hil.budget.lines import LINES
from hil.budget.model import Case, Conditions, Line
from hil.budget.sources import TICK_NS, WINDOW_S

__all__ = [
    "BY_ID",
    "LINES",
    "TICK_NS",
    "WINDOW_S",
    "Case",
    "Conditions",
    "Line",
    "judged",
    "line",
]
