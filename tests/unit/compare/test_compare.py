# SPDX-License-Identifier: Apache-2.0
"""The league: what is measured of a track, how it is ranked, and that what is committed holds."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from importlib.resources import files
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from hil.cli import app
from hil.compare import methods, page, plot, show
from hil.compare.cases import Case, Spec, Truth, make, motion_specs
from hil.compare.methods import METHODS, CoreTracker, Track, at_centre, at_rest, integrate
from hil.compare.score import Row, league, pooled, score
from hil.core import NOTHING, Estimator, Samples, seconds
from hil.errors import HilError
from hil.motion.repetitions import Concentric
from hil.parity import Batch, first_steps
from hil.reference.estimator import Sample
from hil.reference.params import Params
from hil.reference.tracker import OwnReference
from hil.report import build, html

RATE = 100.0
N = 3001


def hump(t):
    """One rise of 1.5 s from 5 s on, 1 m/s at its height."""
    s = (t - 5.0) / 1.5
    return np.where((s > 0) & (s < 1), np.sin(np.pi * s) ** 2, 0.0)


def known_case(**changes) -> Case:
    t = np.arange(N) / RATE
    samples = Samples(
        np.rint(t * 16e6).astype(np.int64), np.tile([0.0, 0.0, 9.80665], (N, 1)), np.zeros((N, 3))
    )
    truth = Truth(
        hump,
        lambda t: np.tile([0.0, 0.0, 1.0], (len(t), 1)),
        hump,
        [(0.0, 5.0), (6.5, 30.0), (12.0, 12.1)],
        repetitions=[Concentric(5.1, 6.4, 0.55, 1.0, 5.75, 0.75)],
    )
    case = Case(
        Spec("motion", "made"),
        Batch(samples, NOTHING, np.zeros(0, np.int64)),
        Params(rate_hz=RATE),
        truth,
    )
    return replace(case, **changes)


def track(error=0.0, tilt_deg=0.0, still=lambda t: t < 4.0, share=1.0) -> Track:
    t = np.arange(N) / RATE
    q = np.roll(Rotation.from_euler("x", tilt_deg, degrees=True).as_quat(), 1)
    v = np.zeros((N, 3))
    v[:, 2] = share * hump(t) + error
    return Track(t, np.tile(q, (N, 1)), v, still(t), 7.0)


# Score ---------------------------------------------------------------------------------------


def test_a_perfect_track_has_no_error():
    row = score(known_case(), "x", track())
    assert (row.attitude_deg, row.velocity_mps, row.drift_m_per_min) == (0.0, 0.0, 0.0)
    assert (row.reps, row.missed, row.invented) == (1, 0, 0)
    assert row.false_zupt_s == 0.0
    assert row.cost_us == 7.0
    assert row.washed_mps is None


def test_a_constant_error_is_its_own_rmse_and_a_drift_of_sixty_times_it():
    row = score(known_case(), "x", track(error=0.02))
    assert row.velocity_mps == pytest.approx(0.02)
    assert row.drift_m_per_min == pytest.approx(1.2)


def test_yaw_is_no_error_and_tilt_is():
    assert score(known_case(), "x", track(tilt_deg=2.0)).attitude_deg == pytest.approx(2.0)
    turned = track()
    turned = replace(turned, q=np.tile([math.cos(0.5), 0, 0, math.sin(0.5)], (N, 1)))
    assert score(known_case(), "x", turned).attitude_deg == pytest.approx(0.0, abs=1e-6)


def test_repetitions_missed_and_wrong():
    row = score(known_case(), "x", track(share=0.9))
    assert row.peak_mps == pytest.approx(0.1, abs=0.002)
    row = score(known_case(), "x", track(share=0.1))
    assert (row.missed, row.mean_mps) == (1, None)


def test_zero_velocity_false_and_missed():
    """Held from 5.5 to 6 s in the rise: 0.5 s false. Held nowhere in the second rest: missed.

    The third rest is too short to count.
    """
    row = score(known_case(), "x", track(still=lambda t: (t < 4.0) | ((t >= 5.5) & (t < 6.0))))
    assert row.false_zupt_s == pytest.approx(0.5, abs=0.011)
    assert (row.rests, row.missed_rests) == (2, 1)
    row = score(known_case(), "x", track(still=lambda t: t < -1))
    assert (row.rests, row.missed_rests, row.false_zupt_s) == (2, 2, 0.0)


def test_a_sprint_has_its_greatest_velocity():
    case = known_case()
    truth = replace(case.truth, repetitions=None, peak_mps=1.0)
    row = score(replace(case, truth=truth), "x", track(share=1.03))
    assert row.peak_mps == pytest.approx(0.03)
    assert row.reps is None


def test_without_truth_there_is_the_cost_only():
    row = score(known_case(truth=None), "x", track())
    assert {k for k, v in vars(row).items() if v is not None} == {
        *("case", "seed", "method", "samples", "cost_us")
    }


def test_pooling_is_by_squares_sums_and_means():
    rows = [
        Row("a", 1, "x", 10, velocity_mps=0.03, missed=1, reps=2, drift_m_per_min=1.0),
        Row("a", 2, "x", 10, velocity_mps=0.04, missed=0, reps=3, drift_m_per_min=2.0),
    ]
    one = pooled(rows)
    assert one.velocity_mps == pytest.approx(math.sqrt((9e-4 + 16e-4) / 2))
    assert (one.missed, one.reps, one.samples, one.drift_m_per_min) == (1, 5, 20, 1.5)
    assert one.peak_mps is None


# Methods -------------------------------------------------------------------------------------


def test_lever_arm_by_hand():
    """A turn of 2 rad/s about y lifts the sensor at -x, 1.05 m out: w x r = (.04, 0, -2.1)."""
    q, v = np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3))
    found = at_centre(Params(), q, v, np.array([[0.0, 2.0, 0.0]]))
    np.testing.assert_allclose(found, [[-0.04, 0.0, 2.1]])


def test_common_rule_needs_both_quiet_for_its_time():
    t = np.arange(100) / RATE
    accel, rate = np.tile([0.0, 0.0, 9.80665], (100, 1)), np.zeros((100, 3))
    accel[30, 2] += 0.31
    rate[70, 0] = 0.11
    still = at_rest(t, accel, rate, 9.80665)
    np.testing.assert_array_equal(
        np.flatnonzero(still), [*range(20, 30), *range(50, 70), *range(90, 100)]
    )


def test_integration_begins_anew_after_each_rest():
    t = np.arange(6.0)
    a = np.outer([0, 1, 1, 1, 1, 1], [1.0, 0, 0])
    v = integrate(t, a, np.array([True, False, False, True, False, False]))
    np.testing.assert_allclose(v[:, 0], [0, 0.5, 1.5, 0, 1, 2])


@pytest.fixture(scope="module")
def short_lift() -> Case:
    case = make(Spec("motion", "deadlift_rests", 1))
    return replace(case, samples=first_steps(case.samples, 1600))


def test_the_core_step_by_step_is_the_core_in_one(short_lift):
    """Through the shared interface, follower and all; 400 steps."""
    fed = first_steps(short_lift.samples, 400)
    whole = Estimator(short_lift.params, np.float32).run(fed.leader, fed.follower, fed.arrival)
    found = stepped(CoreTracker(short_lift.params), fed)
    np.testing.assert_array_equal([e.v for e in found], whole.outputs["v"].astype(np.float64))
    np.testing.assert_array_equal([e.t_s for e in found], whole.t_s)
    assert any(e.still for e in found)


def test_the_reference_says_the_same_through_the_same_interface(short_lift):
    fed = first_steps(short_lift.samples, 300)
    ours = stepped(CoreTracker(short_lift.params, np.float64), fed)
    reference = stepped(OwnReference(short_lift.params), fed)
    np.testing.assert_allclose([e.v for e in ours], [e.v for e in reference], atol=1e-9)
    assert [e.still for e in ours] == [e.still for e in reference]


def stepped(tracker, fed):
    own, others = rows(fed.leader), rows(fed.follower)
    bounds = np.searchsorted(fed.arrival, np.arange(len(own) + 1))
    steps = (tracker.step(s, others[bounds[k] : bounds[k + 1]]) for k, s in enumerate(own))
    return [e for e in steps if e is not None]


def rows(samples):
    t, accel, gyro, clipped, sigma = samples.columns()
    return [Sample(*row) for row in zip(seconds(t), accel, gyro, clipped, sigma, strict=True)]


@pytest.mark.parametrize("name", METHODS)
def test_every_tracker_knows_a_bar_at_rest(short_lift, name):
    """The first 1.2 s of a deadlift lie on the floor: level within 0.5 deg, and slow."""
    case = replace(short_lift, samples=first_steps(short_lift.samples, 500))
    row = score(case, name, METHODS[name](case))
    assert row.attitude_deg < 0.5
    assert row.velocity_mps < 0.02


def test_first_two_of_both_alone_and_with_a_follower(short_lift):
    ours, alone = METHODS["ours"](short_lift), METHODS["ours, one sensor"](short_lift)
    assert np.abs(ours.velocity_mps - alone.velocity_mps).max() > 1e-4


def test_a_missing_package_is_named(monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(methods.importlib, "import_module", missing)
    with pytest.raises(HilError, match="'vqf' is not installed") as caught:
        methods.need_extras()
    assert "hil[compare]" in caught.value.mend


# Table ---------------------------------------------------------------------------------------


def made(**values) -> list[Row]:
    """Three trackers with these velocities."""
    return [Row("c", 1, name, 1, velocity_mps=v) for name, v in values.items()]


def test_places_and_who_is_better():
    rows = made(ours=0.02, VQF=0.01, Fusion=0.03)
    velocity = next(c for c in show.COLUMNS if c.heading == "velocity")
    assert show.place(rows, velocity) == 2
    assert show.behind({"c": rows}) == []
    rows = made(ours=0.04, VQF=0.01, Fusion=0.03)
    assert show.place(rows, velocity) == 3
    (line,) = show.behind({"c": rows})
    assert line == "c, velocity: ours is third with 40.0 mm/s (VQF 10.0, Fusion 30.0)"
    # Ours with one sensor is no rival.
    rows = [*made(ours=0.02, VQF=0.01), *made(**{"ours, one sensor": 0.001})]
    assert show.place(rows, velocity) == 2


def test_columns_without_a_value_are_not_there_and_single_gaps_are_dashes():
    rows = made(ours=0.02, VQF=None)
    text = show.markdown(rows)
    assert text.splitlines() == [
        "| tracker | velocity, mm/s |",
        "|---|---|",
        "| **ours** | 20.0 |",
        "| VQF | – |",
    ]


def test_json_there_and_back_and_hostile(tmp_path):
    rows_ = made(ours=0.02, VQF=0.01)
    path = tmp_path / "league.json"
    path.write_text(show.as_json(rows_, "a machine"))
    assert show.read_json(path) == (rows_, "a machine")
    for text in ("{", "[]", '{"version": 2}', '{"version": 1, "machine": "", "rows": [{"a": 1}]}'):
        path.write_text(text)
        with pytest.raises(HilError, match=r"league\.json"):
            show.read_json(path)
    with pytest.raises(HilError, match="cannot be read"):
        show.read_json(tmp_path / "none.json")


def test_picture_has_a_mark_for_each_value_and_escapes():
    tables = {"<c>": made(ours=0.02, VQF=0.001), "none": made(ours=None)}
    tree = ElementTree.fromstring(plot.svg(tables))
    texts = [e.text for e in tree.iter("{http://www.w3.org/2000/svg}text")]
    assert "<c>" in texts
    assert "none" not in texts
    circles = list(tree.iter("{http://www.w3.org/2000/svg}circle"))
    # Two in the key, and ours at 0.02 between 1e-3 and 1e-1: 65 % of the way.
    assert len(circles) == 3
    x = float(circles[-1].get("cx"))
    width = 900 - plot.LEFT - plot.RIGHT
    assert x == pytest.approx(plot.LEFT + width * math.log10(20) / 2, abs=0.1)


def test_report_shows_the_league_escaped():
    document = build([])
    assert "~league" not in html.render(document)
    document["league"] = show.as_tables(made(**{"ours": 0.02, "<b>x": 0.01}))
    jsonschema.validate(
        document, json.loads((files("hil.report") / "report.schema.json").read_text())
    )
    text = html.render(document)
    assert 'id="~league"' in text
    assert "&lt;b&gt;x" in text
    assert "<b>x" not in text


# Committed -----------------------------------------------------------------------------------


def test_committed_texts_are_what_the_committed_league_says():
    for path, text in page.texts(*show.read_json(page.LEAGUE)).items():
        assert path.read_text(encoding="utf-8") == text, path


def test_committed_league_has_every_case_and_tracker():
    tables = league(show.read_json(page.LEAGUE)[0])
    wanted = {spec.title for spec in page.specs("")}
    assert set(tables) == wanted
    for case, members in tables.items():
        one_sensor = case.startswith(("sprint", "BROAD"))
        assert len(members) == len(METHODS) - one_sensor, case


def test_committed_sprints_are_within_two_percent():
    rows_ = [r for r in show.read_json(page.LEAGUE)[0] if r.method == "sprint EKF"]
    errors = {r.case: r.peak_mps for r in rows_ if r.case.startswith("sprint")}
    assert len(errors) == 3
    for case, error in errors.items():
        assert error < 0.02 * float(case.removeprefix("sprint "))


def test_differences_are_seen_and_cost_is_not():
    kept = made(ours=0.02, VQF=0.01)
    assert page.differences(kept, [replace(kept[0], cost_us=3.0)]) == []
    assert page.differences(kept, [replace(kept[0], velocity_mps=0.0203)]) == []
    (line,) = page.differences(kept, [replace(kept[0], velocity_mps=0.021)])
    assert "velocity_mps was 0.02, is 0.021" in line
    assert page.differences(kept, [replace(kept[0], missed=1)])
    assert page.differences(kept, made(Fusion=0.1)) == ["c, seed 1, Fusion: not in the league"]


def test_region_must_be_there_once(tmp_path):
    text = f"a\n{page.BEGIN}\nold\n{page.END}\nb\n"
    assert page.with_region(text, "new", tmp_path) == f"a\n{page.BEGIN}\n\nnew\n\n{page.END}\nb\n"
    for broken in ("a", page.END + page.BEGIN, text + text):
        with pytest.raises(HilError, match="no region"):
            page.with_region(broken, "new", tmp_path)


# Command -------------------------------------------------------------------------------------


def test_specs_by_name():
    assert len(motion_specs("all", 1)) == 17
    assert [s.name for s in motion_specs("sprint", 1)] == [
        *("sprint_8.12", "sprint_8.56", "sprint_8.98")
    ]
    assert [s.seed for s in motion_specs("bench", 2)] == [1, 2]
    with pytest.raises(HilError, match="no motion 'nap'"):
        motion_specs("nap", 1)


def test_command_compares_and_writes(tmp_path):
    done = CliRunner().invoke(
        app, ["compare", "--motion", "still", "--seeds", "1", "-o", str(tmp_path), "--jobs", "1"]
    )
    assert done.exit_code == 0, done.output
    for name in METHODS:
        assert name in done.output
    document = json.loads((tmp_path / "league.json").read_text())
    assert [row["method"] for row in document["rows"]] == list(METHODS)
    assert (tmp_path / "league.svg").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "nothing to compare on"),
        (["--broad"], "needs the folder"),
        (["--broad", "--data", "/nowhere", "--jobs", "1"], "no trial 14"),
        (["/nowhere"], "no recording at"),
        (["--motion", "nap"], "no motion 'nap'"),
    ],
)
def test_wrong_use_says_what_to_do(arguments, message, monkeypatch):
    monkeypatch.delenv("HIL_DATA", raising=False)
    done = CliRunner().invoke(app, ["compare", *arguments])
    assert isinstance(done.exception, HilError)
    assert message in str(done.exception)
