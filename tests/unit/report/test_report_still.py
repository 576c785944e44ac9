# SPDX-License-Identifier: Apache-2.0
"""Still figures: what is drawn lies where the numbers say, and text stays text."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hil.report import build, still
from hil.report.charts import charts
from hil.series import LimitLine, Series, histogram

Make = Callable[..., Any]


def drawn(recording: Make, *series: Series) -> ET.Element:
    (chart,) = charts("run", build([(recording(), [], series)])["recordings"][0]["series"])
    assert chart["still"]
    return ET.fromstring(str(still.render(chart["data"], "title")))


def points(path: ET.Element) -> list[tuple[float, float]]:
    """Where the pen has been, from M, L, H and V."""
    x = y = 0.0
    found = []
    for letter, numbers in re.findall(r"([MLHV])([-0-9. ]+)", path.get("d") or ""):
        values = [float(n) for n in numbers.split()]
        x = values[0] if letter in "MLH" else x
        y = values[-1] if letter in "MLV" else y
        found.append((x, y))
    return found


def of_class(figure: ET.Element, name: str) -> list[ET.Element]:
    return [e for e in figure.iter() if name in (e.get("class") or "").split()]


def test_bars_of_a_histogram_stand_in_proportion_on_the_ground(recording: Make) -> None:
    values = np.repeat([0.5, 1.5, 2.5, 3.5], [10, 40, 20, 30])
    figure = drawn(recording, histogram("h", "H", values, "ns", bins=4))
    (trace,) = of_class(figure, "trace")
    path = points(trace)
    ground = path[0][1]
    tops = [
        ground - y for (_, y), (_, after) in zip(path[1::2], path[2::2], strict=True) if y == after
    ]
    assert np.array(tops) / tops[1] == pytest.approx([0.25, 1.0, 0.5, 0.75], abs=0.01)
    widths = np.diff([path[0][0], *(x for x, _ in path[2::2])])
    assert widths == pytest.approx(np.full(4, widths[0]), abs=0.2)


def test_a_power_law_is_a_straight_line_over_log_axes(recording: Make) -> None:
    x = np.geomspace(1e-3, 1e3, 30)
    figure = drawn(recording, Series("s", "S", "s", "1", x, x**-0.5, x_log=True, y_log=True))
    (trace,) = of_class(figure, "trace")
    path = np.array(points(trace))
    line = np.polyfit(path[:, 0], path[:, 1], 1)
    assert np.polyval(line, path[:, 0]) == pytest.approx(path[:, 1], abs=0.2)
    # Six decades across and three down, of a picture drawn to scale.
    six = still.WIDTH - still.LEFT - still.RIGHT
    three = still.HEIGHT - still.TOP - still.BOTTOM
    decades = math.log10(1e3) - math.log10(1e-3)
    assert line[0] == pytest.approx(0.5 * decades * (three / _decades(figure)) / six, rel=0.05)


def _decades(figure: ET.Element) -> float:
    """Of the y axis, from its lowest and highest label."""
    labels = [e.text or "" for e in of_class(figure, "tick") if e.get("text-anchor") == "end"]
    values = [float(t.replace("\u2212", "-").replace("\u202f", "")) for t in labels]
    return math.log10(max(values) / min(values))


def test_limits_are_drawn_where_they_are_or_named_when_far(recording: Make) -> None:
    near, far = LimitLine(5.0, "near, T1"), LimitLine(500.0, "far, T2")
    low = LimitLine(-500.0, "low, T3", "below")
    values = np.linspace(0.0, 4.0, 50)
    figure = drawn(recording, histogram("h", "H", values, "ns", limits=(near, far, low)))
    (line,) = of_class(figure, "limit-line")
    path = points(of_class(figure, "trace")[0])
    left, right = path[0][0], path[-1][0]
    at = points(line)[0][0]
    assert (at - left) / (right - left) == pytest.approx(5.0 / 4.0, abs=0.01)
    assert [e.text for e in of_class(figure, "limit-name")] == [
        "near, T1",
        "far, T2 \u2192",
        "low, T3 \u2190",
    ]


def test_text_stays_text_and_nothing_is_no_crash(recording: Make) -> None:
    evil = LimitLine(1.0, "</svg><script>alert(1)</script>")
    figure = drawn(recording, histogram("h", "H", [1.0, 1.0, 1.0], "ns", limits=(evil,)))
    assert not [e for e in figure.iter() if e.tag == "script"]
    constant = np.ones(4)
    drawn(recording, Series("s", "S", "s", "1", np.arange(1.0, 5.0), constant, x_log=True))
    zeros = np.zeros(4)
    drawn(recording, Series("s", "S", "s", "1", np.arange(1.0, 5.0), zeros, x_log=True, y_log=True))
