# SPDX-License-Identifier: Apache-2.0
"""A figure as one SVG without script or style sheet of anybody else, and that as PNG."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from hil.exchange.table import ExchangeError
from hil.plot.figure import Figure, Panel, Trace
from hil.report import text as texts
from hil.report.decimate import min_max
from hil.report.still import Axis

Float = NDArray[np.float64]

WIDTH: Final = 1200
LEFT, RIGHT, GUTTER = 96, 24, 86
HEAD, TITLE, PLOT, FOOT, TAIL = 124, 34, 128, 22, 30
ROWS_PLOT: Final = 200
POINTS_PER_PIXEL: Final = 2.0
TICKS_Y: Final = 4
PIXELS_PER_TICK: Final = 120
PNG_SCALE: Final = 2.0
WIDE: Final = 500
"""Panels above this width number the repetitions; in others that would be clutter."""
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#7a4a8c")
"""Blue, vermilion and green of Okabe and Ito's palette, told apart by all eyes, and a violet."""
ONE: Final = "#0072b2"
STYLE: Final = (
    "text{font-family:'DejaVu Sans',Verdana,Arial,sans-serif;fill:#1b2733;font-size:13px}"
    ".tick,.unit{fill:#46535f;font-size:12px}.title{font-weight:bold;font-size:14px}"
    ".name{font-weight:bold;font-size:20px}.note{fill:#46535f;font-size:12px}"
    ".label{font-weight:bold;font-size:15px;fill:#fff}"
    ".grid{stroke:#dfe4e8;stroke-width:1}.frame{fill:none;stroke:#9aa5af;stroke-width:1}"
    ".still{fill:#f0e442;fill-opacity:.38}.rep{fill:#7a4a8c}.repline{stroke:#7a4a8c;"
    "stroke-width:1;stroke-dasharray:3 3;stroke-opacity:.7}.repnumber{fill:#5c3470;font-size:11px;"
    "font-weight:bold}.trace{fill:none;stroke-width:1.3;stroke-linejoin:round}.band{fill-opacity:"
    ".22;stroke:none}.bar{stroke-width:7;stroke-linecap:butt;fill:none}"
)


def svg(figure: Figure) -> str:
    """The figure as SVG 1.1, 1200 units wide."""
    heights = [ROWS_PLOT if any(p.rows for p in row) else PLOT for row in figure.panels]
    height = HEAD + sum(TITLE + h + FOOT for h in heights) + TAIL
    parts = [_head(figure)]
    top = float(HEAD)
    for row, plot_height in zip(figure.panels, heights, strict=True):
        gutters = GUTTER * (len(row) - 1)
        width = (WIDTH - LEFT - RIGHT - gutters) / len(row)
        for n, panel in enumerate(row):
            left = LEFT + n * (width + GUTTER)
            parts.append(_panel(figure, panel, (left, top + TITLE, width, plot_height)))
        top += TITLE + plot_height + FOOT
    parts.append(
        Markup('<text x="{}" y="{}" text-anchor="middle">time (s), leader’s clock</text>').format(
            WIDTH / 2, height - 10
        )
    )
    return str(
        Markup(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" '
            'height="{1}" role="img"><title>{2}</title><desc>{3}</desc><style>{4}</style>'
            '<rect width="{0}" height="{1}" fill="#ffffff"/>{5}</svg>\n'
        ).format(
            WIDTH,
            round(height),
            f"{figure.label}: {figure.name}",
            figure.note,
            Markup(STYLE),  # noqa: S704 (our own)
            Markup("").join(parts),
        )
    )


def png(figure: Figure) -> bytes:
    """The same as PNG, 2400 pixels wide.

    Raises:
        ExchangeError: the library that paints SVG is not installed.
    """
    try:
        resvg = importlib.import_module("resvg_py")
    except ModuleNotFoundError as error:
        raise ExchangeError(
            "PNG needs resvg_py, which is not installed",
            "pip install 'hil[png]'\nor write SVG: -o FILE.svg",
        ) from error
    return bytes(resvg.svg_to_bytes(svg_string=svg(figure), zoom=PNG_SCALE))


def _head(figure: Figure) -> Markup:
    label_width = 26 + 10.4 * len(figure.label)
    legend = [("still", "zero-velocity update"), ("rep", "repetition")]
    parts = [
        Markup(
            '<rect x="{0}" y="16" width="{1:.0f}" height="28" rx="4" fill="#1b2733"/>'
            '<text class="label" x="{2:.0f}" y="35" text-anchor="middle">{3}</text>'
            '<text class="name" x="{4:.0f}" y="37">REPLAY of {5}</text>'
        ).format(24, label_width, 24 + label_width / 2, figure.label, 38 + label_width, figure.name)
    ]
    for k, line in enumerate(_wrapped(figure.note, 150)[:2]):
        parts.append(Markup('<text class="note" x="24" y="{}">{}</text>').format(64 + 17 * k, line))
    x = 24.0
    for kind, words in legend:
        parts.append(
            Markup(
                '<rect class="{}" x="{}" y="{}" width="22" height="{}"/><text class="tick" x="{}" '
                'y="105">{}</text>'
            ).format(
                kind, x, 95 if kind == "still" else 98, 12 if kind == "still" else 5, x + 29, words
            )
        )
        x += 50 + 7.2 * len(words)
    return Markup("").join(parts)


def _wrapped(text: str, width: int) -> list[str]:
    lines = [""]
    for part in text.split(" · "):
        if lines[-1] and len(lines[-1]) + len(part) + 3 > width:
            lines.append("")
        lines[-1] += (" · " if lines[-1] else "") + part
    return [line if len(line) <= width + 20 else line[: width + 19] + "…" for line in lines]


def _panel(figure: Figure, panel: Panel, box: tuple[float, float, float, float]) -> Markup:
    left, top, width, height = box
    x = Axis(*_span(figure.span_s), left, left + width, log=False)
    y = Axis(*_range(panel), top + height, top, log=False)
    parts = [_spans(figure, x, top, height), _grid(panel, x, y, box)]
    pixels = int(POINTS_PER_PIXEL * width)
    for n, one in enumerate(panel.traces):
        colour = ONE if len(panel.traces) == 1 or panel.rows else COLOURS[n % len(COLOURS)]
        if panel.rows:
            parts.append(_bar(one, x, y, colour))
            continue
        if one.sigma is not None:
            parts.append(_band(one, x, y, colour, pixels))
        parts.append(_curve(one, x, y, colour, pixels))
    parts.append(_title(panel, box))
    return Markup("").join(parts)


def _span(span: tuple[float, float]) -> tuple[float, float]:
    low, high = span
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _range(panel: Panel) -> tuple[float, float]:
    if panel.rows:
        return -0.7, len(panel.rows) - 0.3
    values = []
    for one in panel.traces:
        reach = 0.0 if one.sigma is None else np.nan_to_num(one.sigma)
        values += [one.y - reach, one.y + reach]
    found = np.concatenate([*values, np.zeros(0)])
    found = found[np.isfinite(found)]
    low, high = (float(found.min()), float(found.max())) if found.size else (0.0, 1.0)
    rim = 0.07 * ((high - low) or abs(high) or 1.0)
    return low - rim, high + rim


def _spans(figure: Figure, x: Axis, top: float, height: float) -> Markup:
    parts = [
        Markup('<rect class="still" x="{}" y="{}" width="{:.1f}" height="{}"/>').format(
            x.at(a), top, max(x.at(b) - x.at(a), 0.6), height
        )
        for a, b in figure.still
        if b >= x.low and a <= x.high
    ]
    for number, (a, b) in enumerate(figure.repetitions, start=1):
        if b < x.low or a > x.high:
            continue
        left, right = x.at(max(a, x.low)), x.at(min(b, x.high))
        parts.append(
            Markup('<rect class="rep" x="{}" y="{}" width="{:.1f}" height="4"/>').format(
                left, top - 5, max(right - left, 1.0)
            )
        )
        if x.end - x.start > WIDE:
            parts.append(
                Markup(
                    '<path class="repline" d="M{0} {2}V{3}M{1} {2}V{3}"/><text class="repnumber" '
                    'x="{4:.1f}" y="{5}" text-anchor="middle">{6}</text>'
                ).format(left, right, top, top + height, (left + right) / 2, top - 8, number)
            )
    return Markup("").join(parts)


def _grid(panel: Panel, x: Axis, y: Axis, box: tuple[float, float, float, float]) -> Markup:
    left, top, width, height = box
    parts = []
    for value in x.ticks(max(3, round(width / PIXELS_PER_TICK))):
        parts.append(
            Markup(
                '<path class="grid" d="M{0} {1}V{2}"/><text class="tick" x="{0}" y="{3}" '
                'text-anchor="middle">{4}</text>'
            ).format(x.at(value), top, top + height, top + height + 15, texts.number(value))
        )
    if panel.rows:
        marks = [(float(len(panel.rows) - 1 - k), name) for k, name in enumerate(panel.rows)]
    else:
        ticks = y.ticks(TICKS_Y)
        marks = list(zip(ticks, _numbers(ticks), strict=True))
    for at, words in marks:
        parts.append(
            Markup(
                '<path class="grid" d="M{0} {1}H{2}"/><text class="tick" x="{3}" y="{4}" '
                'text-anchor="end">{5}</text>'
            ).format(left, y.at(at), left + width, left - 6, y.at(at) + 4, words)
        )
    parts.append(
        Markup('<rect class="frame" x="{}" y="{}" width="{:.1f}" height="{}"/>').format(*box)
    )
    return Markup("").join(parts)


def _numbers(ticks: Sequence[float]) -> list[str]:
    """Ticks with as many decimals as their step needs, all alike."""
    if len(ticks) < 2:
        return [texts.number(v, 5) for v in ticks]
    step = ticks[1] - ticks[0]
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    if decimals > 6:
        return [f"{v:.1e}".replace("-", "−") for v in ticks]
    return [f"{v + 0.0:.{decimals}f}".replace("-", "−") for v in ticks]


def _title(panel: Panel, box: tuple[float, float, float, float]) -> Markup:
    left, top, width, _ = box
    unit = f" ({panel.unit})" if panel.unit else ""
    # Above the marks of the repetitions.
    parts = [
        Markup('<text class="title" x="{}" y="{}">{}{}</text>').format(
            left, top - 20, panel.title, unit
        )
    ]
    if len(panel.traces) > 1 and not panel.rows:
        at = left + width - sum(34 + 8 * len(t.label) for t in panel.traces)
        for n, one in enumerate(panel.traces):
            parts.append(
                Markup(
                    '<path d="M{:.0f} {}h18" stroke="{}" stroke-width="3"/>'
                    '<text x="{:.0f}" y="{}">{}</text>'
                ).format(at, top - 24, COLOURS[n % len(COLOURS)], at + 22, top - 20, one.label)
            )
            at += 34 + 8 * len(one.label)
    return Markup("").join(parts)


def _points(t_s: Float, y: Float, x: Axis, pixels: int) -> tuple[Float, Float]:
    inside = (t_s >= x.low) & (t_s <= x.high)
    return min_max(t_s[inside], y[inside], max(pixels, 8))


def _path(t_s: Float, v: Float, x: Axis, y: Axis) -> str:
    path, pen = [], "M"
    for a, b in zip(t_s.tolist(), v.tolist(), strict=True):
        if math.isfinite(b):
            path.append(f"{pen}{x.at(a)} {y.at(b)}")
            pen = "L"
        else:
            pen = "M"
    return "".join(path)


def _curve(one: Trace, x: Axis, y: Axis, colour: str, pixels: int) -> Markup:
    return Markup('<path class="trace" stroke="{}" d="{}"/>').format(
        colour, _path(*_points(one.t_s, one.y, x, pixels), x, y)
    )


def _band(one: Trace, x: Axis, y: Axis, colour: str, pixels: int) -> Markup:
    """From one standard deviation below to one above, piece by piece between the gaps."""
    assert one.sigma is not None
    t, high = _points(one.t_s, one.y + one.sigma, x, pixels)
    low_t, low = _points(one.t_s, one.y - one.sigma, x, pixels)
    paths = []
    cuts = t[np.isnan(high)]
    for a, b in zip([-math.inf, *cuts], [*cuts, math.inf], strict=True):
        up, down = (t > a) & (t <= b), (low_t > a) & (low_t <= b)
        upper = _path(t[up], high[up], x, y)
        lower = _path(low_t[down][::-1], low[down][::-1], x, y)
        if upper and lower:
            paths.append(f"{upper}L{lower[1:]}Z")
    return Markup('<path class="band" fill="{}" d="{}"/>').format(colour, "".join(paths))


def _bar(one: Trace, x: Axis, y: Axis, colour: str) -> Markup:
    """Spans of a row: from each first step that has the flag to the first that has not."""
    on = np.isfinite(one.y)
    padded = np.concatenate([[False], on, [False]])
    turns = np.flatnonzero(padded[1:] != padded[:-1])
    path = []
    for a, b in zip(turns[::2].tolist(), turns[1::2].tolist(), strict=True):
        left = x.at(float(one.t_s[a]))
        right = max(x.at(float(one.t_s[min(b, len(on) - 1)])), left + 0.8)
        path.append(f"M{left} {y.at(float(one.y[a]))}H{right:.1f}")
    return Markup('<path class="bar" stroke="{}" d="{}"/>').format(colour, "".join(path))
