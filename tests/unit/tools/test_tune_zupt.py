# SPDX-License-Identifier: Apache-2.0
"""The ZUPT tuner: its detector is the core's, its counts are counts, its plateau is the widest."""

from __future__ import annotations

import csv
import io
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.core import TICKS_PER_S, Samples
from hil.errors import RecordingError
from hil.fusion.inputs import Run, runs
from hil.motion.lifts import Lift, bench, deadlift
from hil.motion.plan import Plan
from hil.parity import Batch, batch, run_core
from hil.recording import load
from hil.reference.params import Params
from hil.reference.study import Link, simulate
from hil.tuning import heatmap, kept, zupt
from hil.tuning.cli import app
from hil.tuning.grid import Grid, KnownMotion, Table, around, count
from hil.tuning.parameters import ParameterError
from hil.tuning.plateau import depths, largest, plateau
from hil.tuning.statistics import Statistics, statistics

RECORDINGS = Path(__file__).parents[3] / "fixtures/recordings"
STILL = 2
"""Bit of the flags: the detector fired, gate or not (protocol table)."""


@cache
def fed(name: str) -> Batch:
    lift = {"bench": bench(21, reps=2), "deadlift": deadlift(22, reps=2, rests=True)}[name]
    return batch(*simulate(lift, 7), Link(lost_s=((0.9, 1.2), (3.0, 4.5))))


def run_of(name: str, params: Params | None = None) -> Run:
    if name in ("bench", "deadlift"):
        return Run(fed(name), params or Params(), 0, 0)
    return runs(load(RECORDINGS / name / "recording.mcap"))[-1]


@pytest.mark.parametrize("name", ["bench", "deadlift", "reconnect"])
@pytest.mark.parametrize(("accel", "gyro"), [(4e-4, 1.2e-4), (2e-4, 3e-5), (4e-3, 1e-3)])
def test_the_detector_is_the_cores_step_by_step(name, accel, gyro):
    run = run_of(name)
    s = statistics(run)
    core = run_core(run.samples, replace(run.params, zupt_accel_var=accel, zupt_gyro_var=gyro))
    fired = (core["flags"] & STILL) != 0
    assert fired.any()
    assert not fired.all()
    assert np.array_equal(fired, (s.accel_var < accel) & (s.gyro_var < gyro))


@pytest.mark.parametrize(
    "params",
    [
        Params(prefilter_iir=True),
        Params(zupt_window=20, zupt_dwell=11, zupt_release=2.5),
        Params(zupt_level_mps2=0.01, average_length=1),
        Params(zupt_gyro_var=4e-6),
    ],
)
def test_so_it_is_with_other_filters_and_windows(params):
    run = run_of("deadlift", params)
    s = statistics(run)
    fired = (s.outputs["flags"] & STILL) != 0
    assert fired.any() or params.zupt_level_mps2 < 0.1
    now = (s.accel_var < params.zupt_accel_var) & (s.gyro_var < params.zupt_gyro_var)
    assert np.array_equal(fired, now)


def test_without_a_follower_the_leader_decides_alone():
    leader, _ = simulate(deadlift(22, reps=1), 7)
    run = Run(batch(leader, None), Params(), 0, 0)
    s = statistics(run)
    fired = (s.outputs["flags"] & STILL) != 0
    assert fired.any()
    assert np.array_equal(fired, (s.accel_var < 4e-4) & (s.gyro_var < 1.2e-4))


def test_the_shoe_detector_has_other_thresholds():
    with pytest.raises(ParameterError, match="zupt_shoe=false"):
        statistics(run_of("bench", Params(zupt_shoe=True)))


def made(accel: list[float], gyro: list[float]) -> Statistics:
    n = len(accel)
    return Statistics(np.arange(n), 0.5, np.array(accel), np.array(gyro), np.zeros(n, "f4"))


def test_counts_are_those_counted_by_hand():
    inf = np.inf
    s = made([1, 1, 3, 1, inf, 1, 1], [1, 1, 1, 3, 1, 1, 1])
    grid = Grid(np.array([1.0, 2.0, 4.0]), np.array([2.0, 4.0]))
    moving = np.array([0, 1, 0, 0, 0, 1, 1], bool)
    table = count(s, grid, KnownMotion(moving, [(2, 4), (4, 5)]))
    # A step fires where both thresholds lie above it: never at 1.0, which is not above 1.
    assert table.steps.tolist() == [[0, 0], [4, 5], [5, 6]]
    assert table.spans.tolist() == [[0, 0], [2, 3], [2, 2]]
    assert table.false_spans.tolist() == [[0, 0], [2, 2], [2, 2]]
    assert table.missed.tolist() == [[2, 2], [2, 1], [1, 1]]


def test_counts_are_those_of_each_cell_by_itself():
    rng = np.random.default_rng(5)
    s = made(*(np.exp(rng.normal(size=(2, 500))).tolist()))
    grid = Grid(np.geomspace(0.2, 5.0, 7), np.geomspace(0.3, 3.0, 5))
    moving = rng.random(500) < 0.3
    table = count(s, grid, KnownMotion(moving, [(10, 40), (60, 61)]))
    for i, accel in enumerate(grid.accel_var):
        for j, gyro in enumerate(grid.gyro_var):
            on = (s.accel_var < accel) & (s.gyro_var < gyro)
            assert table.steps[i, j] == on.sum()
            assert table.spans[i, j] == np.sum(np.diff(np.r_[0, on]) == 1)
            assert table.false_spans[i, j] == np.sum(np.diff(np.r_[0, on & moving]) == 1)
            assert table.missed[i, j] == (not on[10:40].any()) + (not on[60])


def table_with(spans: list[list[int]], false_spans: list[list[int]] | None = None) -> Table:
    counts = np.array(spans)
    wrong = None if false_spans is None else np.array(false_spans)
    return Table(counts, counts, wrong, None if wrong is None else 0 * wrong, 9, 0.5, 1)


def test_the_plateau_is_the_largest_connected_region_and_the_proposal_its_depth():
    spans = [
        [0, 0, 0, 0, 0, 0],
        [5, 5, 5, 7, 0, 5],
        [5, 5, 5, 7, 7, 5],
        [5, 5, 5, 7, 7, 5],
        [9, 9, 5, 9, 9, 5],
    ]
    grid = Grid(np.geomspace(1.0, 81.0, 5), np.geomspace(1.0, 32.0, 6))
    found = plateau(grid, [table_with(spans)])
    assert found is not None
    assert found.cells.sum() == 10
    assert (found.row, found.column) == (2, 1)
    # One cell to each side is 3 along one axis and 2 along the other: the less counts.
    assert found.margin == pytest.approx(2.0)


def test_false_spans_and_missed_rests_are_no_plateau():
    spans = [[5, 5, 5], [5, 5, 5], [7, 7, 7]]
    grid = Grid(np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.0, 4.0]))
    found = plateau(grid, [table_with(spans, [[1, 1, 1], [1, 1, 1], [0, 0, 0]])])
    assert found is not None
    assert found.cells.tolist() == [[False] * 3, [False] * 3, [True] * 3]
    assert found.margin == 1.0
    assert plateau(grid, [table_with(spans, [[1] * 3] * 3)]) is None
    assert plateau(grid, [table_with([[0] * 3] * 3)]) is None


def test_regions_are_joined_along_axes_and_eroded_by_squares():
    cells = np.array([[1, 0, 0], [0, 1, 1], [0, 0, 1]], bool)
    region = largest(cells, np.ones((3, 3, 1), np.int64))
    assert region is not None
    assert region.sum() == 3
    assert depths(np.ones((5, 7), bool)).max() == 3
    assert depths(np.ones((5, 7), bool))[2].tolist() == [1, 2, 3, 3, 3, 2, 1]


@cache
def ten_minutes() -> tuple[Lift, Batch]:
    """Deadlifts with rests and hands that hold, one after the other, for ten minutes."""
    plan = Plan(np.random.default_rng(3), 0.225)
    plan.lie()
    while plan.t_s < 600.0:
        plan.rest(plan.rng.uniform(1.2, 2.5))
        plan.stroke(0.5, plan.rng.uniform(0.5, 0.8), None, None)
        plan.hold(plan.rng.uniform(0.5, 1.5))
        plan.stroke(0.225 - plan.z_m, 0.5, None, None)
        plan.lie()
    plan.rest(1.0)
    lift = Lift("long", 3, plan.finish(), tuple(plan.still_spans_s), (), ())
    leader, follower = simulate(lift, 3)
    # As hil.parity.batch has it, without its objects: four follower samples at a time, 12 ms late.
    own, other = (
        Samples(
            np.rint(one.t_true_s * TICKS_PER_S).astype(np.int64),
            one.accel_mps2,
            one.gyro_radps,
            one.clipped,
        )
        for one in (leader, follower)
    )
    last = np.minimum(np.arange(len(other.t_ticks)) // 4 * 4 + 3, len(other.t_ticks) - 1)
    ride = np.searchsorted(leader.t_true_s, follower.t_true_s[last] + 0.012)
    keep = ride < len(own.t_ticks)
    columns = (x[keep] for x in other.columns())
    return lift, Batch(own, Samples(*columns), ride[keep].astype(np.int64))


def test_ten_minutes_on_a_full_grid_cost_a_few_runs_of_the_core_and_the_proposal_holds():
    lift, samples = ten_minutes()
    run = Run(samples, Params(), 0, 0)
    begin = time.process_time()
    outputs = run_core(samples, run.params)
    core_s = time.process_time() - begin
    known = zupt.known_motion(lift, outputs["t_ticks"] / TICKS_PER_S, run.params)
    assert len(known.rests) > 100
    grid = around(run.params.zupt_accel_var, run.params.zupt_gyro_var)
    assert grid.shape == (40, 40)
    begin = time.process_time()
    table = count(statistics(run), grid, known)
    found = zupt.proposed(grid, ["long"], [table], run.params)
    cost = (time.process_time() - begin) / core_s
    # 1600 runs of the core, were each cell run by itself.
    assert cost < 20.0, f"{cost:.1f} runs of the core"
    assert found.plateau is not None
    assert found.proposal is not None
    assert found.plateau.margin > 2.0
    assert int(table.spans[found.plateau.row, found.plateau.column]) >= len(known.rests)
    # None of these lifts is a deadlift of the run above, and their seeds are no one's.
    tried = zupt.trials(found.proposal, run.params, 5)
    assert sum(one.rests for one in tried) > 30
    assert all(one.passed for one in tried), tried


def test_a_trial_fails_on_thresholds_that_are_too_narrow_or_too_wide():
    narrow = zupt.trial(5000, (1e-5, 1.2e-4), Params(), rests=True)
    assert narrow.missed == narrow.rests > 0
    wide = zupt.trial(5001, (10.0, 1.0), replace(Params(), zupt_level_mps2=9.0), rests=True)
    assert wide.false_zupt > 0
    assert not narrow.passed
    assert not wide.passed


def test_a_recording_with_known_motion_is_counted_with_its_truth():
    (table,) = zupt.tables_of(RECORDINGS / "clean-7ms5/recording.mcap", around(4e-4, 1.2e-4, 8))
    # Eight benches on pins lie still between each two, before the first and after the last.
    assert table.rests == 10
    assert table.missed is not None
    assert table.missed[0, 0] == 10
    assert table.missed.min() == 0


def test_counts_are_kept_and_used_for_the_same_inputs_only(tmp_path, monkeypatch):
    file = RECORDINGS / "reconnect/recording.mcap"
    grid = around(4e-4, 1.2e-4, 6)
    first = zupt.tables_of(file, grid, tmp_path)
    (one,) = tmp_path.iterdir()

    def never(*_):
        raise AssertionError("counted again")

    with monkeypatch.context() as patch:
        patch.setattr(zupt, "table_of", never)
        again = zupt.tables_of(file, grid, tmp_path)
        assert np.array_equal(again[0].spans, first[0].spans)
        assert again[0].period_s == first[0].period_s
        with pytest.raises(AssertionError, match="counted again"):
            zupt.tables_of(file, around(4e-4, 1.3e-4, 6), tmp_path)
        with pytest.raises(AssertionError, match="counted again"):
            zupt.tables_of(RECORDINGS / "lossy/recording.mcap", grid, tmp_path)
    inputs = kept.of_file(file, grid)
    with monkeypatch.context() as patch:
        patch.setattr(kept, "version", lambda: "another")
        assert kept.of_file(file, grid) != inputs
    with monkeypatch.context() as patch:
        patch.setattr(kept, "ESTIMATOR_SHA256", "another")
        kept.version.cache_clear()
        assert kept.of_file(file, grid) != inputs
    kept.version.cache_clear()
    assert kept.of_file(file, grid) == inputs
    assert kept.of_file(RECORDINGS / "lossy/recording.mcap", grid) != inputs
    whole = one.read_bytes()
    for damaged in (b"", whole[:-20], whole.replace(b'"spans"', b'"spams"'), b"[" * 100_000):
        one.write_bytes(damaged)
        assert kept.read_tables(tmp_path, inputs, grid) is None
    one.write_bytes(whole)
    assert kept.read_tables(tmp_path, inputs, grid) is not None


def test_the_command_writes_csv_and_svg_and_shows_the_same(tmp_path):
    arguments = ["zupt", str(RECORDINGS / "clean-7ms5"), "-o", str(tmp_path), "--try", "1"]
    result = CliRunner().invoke(app, [*arguments, "--cells", "12"])
    assert result.exit_code == 0, result.output
    assert "plateau" in result.output
    assert "2 sets that it was not chosen on: 2 passed" in result.output
    rows = list(csv.DictReader(io.StringIO((tmp_path / "zupt.csv").read_text())))
    assert len(rows) == 144
    stated = int(result.output.split("plateau: ")[1].split(" of ")[0])
    assert sum(int(r["plateau"]) for r in rows) == stated
    good = [r for r in rows if r["plateau"] == "1"]
    assert {(r["spans"], r["false_spans"], r["missed"]) for r in good} == {
        (good[0]["spans"], "0", "0")
    }
    root = ElementTree.fromstring((tmp_path / "zupt.svg").read_text())
    assert len([e for e in root.iter() if e.tag.endswith("title")]) == 2 * 144
    assert "http" not in (tmp_path / "zupt.svg").read_text().replace("http://www.w3.org/2000", "")


def test_shades_go_by_rank_so_one_huge_count_hides_nothing():
    values = np.array([[0.0, 10.0], [20.0, 1e9]])
    assert heatmap._shares(values).ravel().tolist() == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])


def test_nothing_to_tune_on_is_a_clear_error():
    with pytest.raises(RecordingError, match="no recording to tune on"):
        zupt.tune([])
