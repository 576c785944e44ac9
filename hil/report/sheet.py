# SPDX-License-Identifier: Apache-2.0
"""Still figures in one file that stands alone: SVG, or a page around it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from markupsafe import Markup

from hil.report import still

HEAD: Final = 40
STYLE: Final = Markup(
    "text{font:12px sans-serif;fill:#333}path{fill:none}.grid{stroke:#ddd}.trace{stroke-width:1.6}"
    ".s0{stroke:#0072b2}.s1{stroke:#d55e00}.limit-line{stroke:#777;stroke-dasharray:5 4}"
    ".limit-name{fill:#555}.beyond{fill:none}.title{font-size:15px}"
)
"""Okabe and Ito's blue and vermilion, which all eyes tell apart."""


def svg(figures: Sequence[tuple[str, Mapping[str, Any]]], columns: int = 1) -> Markup:
    """Titled figures in rows; each as :func:`hil.report.still.render` takes it."""
    width, height = still.WIDTH, still.HEIGHT + HEAD
    panels = [
        Markup(
            '<svg x="{}" y="{}" width="{}" height="{}"><text class="title" id="t{}" x="{}" y="24">'
            '{}</text><svg y="{}" width="{}" height="{}">{}</svg></svg>'
        ).format(
            *(k % columns * width, k // columns * height, width, height, k, still.LEFT, title),
            *(HEAD - 4, still.WIDTH, still.HEIGHT, still.render(data, f"t{k}")),
        )
        for k, (title, data) in enumerate(figures)
    ]
    size = columns * width, math.ceil(len(panels) / columns) * height
    return Markup(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}"><style>{2}</style>'
        '<rect width="{0}" height="{1}" fill="white"/>{3}</svg>\n'
    ).format(*size, STYLE, Markup("").join(panels))


def page(title: str, drawing: Markup) -> Markup:
    """The drawing on a page of its own."""
    return Markup(
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{0}</title></head>'
        '<body style="max-width:70rem;margin:auto"><h1 style="font:1.2rem sans-serif">{0}</h1>{1}'
        "</body></html>\n"
    ).format(title, drawing)
