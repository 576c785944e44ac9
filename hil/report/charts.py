# SPDX-License-Identifier: Apache-2.0
"""Series of the report document -> charts: timelines packed small for the page's script to draw,
histograms and curves over a logarithmic axis as plain numbers for a still figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from hil.report import text as texts

Chart = dict[str, Any]

_X_DIGITS: Final = 1e-6
"""Step of packed x over the span of x: finer than a pixel at a zoom of a hundred."""

_Y_DIGITS: Final = 1e-4
"""Step of packed y over the span in which most of y lies."""

_CLOCKS: Final[Mapping[str, str]] = {
    "bench": "bench clock",
    "leader": "leader's clock",
    "follower": "follower's clock",
    "node": "node's clock",
}


def charts(run_id: str, series: Sequence[Mapping[str, Any]]) -> list[Chart]:
    """One chart per ``plot``; a series without one is a chart of its own."""
    grouped: dict[str, list[Mapping[str, Any]]] = {}
    for s in series:
        grouped.setdefault(s["plot"] or s["name"], []).append(s)
    found = [_chart(run_id, key, traces) for key, traces in grouped.items()]
    longest = max((c["span"] for c in found), default=0.0)
    for chart in found:
        # A close-up of the start does not move together with timelines of the whole run.
        if chart["span"] < longest / 2:
            chart["data"]["group"] = ""
    return found


def _chart(run_id: str, key: str, traces: list[Mapping[str, Any]]) -> Chart:
    first = traces[0]
    kind = "histogram" if first["kind"] == "histogram" else "timeline"
    if any((t["kind"] == "histogram") != (kind == "histogram") for t in traces):
        raise ValueError(f"plot {key!r} mixes a histogram with a timeline")
    for name in ("x_unit", "y_unit", "x_log", "y_log"):
        if len({t[name] for t in traces}) > 1:
            raise ValueError(f"the traces of plot {key!r} differ in {name}")
    limits = _limits(traces)
    bounds = [line["value"] for line in limits]
    x_values = [v for t in traces for v in t["x"]]
    y_values = [v for t in traces for v in t["y"]]
    # A time axis stays in seconds: it is read as "how far into the run".
    time_axis = kind == "timeline" and first["x_unit"] == "s" and not first["x_log"]
    x_scale = (
        texts.Scale(1.0, "s")
        if time_axis
        else texts.scale(first["x_unit"], bounds + x_values if kind == "histogram" else x_values)
    )
    y_scale = texts.scale(first["y_unit"], y_values + (bounds if kind != "histogram" else []))
    if first["y_log"] and first["y_unit"] == "1":
        # Decades say more than parts per billion of them.
        y_scale = texts.Scale(1.0, "")
    across = x_scale if kind == "histogram" else y_scale
    several = len(traces) > 1
    still = kind == "histogram" or first["x_log"]
    trace = _plain_trace if still else _trace
    return {
        "key": key,
        "anchor": f"{run_id}/plot/{anchor(key)}",
        "span": max(x_values) - min(x_values) if time_axis and x_values else 0.0,
        "wide": time_axis,
        "still": still,
        "title": next((t["plot_title"] for t in traces if t["plot_title"]), "") or first["title"],
        "captions": list(dict.fromkeys(t["caption"] for t in traces if t["caption"])),
        "checks": list(dict.fromkeys(t["check"] for t in traces if t["check"])),
        "samples": sum(t["samples"] for t in traces),
        "thinned": any(t["kind"] != "histogram" and t["samples"] > len(t["y"]) for t in traces),
        "empty": not any(v is not None for v in y_values),
        "legend": [t["title"] for t in traces] if several else [],
        "numbers": _numbers([t for t in traces if t["statistics"]], y_scale),
        "data": {
            "kind": kind,
            "group": f"{run_id}|{first['clock']}" if time_axis else "",
            "xLabel": _axis(first["x_label"], x_scale.unit, first["clock"]),
            "yLabel": _axis(
                "" if several and not first["y_label"] else first["y_label"],
                y_scale.unit,
                first["y_clock"],
            ),
            "xUnit": x_scale.unit,
            "yUnit": y_scale.unit,
            "xLog": first["x_log"],
            "yLog": first["y_log"],
            "limits": [{**line, "value": line["value"] / across.factor} for line in limits],
            "traces": _shared([trace(t, x_scale.factor, y_scale.factor) for t in traces]),
        },
    }


def anchor(key: str) -> str:
    """``key`` as part of a link."""
    return "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in key)


def _limits(traces: list[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    found: list[Mapping[str, Any]] = []
    for trace in traces:
        found += [line for line in trace["limits"] if line not in found]
    return found


def _axis(label: str, unit: str, clock: str) -> str:
    words = f"{label} ({unit})" if unit else label
    return f"{words}, {_CLOCKS.get(clock, clock)}" if clock else words


_STATISTICS: Final[Mapping[str, str]] = {
    "minimum": "Smallest",
    "p01": "1st percentile",
    "median": "Median",
    "p99": "99th percentile",
    "maximum": "Largest",
    "standard_deviation": "Standard deviation",
}


def _numbers(traces: Sequence[Mapping[str, Any]], scale: texts.Scale) -> dict[str, Any] | None:
    """A small table in words: one column per trace, one row per statistic."""
    if not traces:
        return None
    unit = f" {scale.unit}" if scale.unit else ""

    def values(key: str) -> list[str]:
        return [texts.number(t["statistics"][key] / scale.factor) + unit for t in traces]

    return {
        "titles": [t["title"] for t in traces],
        "rows": [
            ("Samples", [texts.number(t["samples"]) for t in traces]),
            *((title, values(key)) for key, title in _STATISTICS.items()),
        ],
    }


def _trace(trace: Mapping[str, Any], x_factor: float, y_factor: float) -> dict[str, Any]:
    x = [v / x_factor for v in trace["x"]]
    y = [None if v is None else v / y_factor for v in trace["y"]]
    return {
        "label": trace["title"],
        "kind": trace["kind"],
        "x": _pack(x, (max(x) - min(x)) * _X_DIGITS if x else 0.0, delta=True),
        "y": _pack(y, _y_step(y), delta=False)
        if not trace["y_log"]
        else {"v": [_short(v) for v in y]},
    }


def _shared(traces: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """An x that is that of the first trace is not said twice."""
    first, *others = traces
    for trace in others:
        if "o" in first["x"] and trace["x"] == first["x"]:
            trace["x"] = None
    return traces


def _plain_trace(trace: Mapping[str, Any], x_factor: float, y_factor: float) -> dict[str, Any]:
    """As numbers: a still figure is drawn here and not in the page."""
    return {
        "label": trace["title"],
        "kind": trace["kind"],
        "x": [v / x_factor for v in trace["x"]],
        "y": [None if v is None else v / y_factor for v in trace["y"]],
    }


def _y_step(y: Sequence[float | None]) -> float:
    """Fine enough for where most values lie, whatever a few outliers do."""
    found = sorted(v for v in y if v is not None)
    if not found:
        return 0.0
    spread = found[(len(found) * 9) // 10] - found[len(found) // 10]
    return (spread or found[-1] - found[0]) * _Y_DIGITS


def _pack(values: Sequence[float | None], step: float, *, delta: bool) -> dict[str, Any]:
    """Whole multiples of a step above an origin; ``d``: each as difference to the one before."""
    found = [v for v in values if v is not None]
    origin = min(found, default=0.0)
    step = 10.0 ** math.floor(math.log10(step)) if step > 0 else 1.0
    counts = [None if v is None else round((v - origin) / step) for v in values]
    packed: dict[str, Any] = {"o": origin, "s": step}
    if delta:
        whole = [c for c in counts if c is not None]
        packed["d"] = [b - a for a, b in zip([0, *whole], whole, strict=False)]
    else:
        packed["k"] = counts
    return packed


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")
