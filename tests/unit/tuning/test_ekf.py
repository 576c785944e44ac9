# SPDX-License-Identifier: Apache-2.0
"""The search over the noise parameters: its cost by hand, its answer the same however it is run."""

from __future__ import annotations

import csv
import io
import json
import math
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.accuracy import score_seed
from hil.core import Estimator
from hil.errors import RecordingError
from hil.motion.lifts import seeded_set
from hil.reference.params import Params
from hil.tuning import case, ekf, ekf_show
from hil.tuning.axes import NOISE, Axis, around, parse
from hil.tuning.cli import app
from hil.tuning.parameters import ParameterError
from hil.tuning.score import blind, consistency, cost, evaluate
from hil.tuning.workers import _Here, workers

RECORDINGS = Path(__file__).parents[3] / "fixtures/recordings"


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        (["zupt_acel_var=1:2"], "zupt_accel_var"),
        (["zupt_variance"], "is not NAME=LOW:HIGH"),
        (["zupt_variance=1e-6"], "is not NAME=LOW:HIGH"),
        (["zupt_variance=1e-6:1e-2:lin"], "is not NAME=LOW:HIGH"),
        (["zupt_variance=1e-6:x"], "is not NAME=LOW:HIGH"),
        (["zupt_variance=1e-2:1e-6"], "no range within"),
        (["zupt_variance=nan:1"], "no range within"),
        (["zupt_variance=1e-6:10"], "no range within"),
        (["accel_walk_mps2_rts=0:0.1:log"], "begins above zero"),
        (["round_trip=0:1"], "not one number"),
        (["lever_leader_m=0:1"], "not one number"),
        (["rigid_gate=1:2", "rigid_gate=2:3"], "given twice"),
    ],
)
def test_a_wrong_range_is_said(wanted, message):
    with pytest.raises(ParameterError, match=message):
        parse(Params(), wanted)


def test_axes_have_equal_factors_and_values_that_can_be_copied():
    axis = Axis("zupt_variance", 1e-6, 1e-2, log=True)
    # A quarter of four decades.
    assert [axis.at(x) for x in (-1.0, 0.0, 0.25, 0.5, 2.0)] == [1e-6, 1e-6, 1e-5, 1e-4, 1e-2]
    assert axis.share(1e-5) == pytest.approx(0.25)
    assert axis.share(1.0) == 1.0
    assert axis.at(1 / 3) == 2.154e-5
    (whole,) = parse(Params(), ["zupt_dwell=10:20"])
    assert [whole.at(0.44), whole.share(15)] == [14, 0.5]
    assert [one.name for one in around(Params())] == list(NOISE)
    assert around(Params())[0].low == pytest.approx(Params().accel_noise_mps2_rthz / 10)


def test_the_figures_are_those_of_the_accuracy_study():
    (mine,) = evaluate(case.of_seed(2, False), [{}])
    theirs = score_seed(2, rests=False, dtype=np.float32)
    error = np.array([b.mean_mps - a.mean_mps for a, b in theirs.pairs])
    assert mine["mean_rmse_mps"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-6)
    assert mine["phases"] == len(theirs.pairs)
    assert mine["wrong"] == mine["false_zupt"] == 0.0
    # Every eighth step stands for all.
    assert mine["nees"] == pytest.approx(theirs.nees_mean, rel=0.05)


def test_the_cost_is_that_worked_out_by_hand():
    f = {"velocity_rmse_mps": 0.020, "mean_rmse_mps": 0.010, "peak_rmse_mps": 0.030}
    f |= {"phases": 4.0, "wrong": 0.0, "false_zupt": 0.0, "nees": 5.0, "nees_above": 0.0}
    # Limits of touch and go: 20 and 30 mm/s; with rests 10 and 15.
    assert cost(f, f, rests=False) == pytest.approx(1.0 + 0.25 + 1.0)
    assert cost(f, f, rests=True) == pytest.approx(4.0 + 1.0 + 4.0)
    assert cost(f | {"wrong": 2.0, "false_zupt": 7.0}, f, rests=False) == pytest.approx(32.25)
    assert cost(f | {"mean_rmse_mps": math.nan}, f) == cost({"refused": 1.0}, f) == 1000.0
    # The band ends at 12.833; e times as much is 1 outside. Of 5 % above 2.5 % are too many.
    assert consistency(f | {"nees": 12.833 * math.e}) == pytest.approx(1.0, rel=1e-4)
    assert consistency(f | {"nees": 0.831 / math.e}) == pytest.approx(1.0, rel=1e-3)
    assert consistency(f | {"nees_above": 0.05}) == pytest.approx(1.0)
    g = {"rest_nll": -3.0, "trip_nll": -2.0, "repetitions": 8.0}
    assert cost(g, g) == -5.0
    assert cost(g | {"repetitions": 7.0}, g) == 5.0


def test_without_truth_it_is_what_the_filter_could_not_foresee():
    rows = np.zeros(8, Estimator(Params()).dtype)
    rows["t_ticks"] = 40_000 * np.arange(8)
    rows["q"] = (1.0, 0.0, 0.0, 0.0)
    # Still on steps 3 and 4: before that 0.02 m/s upwards, variance 3e-4, and R is 1e-4.
    rows["flags"][[3, 4]] = 2
    rows["v"][2] = (0.0, 0.0, 0.02)
    rows["variance"][2, 3:6] = 3e-4
    # Step 6 came back 30 mm off, with S = 0.03^2 / 4.
    rows["flags"][6] = 256
    rows["innovation"][6, 0], rows["nis"][6] = 0.03, 4.0
    found = blind(rows, 1e-4)
    assert found["rests"] == found["trips"] == 1.0
    assert found["rest_nis"] == pytest.approx(0.02**2 / 4e-4 / 3.0)
    assert found["rest_nll"] == pytest.approx(0.5 * (1.0 + 3.0 * math.log(4e-4)))
    assert found["trip_nll"] == pytest.approx(0.5 * (4.0 + math.log(0.03**2 / 4.0)))
    assert found["trip_rms_m"] == pytest.approx(0.03)


def test_a_scale_of_the_covariance_that_is_true_scores_best_without_truth():
    """A proper scoring rule: errors drawn with a variance are least costly with that variance."""
    rng = np.random.default_rng(1)
    rows = np.zeros(4000, Estimator(Params()).dtype)
    rows["flags"][1::2] = 2
    rows["v"] = 0.02 * rng.standard_normal((4000, 3))
    scores = []
    for factor in (0.25, 0.5, 1.0, 2.0, 4.0):
        rows["variance"][:, 3:6] = factor * 0.02**2
        scores.append(blind(rows[:-1], 0.0)["rest_nll"])
    assert int(np.argmin(scores)) == 2


def test_what_the_core_refuses_is_no_estimate_and_stops_nothing():
    one = case.of_seed(2, False)
    found = evaluate(one, [{"rate_hz": -1.0}, {}])
    assert found[0] == {"refused": 1.0}
    assert found[1]["phases"] > 0


def test_spoilt_parameters_are_mended_and_the_proposal_holds_on_what_was_held_out(tuned):
    found = tuned()
    assert found.proposal is not None, found.against
    # The truth that these sets are simulated with is 1.1e-3.
    assert found.proposal["accel_noise_mps2_rthz"] < 1e-2
    assert {s.name for s in found.held}.isdisjoint(s.name for s in found.training)
    for one in found.held:
        assert one.best["mean_rmse_mps"] < 0.7 * one.now["mean_rmse_mps"]
    noise = found.parameters[0]
    assert noise.put_back > 0.1 * ekf_show.gain(found.training)
    assert min(noise.costs) <= min(noise.costs[-1], noise.costs[0])
    rows = list(csv.DictReader(io.StringIO(ekf_show.parameters_csv(found))))
    assert [float(r["best"]) for r in rows] == pytest.approx(list(found.proposal.values()))
    assert [r["proposed"] for r in rows] == ["1", "1"]
    parts = [r["part"] for r in csv.DictReader(io.StringIO(ekf_show.recordings_csv(found)))]
    assert parts == ["training"] * 3 + ["held out"]
    drawing = ElementTree.fromstring(ekf_show.svg(found))
    assert sum(e.get("class") == "trace s0" for e in drawing.iter()) == 2


class _Backwards(_Here):
    """Works on the last task first."""

    def map(self, function, tasks):
        done = [function(self._inputs[k], argument) for k, argument in reversed(tasks)]
        return reversed(done)


def test_the_answer_does_not_depend_on_workers_or_on_who_is_first(monkeypatch, tuned):
    alone = tuned()
    three = tuned(jobs=3)
    monkeypatch.setattr(ekf, "workers", lambda *_: _entered(_Backwards()))
    backwards = tuned()
    for other in (three, backwards):
        assert ekf_show.parameters_csv(other) == ekf_show.parameters_csv(alone)
        assert ekf_show.recordings_csv(other) == ekf_show.recordings_csv(alone)
    another = tuned(seed=5)
    assert ekf_show.parameters_csv(another) != ekf_show.parameters_csv(alone)


class _entered:  # noqa: N801 (a context manager)
    def __init__(self, it):
        self.it = it

    def __enter__(self):
        return self.it

    def __exit__(self, *_):
        pass


def score(gain: float, **best: float) -> ekf.Score:
    return ekf.Score("one", True, {"wrong": 0.0}, {"wrong": 0.0, **best}, 1.0, 1.0 - gain)


def test_no_proposal_unless_better_on_what_was_held_out():
    good = [score(0.5)] * 3
    assert ekf._against(good, [score(0.1)]) == ""
    assert "nothing better" in ekf._against([score(0.0)], [score(0.1)])
    assert "no improvement" in ekf._against(good, [score(0.0)])
    assert "no improvement" in ekf._against(good, [score(-0.1)])
    mixed = [score(x) for x in (0.5, -0.3, 0.4, -0.2)]
    assert "standard error 0.2" in ekf._against(good, mixed)
    assert "missed or invented" in ekf._against(good, [score(0.9, wrong=1.0)])
    assert "moving bar" in ekf._against(good, [score(0.9, false_zupt=1.0)])
    assert "no estimate" in ekf._against(good, [score(0.9, refused=1.0)])


def source(name: str, of: str) -> ekf.Source:
    one = case.Case(name, None, None)  # type: ignore[arg-type]
    one.__dict__["digest"] = of
    return ekf.Source(name, [one])


def test_copies_of_a_recording_are_never_on_both_sides():
    given = [source(f"r{k}", "abcabcab"[k]) for k in range(8)]
    for seed in range(5):
        training, held = ekf.parts(ekf.Wish(seed=seed, hold_out=1), given, [])
        assert len(training) + len(held) == 8
        assert not {s.digest for s in training} & {s.digest for s in held}
        assert len({s.digest for s in held}) == 1
    assert len({ekf.parts(ekf.Wish(seed=s), given, [])[1][0].name for s in range(9)}) > 1
    with pytest.raises(RecordingError, match="searched on and held out"):
        ekf.parts(ekf.Wish(), given, [source("copy", "b")])
    with pytest.raises(RecordingError, match="none is left"):
        ekf.parts(ekf.Wish(), [source("x", "a"), source("y", "a")], [])
    with pytest.raises(RecordingError, match="every recording is held out"):
        ekf.parts(ekf.Wish(), [], [source("x", "a")])
    with pytest.raises(RecordingError, match="no recording to tune on"):
        ekf.tune(ekf.Wish())


def test_a_recording_is_a_case_with_its_truth_and_one_without_motion_has_none():
    (one,) = case.of_recording(RECORDINGS / "imu-faults/recording.mcap")
    assert one.known is not None
    (figures,) = evaluate(one, [{}])
    assert figures["phases"] > 0
    (still,) = case.of_recording(RECORDINGS / "cal-boot/recording.mcap")
    assert still.known is None
    assert "mean_rmse_mps" not in evaluate(still, [{}])[0]
    assert one.digest != replace(one, known=None).digest != still.digest


def test_a_search_killed_at_any_time_goes_on_to_the_same_answer(tmp_path, short, tuned):
    first = subprocess.Popen([sys.executable, short.__file__, str(tmp_path)])
    deadline = time.monotonic() + 60.0
    while len(list(tmp_path.glob("ekf-*.json"))) < 8 and time.monotonic() < deadline:
        assert first.poll() is None, "ended before it could be killed"
        time.sleep(0.002)
    first.kill()
    assert first.wait() == -signal.SIGKILL
    found = sorted(tmp_path.glob("ekf-*.json"))
    assert len(found) >= 8
    found[0].write_bytes(found[0].read_bytes()[:-9])
    times = {file: file.stat().st_mtime_ns for file in found[1:]}
    again, whole = tuned(folder=tmp_path), tuned()
    for form in (ekf_show.parameters_csv, ekf_show.recordings_csv, ekf_show.svg):
        assert form(again) == form(whole)
    # What was there was used, and what was damaged made again.
    assert all(file.stat().st_mtime_ns == at for file, at in times.items())
    assert len(list(tmp_path.glob("ekf-*.json"))) > len(found)
    assert json.loads(found[0].read_bytes())["result"]


def test_a_parameter_that_changes_nothing_is_not_proposed():
    # Of the attitude baseline, which nothing else looks at.
    arguments = ["ekf", "--sets", "2", "--trials", "6", "--param", "madgwick_gain=0.01:0.1"]
    result = CliRunner().invoke(app, [*arguments, "--hold-out", "1", "--jobs", "1"])
    assert result.exit_code == 1, result.output
    assert "no proposal: nothing better was found" in result.output


def test_sets_are_those_of_their_seeds_and_no_study_uses_them():
    assert ekf.SEED_FIRST >= 7000
    one = ekf._set((7002, True))
    assert one.known is not None
    assert one.known.lift.name == seeded_set(7002, True).name
    with workers(1) as crew:
        crew.share([one])
        (found,) = crew.map(evaluate, [(0, [{}])])
    assert found == evaluate(one, [{}])
