# SPDX-License-Identifier: Apache-2.0
"""Packed chart data unpack to what was measured; axes name quantity, unit and clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hil.report import build
from hil.report.charts import charts
from hil.series import LimitLine, Series

Make = Callable[..., Any]


def made(recording: Make, *series: Series) -> list[dict[str, Any]]:
    return charts("run", build([(recording(), [], series)])["recordings"][0]["series"])


def unpacked(packed: dict[str, Any]) -> np.ndarray[Any, Any]:
    """As the page's script does it."""
    if "v" in packed:
        return np.array(packed["v"], float)
    counts = np.cumsum(packed["d"]) if "d" in packed else np.array(packed["k"], float)
    return np.asarray(packed["o"] + counts * packed["s"])


def test_packing_keeps_time_to_a_millionth_of_the_run(recording: Make) -> None:
    x = 1000.0 + np.cumsum(np.random.default_rng(1).uniform(0.001, 0.02, 5000))
    (chart,) = made(recording, Series("s", "S", "s", "ns", x, x))
    (trace,) = chart["data"]["traces"]
    assert np.max(np.abs(unpacked(trace["x"]) - x)) < 1e-6 * (x[-1] - x[0])


def test_packing_keeps_small_values_beside_a_large_outlier(recording: Make) -> None:
    x = np.arange(2000.0)
    y = np.random.default_rng(1).normal(0.0, 40.0, x.size)
    y[7] = 1e9
    y[9] = np.nan
    (chart,) = made(recording, Series("s", "S", "s", "ns", x, y))
    (trace,) = chart["data"]["traces"]
    back = unpacked(trace["y"])
    assert np.array_equal(np.isnan(back), np.isnan(y))
    assert np.nanmax(np.abs(back - y)) < 0.1


@pytest.mark.parametrize("value", [0.0, 7.25, -1e-12])
def test_packing_of_a_constant(recording: Make, value: float) -> None:
    x = np.arange(5.0)
    (chart,) = made(recording, Series("s", "S", "s", "ns", x, np.full(5, value)))
    assert unpacked(chart["data"]["traces"][0]["y"]) == pytest.approx(np.full(5, value))


def test_axes_and_limits_share_a_readable_unit(recording: Make) -> None:
    x = np.arange(3.0)
    limits = (LimitLine(1.5e-7, "150 ns, T1"),)
    s = Series("s", "S", "s", "s", x, x * 4e-8, limits=limits, clock="leader", y_label="offset")
    data = made(recording, s)[0]["data"]
    assert data["xLabel"] == "time (s), leader's clock"
    assert data["yLabel"] == "offset (ns)"
    assert data["limits"][0]["value"] == pytest.approx(150.0)
    assert unpacked(data["traces"][0]["y"]) == pytest.approx([0.0, 40.0, 80.0], abs=0.01)


def test_a_log_axis_keeps_relative_precision(recording: Make) -> None:
    y = np.geomspace(1e-9, 1e9, 50)
    s = Series("s", "S", "s", "ns", np.arange(50.0), y, y_log=True)
    (trace,) = made(recording, s)[0]["data"]["traces"]
    assert unpacked(trace["y"]) == pytest.approx(y, rel=1e-3)


def test_an_x_that_traces_share_is_packed_once(recording: Make) -> None:
    x = np.arange(50.0)
    a, b = (Series(n, n, "s", "ns", x, x, plot="p", clock="leader") for n in "ab")
    c = Series("c", "c", "s", "ns", x[:20], x[:20], plot="p", clock="leader")
    first, second, third = made(recording, a, b, c)[0]["data"]["traces"]
    assert second["x"] is None
    assert unpacked(first["x"]) == pytest.approx(x)
    assert unpacked(third["x"]) == pytest.approx(x[:20])


def test_only_timelines_of_the_whole_run_move_together(recording: Make) -> None:
    long, short = np.arange(60.0), np.arange(5.0)
    found = made(
        recording,
        Series("a", "A", "s", "ns", long, long, clock="leader"),
        Series("b", "B", "s", "ns", long, long, clock="leader"),
        Series("c", "C", "s", "ns", short, short, clock="leader"),
        Series("d", "D", "s", "ns", long, long, clock="bench"),
    )
    groups = [c["data"]["group"] for c in found]
    assert groups[0] == groups[1] != ""
    assert groups[2] == ""
    assert groups[3] not in ("", groups[0])


def test_an_empty_series_is_said_and_not_drawn(recording: Make) -> None:
    nothing = np.zeros(0)
    (chart,) = made(recording, Series("s", "S", "s", "ns", nothing, nothing))
    assert chart["empty"]
