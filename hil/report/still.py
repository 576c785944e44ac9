# SPDX-License-Identifier: Apache-2.0
"""Still figures as inline SVG: histograms and curves over logarithmic axes.

They need no script, so they are there without JavaScript and in print. Colours come from the
page's style sheet by class, so that both themes fit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from markupsafe import Markup

from hil.report import text as texts

WIDTH: Final = 560
HEIGHT: Final = 290
LEFT, RIGHT, TOP, BOTTOM = 62, 12, 12, 44
COLOURS: Final = 8
TICKS_X: Final = 6
TICKS_Y: Final = 5
LIMIT_REACH: Final = 3.0
"""A limit farther away than so many spans of the data is named, not drawn."""


@dataclass(frozen=True)
class Axis:
    """From values to coordinates: ``low`` at ``start``, ``high`` at ``end``."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def at(self, value: float) -> float:
        """The coordinate of ``value``, rounded to what is seen."""
        low, high, v = (
            (math.log10(x) for x in (self.low, self.high, value))
            if self.log
            else (self.low, self.high, value)
        )
        return round(self.start + (v - low) / (high - low) * (self.end - self.start), 1)

    def ticks(self, count: int) -> list[float]:
        """About ``count`` round values; whole decades on a logarithmic axis."""
        if self.log:
            a, b = round(math.log10(self.low)), round(math.log10(self.high))
            decades = max(1, math.ceil((b - a) / (count + 2)))
            return [10.0**n for n in range(a, b + 1, decades)]
        rough = (self.high - self.low) / count
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
        first = math.ceil(self.low / step - 1e-9)
        return [n * step for n in range(first, math.floor(self.high / step + 1e-9) + 1)]


def render(data: Mapping[str, Any], labelled_by: str) -> Markup:
    """The figure of a chart whose traces have plain ``x`` and ``y``.

    Args:
        data: a chart's ``data`` as :func:`hil.report.charts.charts` makes it.
        labelled_by: id of the element that names the figure.
    """
    histogram = data["kind"] == "histogram"
    x, y = _axes(data, histogram)
    parts = [_grid(x, y, data)]
    parts += _limits(data["limits"], x, y, histogram)
    for n, trace in enumerate(data["traces"]):
        path = _steps(trace, x, y) if histogram else _curve(trace, x, y)
        if histogram and n == 0:
            closed = f"{path}V{y.at(0.0)}H{x.at(trace['x'][0])}Z"
            parts.append(
                Markup('<path class="area s{}" d="{}"></path>').format(n % COLOURS, closed)
            )
        parts.append(Markup('<path class="trace s{}" d="{}"></path>').format(n % COLOURS, path))
    return Markup(
        '<svg class="still" viewBox="0 0 {} {}" role="img" aria-labelledby="{}">{}</svg>'
    ).format(WIDTH, HEIGHT, labelled_by, Markup("").join(parts))


def _axes(data: Mapping[str, Any], histogram: bool) -> tuple[Axis, Axis]:
    xs = [v for t in data["traces"] for v in t["x"]]
    ys = [v for t in data["traces"] for v in t["y"] if v is not None]
    limits = [line["value"] for line in data["limits"]]
    left, right = _range(xs, limits if histogram else [], data["xLog"])
    low, high = _range([*ys, 0.0] if histogram else ys, [] if histogram else limits, data["yLog"])
    if histogram:
        low = 0.0
    return (
        Axis(left, right, LEFT, WIDTH - RIGHT, data["xLog"]),
        Axis(low, high, HEIGHT - BOTTOM, TOP, data["yLog"]),
    )


def _range(values: Sequence[float], limits: Sequence[float], log: bool) -> tuple[float, float]:
    if log:
        positive = [v for v in values if v > 0.0] or [1.0]
        low = 10.0 ** math.floor(math.log10(min(positive)) + 1e-9)
        high = 10.0 ** math.ceil(math.log10(max(positive)) - 1e-9)
        return (low, high) if high > low else (low, 10.0 * low)
    low, high = min(values, default=0.0), max(values, default=1.0)
    span = (high - low) or abs(high) or 1.0
    near = [v for v in limits if low - LIMIT_REACH * span < v < high + LIMIT_REACH * span]
    low, high = min([low, *near]), max([high, *near])
    rim = 0.05 * ((high - low) or 1.0)
    return low - rim, high + rim


def _grid(x: Axis, y: Axis, data: Mapping[str, Any]) -> Markup:
    parts = []
    for value in x.ticks(TICKS_X):
        at = x.at(value)
        parts.append(
            Markup(
                '<path class="grid" d="M{0} {1}V{2}"></path><text class="tick" x="{0}" y="{3}" '
                'text-anchor="middle">{4}</text>'
            ).format(at, TOP, HEIGHT - BOTTOM, HEIGHT - BOTTOM + 17, _tick(value, x.log))
        )
    for value in y.ticks(TICKS_Y):
        at = y.at(value)
        parts.append(
            Markup(
                '<path class="grid" d="M{0} {1}H{2}"></path><text class="tick" x="{3}" y="{4}" '
                'text-anchor="end">{5}</text>'
            ).format(LEFT, at, WIDTH - RIGHT, LEFT - 7, at + 4, _tick(value, y.log))
        )
    parts.append(
        Markup('<text class="axis" x="{}" y="{}" text-anchor="middle">{}</text>').format(
            (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, data["xLabel"]
        )
    )
    return Markup("").join(parts)


def _tick(value: float, log: bool) -> str:
    if log and not 1e-3 <= value < 1e5:
        return f"1e{round(math.log10(value))}".replace("-", "−")
    return texts.number(value)


def _limits(lines: Sequence[Mapping[str, Any]], x: Axis, y: Axis, histogram: bool) -> list[Markup]:
    """Dashed and named, with what lies beyond shaded; one outside the picture only named."""
    parts = []
    axis = x if histogram else y
    for n, line in enumerate(lines):
        if not axis.low < line["value"] < axis.high:
            parts.append(_far(line, beyond=line["value"] >= axis.high, n=n, histogram=histogram))
            continue
        at, above = axis.at(line["value"]), line["side"] == "above"
        left, top, right, bottom = LEFT, TOP, WIDTH - RIGHT, HEIGHT - BOTTOM
        box: tuple[float, float, float, float]
        place: tuple[float, float]
        if histogram:
            box = (at, top, right, bottom) if above else (left, top, at, bottom)
            path = f"M{at} {top}V{bottom}"
            # Towards the middle, each name on a row of its own.
            place, end = (at + (-5 if at > WIDTH / 2 else 5), top + 14 + 15 * n), at > WIDTH / 2
        else:
            box = (left, top, right, at) if above else (left, at, right, bottom)
            path = f"M{left} {at}H{right}"
            place, end = (right - 6, at - 5), True
        parts.append(
            Markup(
                '<rect class="beyond" x="{}" y="{}" width="{:.1f}" height="{:.1f}"></rect>'
                '<path class="limit-line" d="{}"></path>'
                '<text class="limit-name" x="{}" y="{}" text-anchor="{}">{}</text>'
            ).format(
                box[0],
                box[1],
                box[2] - box[0],
                box[3] - box[1],
                path,
                *place,
                "end" if end else "start",
                line["label"],
            )
        )
    return parts


def _far(line: Mapping[str, Any], *, beyond: bool, n: int, histogram: bool) -> Markup:
    """The name of a limit outside the picture, with an arrow to where it is."""
    row = TOP + 14 + 15 * n
    arrow = ("→" if beyond else "←") if histogram else ("↑" if beyond else "↓")
    place = (LEFT + 6, "start") if histogram and not beyond else (WIDTH - RIGHT - 6, "end")
    return Markup('<text class="limit-name" x="{}" y="{}" text-anchor="{}">{} {}</text>').format(
        place[0], row, place[1], line["label"], arrow
    )


def _steps(trace: Mapping[str, Any], x: Axis, y: Axis) -> str:
    edges, counts = trace["x"], trace["y"]
    path = f"M{x.at(edges[0])} {y.at(0.0)}"
    for right, count in zip(edges[1:], counts, strict=True):
        path += f"V{y.at(count or 0.0)}H{x.at(right)}"
    return path


def _curve(trace: Mapping[str, Any], x: Axis, y: Axis) -> str:
    path, pen = "", "M"
    for a, b in zip(trace["x"], trace["y"], strict=True):
        if b is None or (x.log and a <= 0.0) or (y.log and b <= 0.0):
            pen = "M"
            continue
        path += f"{pen}{x.at(a)} {y.at(b)}"
        pen = "L"
    return path
