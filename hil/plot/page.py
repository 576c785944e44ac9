# SPDX-License-Identifier: Apache-2.0
"""A figure as a page of its own that zooms: drawn by the report's script, under its policy."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from hil.plot.figure import Figure, Panel
from hil.report.decimate import min_max
from hil.report.html import island
from hil.report.page import asset, policy, template

POINTS_MAX: Final = 2000
DIGITS: Final = 7


def html(figure: Figure) -> str:
    """The page: no network, no other file."""
    styles = asset("uplot/uPlot.min.css") + asset("report.css") + asset("plot.css")
    early, late = asset("theme.js"), asset("uplot/uPlot.iife.min.js") + "\n" + asset("report.js")
    panels = [
        {
            "anchor": f"plot-{n}",
            "title": panel.title,
            "wide": len(row) == 1,
            "y_label": panel.unit,
            "legend": _labels(panel) if len(panel.traces) > 1 else [],
            "data": _data(figure, panel),
        }
        for n, (row, panel) in enumerate((row, p) for row in figure.panels for p in row)
    ]
    page: str = template("plot.html").render(
        figure=figure,
        panels=panels,
        version=version("hil"),
        styles=Markup(styles),  # noqa: S704 (our own assets)
        early_script=Markup(early),  # noqa: S704
        late_script=Markup(late),  # noqa: S704
        policy=policy(styles, (early, late)),
        chart_data=island({one["anchor"]: one["data"] for one in panels}),
    )
    return page


def _data(figure: Figure, panel: Panel) -> dict[str, Any]:
    """A chart as :mod:`hil.report.charts` makes it, with spans behind and bands around traces."""
    traces: list[dict[str, Any]] = []
    edges: list[dict[str, Any]] = []
    bands: list[dict[str, Any]] = []
    for n, (one, label) in enumerate(zip(panel.traces, _labels(panel), strict=True)):
        t, y = min_max(one.t_s, one.y, POINTS_MAX)
        traces.append(_trace(label, t, y))
        if one.sigma is not None:
            sigma = np.interp(t, one.t_s, one.sigma)
            first = 1 + len(panel.traces) + len(edges)
            edges += [
                _trace(f"{one.label} +1 σ", t, y + sigma, "edge"),
                _trace(f"{one.label} −1 σ", t, y - sigma, "edge"),
            ]
            bands.append({"series": [first, first + 1], "colour": n})
    if len(traces) == 1:
        # Times that are those of the first trace are not said again.
        edges = [{**edge, "x": None} for edge in edges]
    return {
        "kind": "timeline",
        "group": "figure",
        "xLabel": "time (s), leader's clock",
        "yLabel": panel.unit,
        "xUnit": "s",
        "yUnit": panel.unit,
        "xLog": False,
        "yLog": False,
        "limits": [],
        "traces": traces + edges,
        "bands": bands,
        "spans": [
            *({"from": a, "to": b, "kind": "still"} for a, b in figure.still),
            *({"from": a, "to": b, "kind": "repetition"} for a, b in figure.repetitions),
        ],
    }


def _labels(panel: Panel) -> list[str]:
    """Names of the traces; of rows, with the height that each is drawn at."""
    count = len(panel.rows)
    return [f"{count - 1 - k}: {t.label}" if count else t.label for k, t in enumerate(panel.traces)]


def _trace(
    label: str, t: NDArray[np.float64], y: NDArray[np.float64], kind: str = "line"
) -> dict[str, Any]:
    return {
        "label": label,
        "kind": kind,
        "x": {"v": [round(v, 5) for v in t.tolist()]},
        "y": {"v": [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in y.tolist()]},
    }
