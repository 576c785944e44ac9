# SPDX-License-Identifier: Apache-2.0
"""The league as a picture: RMSE of velocity on a logarithmic axis, a line of dots for each case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from hil.compare.methods import METHODS
from hil.compare.score import Row

COLOURS: Final = (
    *("#0b6e4f", "#7bc8a4", "#b5179e", "#e07a00"),
    *("#6c757d", "#1d4ed8", "#c1121f", "#8d6e00"),
)
SHAPES: Final = ("circle", "circle", "square", "square", "square", "diamond", "diamond", "diamond")
LEFT, RIGHT, TOP, LINE = 150, 30, 62, 22


def svg(tables: Mapping[str, Sequence[Row]], width: int = 900) -> str:
    """The whole picture; cases without truth are left out."""
    cases = {
        case: {r.method: r.velocity_mps for r in rows if r.velocity_mps}
        for case, rows in tables.items()
    }
    cases = {case: values for case, values in cases.items() if values}
    height = TOP + LINE * len(cases) + 44
    every = [v for values in cases.values() for v in values.values()] or [1e-3, 1.0]
    low, high = math.floor(math.log10(min(every))), math.ceil(math.log10(max(every)))
    high = max(high, low + 1)

    def x(value: float) -> float:
        return LEFT + (math.log10(value) - low) / (high - low) * (width - LEFT - RIGHT)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="12" role="img" aria-label="Velocity RMSE by tracker">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for k, name in enumerate(METHODS):
        at = LEFT + (k % 4) * 170, 18 + (k // 4) * 20
        parts.append(_mark(k, at[0], at[1]))
        parts.append(f'<text x="{at[0] + 12}" y="{at[1] + 4}">{escape(name)}</text>')
    bottom = TOP + LINE * len(cases)
    for power in range(low, high + 1):
        at_x = x(10.0**power)
        parts.append(
            f'<line x1="{at_x:.1f}" y1="{TOP - 8}" x2="{at_x:.1f}" y2="{bottom}" stroke="#d0d0d0"/>'
            f'<text x="{at_x:.1f}" y="{bottom + 16}" text-anchor="middle">{10.0**power:g}</text>'
        )
    parts.append(
        f'<text x="{(LEFT + width - RIGHT) / 2:.0f}" y="{bottom + 34}" text-anchor="middle">'
        "velocity, RMSE, m/s</text>"
    )
    for row, (case, values) in enumerate(cases.items()):
        y = TOP + LINE * row + LINE / 2
        parts.append(
            f'<text x="{LEFT - 10}" y="{y + 4:.1f}" text-anchor="end">{escape(case)}</text>'
        )
        parts.append(f'<line x1="{LEFT}" y1="{y}" x2="{width - RIGHT}" y2="{y}" stroke="#eeeeee"/>')
        parts += [_mark(k, x(values[name]), y) for k, name in enumerate(METHODS) if name in values]
    return "\n".join([*parts, "</svg>", ""])


def _mark(k: int, x: float, y: float) -> str:
    """Colour and shape tell them apart: no eye needs both."""
    fill = COLOURS[k]
    if SHAPES[k] == "circle":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{fill}"/>'
    turn = f' transform="rotate(45 {x:.1f} {y:.1f})"' if SHAPES[k] == "diamond" else ""
    return f'<rect x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8" fill="{fill}"{turn}/>'
