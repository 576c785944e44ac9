# SPDX-License-Identifier: Apache-2.0
"""The page of the error budget and the program's limits are the same, and the sums come out."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from hil.budget import BY_ID, LINES, Case, Conditions, Line, judged, sources
from hil.measure import Limits, Verdict
from hil.synthesis import FOLLOWER, LEADER, NodePlan, Plan
from hil.synthesis.radio import events
from hil.timesync.fit import trailing_lines
from hil.timesync.pairs import Pairs
from hil.timesync.truth import NodeClock, Truth
from hil.wire.messages import TICK_RATE_HZ

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "error-budget.md").read_text(encoding="utf-8")
ROWS = {
    cells[0].split()[0]: cells
    for cells in (
        [cell.strip() for cell in row.strip("|").split(" | ")]
        for row in PAGE.splitlines()
        if re.match(r"\| [A-Z]\d+\b", row)
    )
}

SHORT = Conditions(conn_interval_us=7_500)
LONG = Conditions(conn_interval_us=30_000)


def as_on_page(line: Line) -> str:
    unit = "" if line.unit == "1" else f" {line.unit}"

    def cell(case: Case) -> str:
        text = f"{Limits(case.low, case.high)}{unit}"
        if case.marginal:
            text += f", marginal within {case.marginal:g}{unit}"
        return text if len(line.cases) == 1 else f"{case.condition}: {text}"

    return "; ".join(cell(case) for case in line.cases)


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.id)
def test_page_says_what_the_program_holds(line: Line) -> None:
    assert ROWS[line.id] == [line.id, line.quantity, as_on_page(line), line.arithmetic]


def test_page_has_no_line_that_the_program_has_not() -> None:
    on_page = {name for name, cells in ROWS.items() if len(cells) == 4 and name[0] not in "NS"}
    assert on_page == set(BY_ID)
    assert len(BY_ID) == len(LINES)


def test_every_limit_in_a_check_cites_a_line() -> None:
    """A string that looks like a line's id, anywhere in the checks, is one."""
    cited: set[str] = set()
    for path in (ROOT / "hil").rglob("*.py"):
        if path.relative_to(ROOT).parts[1] in (
            *("timesync", "imu", "link.py", "fusion", "pil", "calibration", "reps", "soak"),
        ):
            found = re.findall(r'"([A-Z]\d)"', path.read_text(encoding="utf-8"))
            cited |= set(found)
    assert cited <= set(BY_ID)
    assert set(BY_ID) <= cited


# --- arithmetic -----------------------------------------------------------------------------

_BINARY: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def calculate(text: str) -> float:
    """Value of an expression of numbers, + - * / ^, brackets and sqrt()."""

    def value(node: ast.expr) -> float:
        match node:
            case ast.Constant(value=int() | float() as number):
                return float(number)
            case ast.BinOp(left=left, op=op, right=right):
                return _BINARY[type(op)](value(left), value(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -value(operand)
            case ast.Call(func=ast.Name(id="sqrt"), args=[argument]):
                return math.sqrt(value(argument))
        raise ValueError(f"not arithmetic: {ast.dump(node)}")

    return value(ast.parse(text.replace("^", "**"), mode="eval").body)


def sums(text: str) -> list[tuple[str, str]]:
    """(expression, result) of every "expression = result" in a text, with an operator in it."""
    found = re.findall(r"((?:sqrt\(|[\d(])[\d.e+*/^() \-sqrt]*?) = (-?[\d.]+\d|\d+)", text)
    return [(left, right) for left, right in found if re.search(r"[-+*/^]", left)]


@pytest.mark.parametrize(("left", "right"), sums(PAGE))
def test_sum_on_the_page_comes_out(left: str, right: str) -> None:
    decimals = len(right.partition(".")[2])
    assert calculate(left) == pytest.approx(float(right), abs=0.6 * 10**-decimals)


def test_the_reader_of_sums_finds_them() -> None:
    assert len(sums(PAGE)) >= 20
    assert sums("noise: 2.58 * sqrt(3^2 + 4^2) = 12.9 ns and 20 + 3 * 7.5 = 42.5 ms") == [
        ("2.58 * sqrt(3^2 + 4^2)", "12.9"),
        ("20 + 3 * 7.5", "42.5"),
    ]
    assert calculate("2.58 * sqrt(3^2 + 4^2)") == pytest.approx(12.9)


def numbers(cell: str) -> list[float]:
    return [float(x) for x in re.findall(r"\d+(?:\.\d+)?", cell)]


SHORT_RUN = (sources.CALM, sources.SHORT_INTERVAL_S, sources.SHORT_AGE_S)
LONG_RUN = (sources.WARMING, sources.LONG_INTERVAL_S, sources.LONG_AGE_S)
Run = tuple[tuple[sources.Crystal, sources.Crystal], float, float]

TERMS: dict[str, Callable[[Run], float]] = {
    "N1": lambda run: sources.phase_per_event(run[0][0].drift_ppm, run[1]),
    "N2": lambda run: sources.phase_per_event(run[0][1].drift_ppm, run[1]),
    "N3": lambda run: sources.grids_rms_ns(*run),
    "N4": lambda run: sources.wander_curvature_rms(run[0]),
    "N5": lambda run: sources.fit_wander_rms_ns(run[0], run[2]),
    "N6": lambda run: sources.STAMP_RMS_NS,
    "N7": lambda run: sources.sync_rms_ns(*run),
    "N8": lambda run: sources.grids_skew_rms_ppb(run[0], run[1]),
    "N9": lambda run: sources.skew_lag_rms_ppb(run[0], run[2]),
    "N10": lambda run: sources.fit_rms_ns(sources.STAMP_RMS_NS, run[1], run[2]),
}


@pytest.mark.parametrize("row", TERMS)
def test_terms_on_the_page_follow_from_the_formulas(row: str) -> None:
    for cell, run in zip(ROWS[row][2:], (SHORT_RUN, LONG_RUN), strict=True):
        shown = re.match(r"[\d.]+", cell)
        assert shown is not None
        decimals = len(shown[0].partition(".")[2])
        assert TERMS[row](run) == pytest.approx(float(shown[0]), abs=0.6 * 10**-decimals)


def test_page_shows_every_term_once() -> None:
    assert set(TERMS) == {name for name in ROWS if name[0] == "N"}


def test_sources_on_the_page_follow_from_the_formulas() -> None:
    assert numbers(ROWS["S1"][3])[0] == pytest.approx(sources.STAMP_RMS_NS, abs=0.06)
    assert numbers(ROWS["S2"][3])[0] == pytest.approx(sources.DIFFERENCE_RMS_NS, abs=0.06)
    assert numbers(ROWS["S3"][2])[0] == sources.SIM_GRID_NS
    assert numbers(ROWS["S4"][2])[0] == pytest.approx(sources.SIM_PAIR_RMS_NS, abs=0.06)
    assert numbers(ROWS["S8"][2])[0] == sources.SIM_ALIAS_NS


def test_a_simple_fraction_of_the_grid_per_event_is_a_trap() -> None:
    """44.44 ppm at 7.5 ms: a third of the grid; the page says what that would cost."""
    trap = sources.grid_rms_ns(sources.Crystal(44.44), 7.5e-3, sources.SHORT_AGE_S)
    assert trap == pytest.approx(99, abs=1)
    assert "would leave 99 ns" in PAGE


@pytest.mark.parametrize("run", [SHORT_RUN, LONG_RUN], ids=["7.5 ms", "30 ms"])
def test_grid_and_wander_terms_agree_with_a_simulated_half_hour(run: Run) -> None:
    """The formulas against pairs rounded as the radio simulator rounds them, and fitted."""
    crystals, interval_s, age_s = run

    def node(plan: NodePlan, crystal: sources.Crystal) -> NodePlan:
        wander = tuple(
            {"amplitude_ppm": a, "period_s": t, "phase_rad": 0.5 * k}
            for k, (a, t) in enumerate(crystal.wander)
        )
        return replace(plan, drift_ppm=crystal.drift_ppm, wander=wander)

    plan = Plan(
        duration_s=1800.0,
        conn_interval_us=round(interval_s * 1e6),
        leader=node(LEADER, crystals[0]),
        follower=node(FOLLOWER, crystals[1]),
    )
    table, _ = events(plan)
    pairs = Pairs(table.event, table.l_tx, table.l_rx, table.f_tx, table.f_rx)
    clocks = {
        role: NodeClock(plan.node(role).clock, plan.node(role).timer_start_us)
        for role in ("leader", "follower")
    }
    truth = Truth(clocks, {}, "", True)
    error_ns = (pairs.offset_ticks - truth.offset_ticks(pairs.t_ticks_leader)) * sources.TICK_NS
    assert np.std(error_ns) == pytest.approx(sources.SIM_PAIR_RMS_NS, rel=0.05)

    t = pairs.t_ticks_leader
    at = t[1000::5]
    fit = trailing_lines(t, pairs.offset_ticks, at, sources.WINDOW_S * TICK_RATE_HZ)
    used = at + age_s * TICK_RATE_HZ
    predicted = fit.value + fit.slope * (used - at)
    fit_error_ns = (predicted - truth.offset_ticks(used)) * sources.TICK_NS
    without_compare = math.sqrt(sources.sync_rms_ns(*run) ** 2 - sources.STAMP_RMS_NS**2)
    assert np.sqrt(np.mean(fit_error_ns**2)) == pytest.approx(without_compare, rel=0.15)
    skew_error_ppb = (fit.slope - truth.skew(used)) * 1e9
    expected = sources.skew_rms_ppb(*run)
    assert np.sqrt(np.mean(skew_error_ppb**2)) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ("conditions", "run"), [(SHORT, SHORT_RUN), (LONG, LONG_RUN)], ids=["7.5 ms", "30 ms"]
)
def test_limits_cover_the_sums_and_not_much_more(conditions: Conditions, run: Run) -> None:
    rms = sources.sync_rms_ns(*run)
    for line_id, expected in (
        ("T1", sources.P99 * rms),
        ("T2", sources.PEAK * rms),
        ("T3", rms),
        ("T5", sources.P99 * sources.skew_rms_ppb(*run)),
    ):
        high = BY_ID[line_id].limits(conditions).high
        assert high is not None
        assert 1.15 * expected <= high <= 2.25 * expected, line_id


# --- choosing a case ------------------------------------------------------------------------


def test_limit_depends_on_the_condition() -> None:
    assert BY_ID["T1"].limits(SHORT).high == 150.0
    assert BY_ID["T1"].limits(Conditions(conn_interval_us=10_000)).high == 150.0
    assert BY_ID["T1"].limits(Conditions(conn_interval_us=10_001)).high == 300.0
    assert BY_ID["T1"].limits(LONG).high == 300.0
    assert BY_ID["B1"].limits(Conditions(7_500, phy=1)).low == 8500.0
    assert BY_ID["B1"].limits(Conditions(7_500, phy=1, simulated=False)).low == 9000.0
    assert BY_ID["L3"].limits(Conditions(7_500, lossy=True)).high == 0.5


@pytest.mark.parametrize("line", LINES, ids=lambda line: line.id)
def test_every_line_covers_every_condition(line: Line) -> None:
    truth = (False, True)
    for interval_us, phy, simulated, lossy in product((7_500, 4_000_000), (1, 2), truth, truth):
        limits = line.limits(Conditions(interval_us, phy, simulated, lossy))
        # Nothing can be said of the load of a processor that is not there.
        unlimited = line.id == "F4" and simulated
        assert unlimited == (limits.low is None and limits.high is None)


def test_a_line_without_a_case_says_so() -> None:
    line = Line("X1", "nothing", "1", "", (Case("never", lambda _: False, high=1.0),))
    with pytest.raises(LookupError, match="X1 has no case"):
        line.limits(SHORT)


def test_judged_takes_unit_and_limits_from_the_line() -> None:
    m = judged("a.b", 151.0, "T1", SHORT, "how")
    assert (m.unit, m.limits.high, m.budget, m.verdict) == ("ns", 150.0, "T1", Verdict.FAIL)
    assert judged("a.b", 151.0, "T1", LONG, "how").verdict is Verdict.PASS
    assert judged("a.b", 295.0, "T1", LONG, "how").verdict is Verdict.MARGINAL
    scaled = judged("a.b", 95.0, "P2", SHORT, "how", scale=100.0, unit="pairs")
    assert (scaled.limits.low, scaled.limits.high, scaled.unit) == (95.0, None, "pairs")
    with pytest.raises(LookupError, match="no line Z9"):
        judged("a.b", 0.0, "Z9", SHORT, "how")
