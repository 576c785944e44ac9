# SPDX-License-Identifier: Apache-2.0
"""A series: numbers over time (or a histogram) with the limits that belong to them.

Analyses return series as plain data; the report draws them. Nothing here knows how.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["line", "points", "histogram"]


@dataclass(frozen=True)
class LimitLine:
    """A limit to draw: across a timeline at a value of y, across a histogram at a value of x.

    ``side`` says on which side of the line a value is out of bounds: ``above`` or ``below``.
    """

    value: float
    label: str
    side: Literal["above", "below"] = "above"

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise ValueError(f"limit line {self.label!r} has no finite value: {self.value}")


@dataclass(frozen=True, eq=False)
class Series:
    """One trace of one chart.

    Attributes:
        name: dotted, lower case, unique within a recording: ``sync.offset_detrended``.
        title: what the trace shows, for people.
        x_unit, y_unit: SI units of ``x`` and ``y``, or ``"1"``.
        x: float64[n], ascending; for a histogram the n + 1 edges of the bins.
        y: float64[n]; NaN where there is no value (drawn as a gap); for a histogram the counts.
        kind: ``line``, ``points`` or ``histogram``.
        limits: lines to draw, in the unit of y (of x for a histogram).
        clock: clock that x refers to, where x is a time: ``bench``, ``leader``, ``follower``.
        y_clock: clock that y refers to, where y is a time.
        x_label, y_label: quantity on each axis, without unit.
        plot: traces with the same ``plot`` share one chart; empty: a chart of its own.
        plot_title: heading of a shared chart; the first one given counts.
        check: name of the measurement that judges this trace, if one does.
        caption: one or two sentences: what is seen, and from what it was computed.
        x_log, y_log: logarithmic axes; values that are not positive are left out.

    Raises:
        ValueError: lengths that do not fit, an x that is not finite and ascending, an unknown kind.
    """

    name: str
    title: str
    x_unit: str
    y_unit: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    kind: Kind = "line"
    limits: tuple[LimitLine, ...] = ()
    clock: str = ""
    y_clock: str = ""
    x_label: str = "time"
    y_label: str = ""
    plot: str = ""
    plot_title: str = ""
    check: str = ""
    caption: str = ""
    x_log: bool = False
    y_log: bool = False

    def __post_init__(self) -> None:
        if self.kind not in ("line", "points", "histogram"):
            raise ValueError(f"series {self.name}: unknown kind {self.kind!r}")
        x = np.asarray(self.x, dtype=np.float64)
        y = np.asarray(self.y, dtype=np.float64)
        expected = y.size + 1 if self.kind == "histogram" else y.size
        if x.ndim != 1 or y.ndim != 1 or x.size != expected:
            raise ValueError(
                f"series {self.name}: x has shape {x.shape} and y {y.shape}; a {self.kind} of "
                f"{y.size} values needs {expected} x"
            )
        if not np.all(np.isfinite(x)) or np.any(np.diff(x) < 0):
            raise ValueError(f"series {self.name}: x must be finite and ascending")
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "y", y)


def histogram(
    name: str,
    title: str,
    values: NDArray[Any] | Sequence[float],
    unit: str,
    *,
    bins: int = 60,
    limits: tuple[LimitLine, ...] = (),
    clock: str = "",
    x_label: str = "",
    check: str = "",
    caption: str = "",
) -> Series:
    """Count ``values`` (any shape, in ``unit``; non-finite ones are left out) into equal bins."""
    finite = np.asarray(values, dtype=np.float64).ravel()
    finite = finite[np.isfinite(finite)]
    counts, edges = np.histogram(finite, bins=bins) if finite.size else (np.zeros(0), np.zeros(1))
    return Series(
        name=name,
        title=title,
        x_unit=unit,
        y_unit="1",
        x=edges.astype(np.float64),
        y=counts.astype(np.float64),
        kind="histogram",
        limits=limits,
        clock=clock,
        x_label=x_label or title,
        y_label="count",
        check=check,
        caption=caption,
    )
