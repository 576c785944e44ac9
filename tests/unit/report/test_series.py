# SPDX-License-Identifier: Apache-2.0
"""A series that cannot be drawn is refused where it is made."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hil.series import LimitLine, Series, histogram


def make(x: Any, y: Any, kind: Any = "line") -> Series:
    return Series("s", "S", "s", "ns", np.array(x, float), np.array(y, float), kind=kind)


@pytest.mark.parametrize(
    ("x", "y", "kind", "message"),
    [
        ([0, 1], [1], "line", "needs 1 x"),
        ([0, 1], [1, 2], "histogram", "needs 3 x"),
        ([1, 0], [1, 2], "line", "ascending"),
        ([0, math.nan], [1, 2], "points", "finite"),
        ([0, 1], [1, 2], "pie", "unknown kind"),
    ],
)
def test_what_does_not_fit_is_refused(x: Any, y: Any, kind: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(x, y, kind)


def test_a_limit_line_needs_a_value() -> None:
    with pytest.raises(ValueError, match="no finite value"):
        LimitLine(math.inf, "none")


def test_histogram_counts_every_finite_value_once() -> None:
    s = histogram("h", "H", [1.0, 2.0, 2.0, 9.0, math.nan, math.inf], "ns", bins=8)
    assert s.y.sum() == 4
    assert (s.x[0], s.x[-1], s.x.size) == (1.0, 9.0, 9)
    assert s.y[0] == 1


def test_histogram_of_nothing_is_empty() -> None:
    s = histogram("h", "H", [], "ns")
    assert (s.x.size, s.y.size) == (1, 0)
