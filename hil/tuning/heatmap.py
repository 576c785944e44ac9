# SPDX-License-Identifier: Apache-2.0
"""A tuning's counts as a heatmap: in the terminal, as CSV, as one self-contained SVG."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from hil.tuning.zupt import Tuning

Float = NDArray[np.float64]

SHADES: Final = " .:-=+*#%@"
"""Few to many, for terminals without colours."""
STOPS: Final = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
"""Five colours of matplotlib's viridis (CC0), which prints well and suits all eyes."""
PLATEAU, PROPOSAL, NOW = "o", "P", "x"


def spans(tuning: Tuning) -> Float:
    """float64[a, g]: spans of all runs together."""
    total: Float = np.sum([t.spans for t in tuning.tables], axis=0).astype(np.float64)
    return total


def still_s(tuning: Tuning) -> Float:
    """float64[a, g]: time in stillness of all runs together."""
    total: Float = np.sum([t.steps * t.period_s for t in tuning.tables], axis=0)
    return total


def wrong(tuning: Tuning, name: str) -> Float | None:
    """float64[a, g]: ``false_spans`` or ``missed`` of the runs of which the truth is known."""
    known = [getattr(t, name) for t in tuning.tables if getattr(t, name) is not None]
    return np.sum(known, axis=0).astype(np.float64) if known else None


def as_csv(tuning: Tuning) -> str:
    """One line per cell; false spans and missed rests are empty where no truth is known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["zupt_accel_var", "zupt_gyro_var", "spans", "still_s", "false_spans", "missed", "plateau"]
    )
    counts, seconds = spans(tuning), still_s(tuning)
    others = [wrong(tuning, name) for name in ("false_spans", "missed")]
    for i, accel in enumerate(tuning.grid.accel_var):
        for j, gyro in enumerate(tuning.grid.gyro_var):
            writer.writerow(
                [
                    f"{accel:.6g}",
                    f"{gyro:.6g}",
                    int(counts[i, j]),
                    f"{seconds[i, j]:.3f}",
                    *("" if one is None else int(one[i, j]) for one in others),
                    int(tuning.plateau is not None and bool(tuning.plateau.cells[i, j])),
                ]
            )
    return text.getvalue()


def terminal(tuning: Tuning, values: Float, title: str) -> Text:
    """Two characters per cell: shade and mark; the accelerometer's threshold grows upwards."""
    share = _shares(values)
    rows, columns = tuning.grid.shape
    text = Text(no_wrap=True)
    text.append(f"{title}: {values.min():g} to {values.max():g}\n")
    for i in reversed(range(rows)):
        label = f"{tuning.grid.accel_var[i]:9.2g} " if i % 5 == 0 or i == rows - 1 else " " * 10
        text.append(label)
        for j in range(columns):
            shade = SHADES[round(share[i, j] * (len(SHADES) - 1))]
            red, green, blue = _colour(share[i, j])
            ink = "black" if share[i, j] > 0.5 else "white"
            text.append(shade + _mark(tuning, i, j), f"{ink} on #{red:02x}{green:02x}{blue:02x}")
        text.append("\n")
    low, high = tuning.grid.gyro_var[0], tuning.grid.gyro_var[-1]
    name = "zupt_gyro_var, (rad/s)^2".center(2 * columns - 20)
    text.append(f"{'':10}{low:<10.2g}{name}{high:>10.2g}\n")
    text.append(
        f"{'':10}up: zupt_accel_var, (m/s^2)^2; {PLATEAU}: plateau, {PROPOSAL}: proposal, "
        f"{NOW}: now\n"
    )
    return text


def svg(tuning: Tuning) -> str:
    """Two panels, spans and time in stillness, with the plateau outlined."""
    panels: Sequence[tuple[str, Float, Callable[[float], str]]] = (
        ("Zero-velocity spans", spans(tuning), "{:.0f}".format),
        ("Time in stillness, s", still_s(tuning), "{:.1f}".format),
    )
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1000 500" '
        'font-family="sans-serif" font-size="12">',
        '<rect width="1000" height="500" fill="white"/>',
    ]
    for k, (title, values, shown) in enumerate(panels):
        parts += _panel(tuning, values, title, shown, 70.0 + 490.0 * k)
    parts.append("</svg>\n")
    return "\n".join(parts)


def _panel(
    tuning: Tuning, values: Float, title: str, shown: Callable[[float], str], left: float
) -> list[str]:
    rows, columns = tuning.grid.shape
    top, size = 50.0, 390.0
    dx, dy = size / columns, size / rows
    share = _shares(values)
    parts = [f'<text x="{left}" y="30" font-size="15">{title}</text>']
    for i in range(rows):
        y = top + size - (i + 1) * dy
        for j in range(columns):
            red, green, blue = _colour(share[i, j])
            parts.append(
                f'<rect x="{left + j * dx:.2f}" y="{y:.2f}" width="{dx + 0.3:.2f}" '
                f'height="{dy + 0.3:.2f}" fill="#{red:02x}{green:02x}{blue:02x}">'
                f"<title>accel {tuning.grid.accel_var[i]:.3g}, gyro {tuning.grid.gyro_var[j]:.3g}: "
                f"{shown(values[i, j])}</title></rect>"
            )
    if tuning.plateau is not None:
        path = _outline(tuning.plateau.cells, left, top + size, dx, dy)
        parts.append(f'<path d="{path}" stroke="white" stroke-width="2" fill="none"/>')
    for at, label, fill in ((tuning.now, "now", "black"), (tuning.proposal, "proposal", "red")):
        if at is not None:
            x = left + dx * (_position(tuning.grid.gyro_var, at[1]) + 0.5)
            y = top + size - dy * (_position(tuning.grid.accel_var, at[0]) + 0.5)
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{fill}" stroke="white"/>'
                f'<text x="{x + 8:.1f}" y="{y + 4:.1f}" fill="white" stroke="black" '
                f'stroke-width="3" paint-order="stroke">{label}</text>'
            )
    for axis, name in ((tuning.grid.gyro_var, "gyro"), (tuning.grid.accel_var, "accel")):
        for k in np.linspace(0, len(axis) - 1, 5).round().astype(int).tolist():
            x, y, anchor = left + (k + 0.5) * dx, top + size + 16.0, "middle"
            if name == "accel":
                x, y, anchor = left - 6.0, top + size - (k + 0.5) * dy + 4.0, "end"
            parts.append(
                f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{axis[k]:.2g}</text>'
            )
    middle = left + size / 2.0
    parts.append(
        f'<text x="{middle}" y="{top + size + 36:.0f}" text-anchor="middle">'
        "zupt_gyro_var, (rad/s)² → &#160; ↑ zupt_accel_var, (m/s²)²</text>"
    )
    return parts


def _outline(cells: NDArray[np.bool_], left: float, bottom: float, dx: float, dy: float) -> str:
    """Every edge between a cell of the plateau and one that is none."""
    padded = np.pad(cells, 1)
    edges = []
    for i, j in np.argwhere(cells).tolist():
        x, y = left + j * dx, bottom - i * dy
        if not padded[i, j + 1]:
            edges.append(f"M{x:.1f} {y:.1f}h{dx:.2f}")
        if not padded[i + 2, j + 1]:
            edges.append(f"M{x:.1f} {y - dy:.1f}h{dx:.2f}")
        if not padded[i + 1, j]:
            edges.append(f"M{x:.1f} {y:.1f}v{-dy:.2f}")
        if not padded[i + 1, j + 2]:
            edges.append(f"M{x + dx:.1f} {y:.1f}v{-dy:.2f}")
    return "".join(edges)


def _position(axis: Float, value: float) -> float:
    """Where on a logarithmic axis ``value`` lies, in cells."""
    return float(np.interp(np.log(value), np.log(axis), np.arange(len(axis))))


def _mark(tuning: Tuning, row: int, column: int) -> str:
    found = tuning.plateau
    if found is not None and (row, column) == (found.row, found.column):
        return PROPOSAL
    now = (
        round(_position(tuning.grid.accel_var, tuning.now[0])),
        round(_position(tuning.grid.gyro_var, tuning.now[1])),
    )
    if (row, column) == now:
        return NOW
    return PLATEAU if found is not None and found.cells[row, column] else " "


def _shares(values: Float) -> Float:
    """Between 0 and 1 by rank: a few huge counts do not hide all the others."""
    distinct, rank = np.unique(values, return_inverse=True)
    share: Float = rank.reshape(values.shape) / max(len(distinct) - 1, 1)
    return share


def _colour(share: float) -> tuple[int, int, int]:
    at = np.linspace(0.0, 1.0, len(STOPS))
    red, green, blue = (round(float(np.interp(share, at, c))) for c in zip(*STOPS, strict=True))
    return red, green, blue
