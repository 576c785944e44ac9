# SPDX-License-Identifier: Apache-2.0
"""Repetitions: figures worked out by hand on sine strokes, counts on seeded sets of the core."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from hil.core import Estimator
from hil.errors import RecordingError
from hil.motion.lifts import FLOOR_Z_M, Lift
from hil.motion.plan import Plan
from hil.parity import batch
from hil.reference.params import Params
from hil.reference.study import simulate
from hil.reps import of_outputs, repetitions, show
from hil.reps.study import asked, count
from hil.tools_cli import reps as command
from tests.unit.strokes import DOWN, STAND, UP
from tests.unit.strokes import strokes as at_rate

RATE_HZ = 500.0
strokes = partial(at_rate, rate_hz=RATE_HZ)
CLEAN = Path(__file__).parents[3] / "fixtures/recordings/clean-7ms5"


def test_figures_of_a_sine_stroke_are_those_worked_out_by_hand():
    trace = strokes(STAND, DOWN, (0.0, 0.5), UP, STAND)
    # The bar leans by 3 degrees while it is lowered, and 9 while it stands before.
    trace.tilt_rad[(trace.t_s > 101.2) & (trace.t_s < 101.4)] = math.radians(-3.0)
    trace.tilt_rad[trace.t_s < 100.5] = math.radians(9.0)
    (one,) = repetitions(trace).repetitions
    f = one.figures
    # v = V sin(pi t / T), V = pi travel / 2 T = 0.9817 up and 0.7854 down. Phases begin and end at
    # 0.05 m/s: T/pi asin(0.05 / V) = 12.98 ms inside of the upward stroke, 20.28 of the other.
    assert f.peak_mps == pytest.approx(0.98175, abs=1e-4)
    assert f.time_to_peak_s == pytest.approx(0.4 - 0.01298, abs=2e-3)
    duration = 0.8 - 2 * 0.01298
    travel = 0.5 * math.cos(math.pi * 0.01298 / 0.8)
    assert f.mean_mps == pytest.approx(travel / duration, abs=1e-4)
    assert f.range_m == pytest.approx(travel, abs=1e-3)
    assert f.eccentric_s == pytest.approx(1.0 - 2 * 0.02028, abs=4e-3)
    assert f.pause_s == pytest.approx(0.5 + 0.01298 + 0.02028, abs=4e-3)
    assert f.tilt_deg == pytest.approx(-3.0)
    assert (one.kind, one.start) == ("full", "paused")


def test_touch_and_go_has_no_pause_and_a_first_lift_from_the_floor_none_at_all():
    found = repetitions(strokes(STAND, UP, DOWN, UP, DOWN, STAND))
    assert [r.start for r in found.full] == ["from rest", "touch-and-go"]
    # From the floor the bar is lowered after the lift: both have an eccentric phase.
    assert [r.figures.eccentric_s for r in found.full] == pytest.approx([0.96, 0.96], abs=0.01)
    assert math.isnan(found.full[0].figures.pause_s)


def test_velocity_loss_is_from_the_fastest_to_the_last_full_repetition():
    slow, slower = (0.5, 1.0), (0.5, 1.25)
    found = repetitions(strokes(STAND, DOWN, slow, DOWN, UP, DOWN, slower, STAND))
    # Travel over time between the crossings of 0.05 m/s, which lie T/pi asin(0.05 / V) inside:
    # 0.4994 m in 0.7740 s, 0.4984 m in 1.1866 s.
    assert found.velocity_loss_percent == pytest.approx(100 * (1 - 0.42003 / 0.64512), abs=0.1)
    assert math.isnan(repetitions(strokes(STAND, DOWN, UP, STAND)).velocity_loss_percent)


def test_a_short_repetition_is_counted_apart_and_the_share_decides():
    half = [(-0.25, 0.6), (0.25, 0.6)]
    trace = strokes(STAND, DOWN, UP, DOWN, UP, *half, DOWN, UP, STAND)
    found = repetitions(trace)
    assert [r.kind for r in found.repetitions] == ["full", "full", "partial", "full"]
    assert [r.kind for r in repetitions(trace, 0.4).repetitions] == ["full"] * 4
    with pytest.raises(ValueError, match="between 0 and 1"):
        repetitions(trace, 1.0)


def test_leaving_the_rack_and_coming_back_is_no_repetition():
    unrack, rack = (0.2, 0.8), [(0.15, 0.6), (-0.35, 1.0)]
    found = repetitions(strokes(STAND, unrack, STAND, DOWN, UP, DOWN, UP, STAND, *rack, STAND))
    assert len(found.repetitions) == 2
    assert len(found.racking) == 2
    # Lowered first, the same rise is a repetition.
    found = repetitions(strokes(STAND, (-0.2, 0.8), (0.2, 0.8), DOWN, UP, DOWN, UP, STAND))
    assert [r.kind for r in found.repetitions] == ["partial", "full", "full"]


def test_a_small_dip_before_the_bar_leaves_its_rack_makes_no_repetition_of_it():
    found = repetitions(strokes(STAND, (-0.04, 0.4), (0.2, 0.8), STAND, DOWN, UP, DOWN, UP, STAND))
    assert [r.kind for r in found.repetitions] == ["full", "full"]


@pytest.mark.parametrize(
    ("q", "tilt_deg"),
    [
        # About y by -5 degrees: x turns up. About x and z alone the bar stays level.
        ((math.cos(math.radians(2.5)), 0.0, -math.sin(math.radians(2.5)), 0.0), 5.0),
        ((0.8, 0.6, 0.0, 0.0), 0.0),
        ((0.8, 0.0, 0.0, 0.6), 0.0),
        # x to z, the one that turns -120 degrees about (1, -1, 1).
        ((0.5, 0.5, -0.5, 0.5), 90.0),
        ((0.5, 0.5, 0.5, 0.5), 0.0),
    ],
)
def test_tilt_is_the_angle_of_the_bars_axis(q, tilt_deg):
    rows = np.zeros(5, Estimator(Params()).dtype)
    rows["t_ticks"] = 40_000 * np.arange(5)
    rows["q"] = q
    (trace,) = of_outputs(rows)
    assert np.degrees(trace.tilt_rad) == pytest.approx([tilt_deg] * 5, abs=1e-6)


def test_a_clean_and_its_jerk_are_one_repetition():
    jerk = [(0.8, 0.8), (-0.25, 0.4), (0.5, 0.8), STAND, (-0.15, 0.4), (0.4, 0.5)]
    found = repetitions(strokes(STAND, *jerk, STAND, (-1.3, 1.5), STAND, *jerk, STAND))
    assert [len(r.phases) for r in found.full] == [3, 3]
    assert found.full[0].figures.range_m == pytest.approx(1.3, abs=0.01)


def test_nothing_moves_nothing_is_found():
    found = repetitions(strokes(STAND, STAND))
    assert (found.repetitions, found.racking) == ((), ())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rests", [False, True])
def test_seeded_sets_are_counted_right(seed, rests):
    one = count(seed, rests)
    assert one.right, str(one)
    assert one.starts_right, str(one)


def test_a_wrong_count_is_not_right():
    assert asked(0, False) == ("bench", 8)
    one = count(0, False)
    assert one.right
    assert not dataclasses.replace(one, full=7).right
    assert not dataclasses.replace(one, partial=1).right
    assert not dataclasses.replace(one, bounced=3).starts_right


def bench_with_a_short_one() -> Lift:
    """Four benches; the second goes down only to 45 %."""
    plan = Plan(np.random.default_rng(8), 1.0)
    plan.lie()
    plan.rest(2.0)
    plan.move(1.0, 1.12)
    plan.hold(0.8)
    for travel in (0.48, 0.22, 0.48, 0.48):
        speed = 0.5 if travel > 0.3 else 0.3
        plan.stroke(-travel, speed, None, 2.5)
        plan.stroke(travel, 0.6 if travel > 0.3 else 0.35, 2.5, None)
        plan.hold(0.4)
    plan.move(1.0, 1.0)
    plan.lie()
    plan.rest(1.5)
    return Lift("short", 8, plan.finish(), tuple(plan.still_spans_s), (), ())


def test_a_partial_repetition_is_found_in_estimates():
    assert FLOOR_Z_M < 1.0
    for seed in range(3):
        samples = batch(*simulate(bench_with_a_short_one(), seed))
        outputs = Estimator(Params()).run(samples.leader, samples.follower, samples.arrival).outputs
        (trace,) = of_outputs(outputs)
        found = repetitions(trace)
        assert [r.kind for r in found.repetitions] == ["full", "partial", "full", "full"]
        assert found.repetitions[1].figures.range_m == pytest.approx(0.22, abs=0.03)


def test_a_gap_parts_traces_and_what_is_not_finite_is_left_out():
    samples = batch(*simulate(bench_with_a_short_one(), 1))
    outputs = Estimator(Params()).run(samples.leader, samples.follower, samples.arrival).outputs
    rows = outputs.copy()
    rows["centre_velocity_mps"][100] = np.nan
    rows["t_ticks"][len(rows) // 2 :] += 16_000_000
    first, second = of_outputs(rows)
    assert len(first.t_s) + len(second.t_s) == len(rows) - 1


def test_the_command_shows_and_writes_the_same_repetitions(tmp_path):
    app = typer.Typer()
    app.command()(command)
    files = {"--csv": tmp_path / "reps.csv", "--json": tmp_path / "reps.json"}
    arguments = [str(CLEAN), *(str(x) for pair in files.items() for x in pair)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    # The scenario asks for eight benches with rests.
    assert "8 repetitions, 0 partial" in result.output
    rows = list(csv.DictReader(io.StringIO(files["--csv"].read_text())))
    said = json.loads(files["--json"].read_text())
    assert len(rows) == len(said["repetitions"]) == 8
    assert [float(r["mean_mps"]) for r in rows] == [r["mean_mps"] for r in said["repetitions"]]
    assert said["sets"][0]["full"] == 8


def test_what_is_not_known_is_empty_in_every_form():
    found = [repetitions(strokes(STAND, UP, DOWN, STAND))]
    (row,) = show.rows(found)
    assert row["pause_s"] is None
    assert json.loads(show.as_json(found))["sets"][0]["velocity_loss_percent"] is None
    assert ",," in show.as_csv(found)


def test_a_recording_without_estimates_or_batches_is_a_clear_error():
    from hil.recording import load  # noqa: PLC0415
    from hil.reps import of_recording  # noqa: PLC0415

    recording = load(CLEAN / "recording.mcap")
    empty = dataclasses.replace(
        recording, serial={k: v for k, v in recording.serial.items() if k != "leader"}
    )
    with pytest.raises(RecordingError, match="neither EKF frames nor IMU batches"):
        of_recording(empty)


def test_without_frames_the_hosts_core_gives_the_same_repetitions(monkeypatch):
    from hil.recording import load  # noqa: PLC0415
    from hil.reps import of_recording, trace  # noqa: PLC0415

    recording = load(CLEAN / "recording.mcap")
    (sent,) = of_recording(recording)
    real = trace.frames
    monkeypatch.setattr(
        trace,
        "frames",
        lambda r, role, name: real(r, role, name)[: 0 if name == "ekf_state" else None],
    )
    (host,) = of_recording(recording)
    # Frames are every fourth step.
    assert len(host.t_s) == pytest.approx(4 * len(sent.t_s), rel=0.01)
    for a, b in zip(repetitions(sent).full, repetitions(host).full, strict=True):
        assert a.figures.mean_mps == pytest.approx(b.figures.mean_mps, abs=0.002)
        assert a.figures.peak_mps == pytest.approx(b.figures.peak_mps, abs=0.005)
