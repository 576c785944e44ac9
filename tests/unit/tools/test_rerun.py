# SPDX-License-Identifier: Apache-2.0
"""Other parameters over a recording: what is accepted, what changes, and against which truth."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from hil.core import Estimator
from hil.errors import RecordingError
from hil.recording import Recording, load
from hil.reference.params import Params
from hil.streams import frames
from hil.tuning import show
from hil.tuning.parameters import PARAMETERS, ParameterError, changed, differences
from hil.tuning.rerun import rerun, zupt_spans_s

CLEAN = Path(__file__).parents[3] / "fixtures/recordings/clean-7ms5/recording.mcap"


@pytest.fixture(scope="module")
def clean() -> Recording:
    return load(CLEAN)


def test_the_table_names_every_parameter_and_its_default_is_in_range():
    assert list(PARAMETERS) == [f.name for f in dataclasses.fields(Params)]
    for name, about in PARAMETERS.items():
        value = np.asarray(getattr(Params(), name), dtype=np.float64)
        assert np.all((about.low <= value) & (value <= about.high)), name


def test_both_ends_of_each_range_are_taken_by_the_core():
    for name, about in PARAMETERS.items():
        if isinstance(getattr(Params(), name), np.ndarray):
            continue
        for value in (about.low, about.high):
            if name == "rate_hz" and value < 2 * Params().cutoff_hz:
                continue
            text = f"{value:g}"
            Estimator(changed(Params(), [f"{name}={text}"]))


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("zupt_dwell=60", 60),
        ("zupt_accel_var=1e-3", 1e-3),
        ("round_trip=off", False),
        ("zupt_shoe = true", True),
        ("lever_leader_m=1.1,0,0.03", [1.1, 0.0, 0.03]),
    ],
)
def test_a_setting_changes_that_parameter_and_no_other(setting, value):
    (both,) = differences(Params(), changed(Params(), [setting])).items()
    name, (_, now) = both
    assert name == setting.split("=")[0].strip()
    assert np.array_equal(now, value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["zupt_acel_var=1"], r"zupt_accel_var \(1e-08 to 10 \(m/s\^2\)\^2: variance"),
        (["dwell=3"], r"zupt_dwell \(1 to 2000 samples"),
        (["qqqq=3"], "docs/estimator.md"),
        (["zupt_dwell"], "not NAME=VALUE"),
        (["zupt_dwell=0"], r"out of its range\n.*\n.*zupt_dwell: 1 to 2000 samples"),
        (["zupt_dwell=2.5"], "not a whole number"),
        (["zupt_dwell=x"], "not a number"),
        (["zupt_accel_var=nan"], "out of its range"),
        (["zupt_accel_var=1e999"], "out of its range"),
        (["round_trip=maybe"], "neither true nor false"),
        (["lever_leader_m=1,2"], "takes 3 numbers, 2 are given"),
        (["rotation_leader=1,0,0,0,1,0,0,0,-1"], "no rotation"),
        (["zupt_dwell=3", "zupt_dwell=4"], "given twice"),
        (["cutoff_hz=200", "rate_hz=300"], "not below half"),
    ],
)
def test_what_is_wrong_is_said_with_what_is_near(settings, message):
    with pytest.raises(ParameterError, match=message):
        changed(Params(), settings)


def test_without_a_change_nothing_changes_and_the_frames_say_the_same(clean):
    same = rerun(clean, [])
    assert len(same.default.phases) == 8
    for a, b in same.paired():
        assert a == b
    assert same.default.zupt_spans_s == same.other.zupt_spans_s
    sent = frames(clean, "leader", "ekf_state")
    # Bit 2 of the flags: an accepted zero-velocity update (protocol table).
    on = (sent["flags"] & 4) != 0
    step_s = np.diff(sent["t_ticks_leader"].astype(np.int64)) / 16e6
    sent_s = step_s[on[1:] & on[:-1]].sum()
    # Every fourth step has a frame: each end of a span is up to three steps off.
    spans = len(same.default.zupt_spans_s)
    assert sent_s <= same.default.zupt_s <= sent_s + spans * 6 / 388.35


def test_a_longer_dwell_takes_its_samples_off_each_rest(clean):
    found = rerun(clean, ["zupt_dwell=140"])
    later = [
        b[0] - a[0] for a, b in zip(*(o.zupt_spans_s for o in vars(found).values()), strict=True)
    ]
    # 100 samples at 388.35 Hz; the first rest begins with the alignment, as long in both.
    assert later[1:] == pytest.approx([100 / 388.35] * (len(later) - 1), abs=0.02)
    assert found.other.judged is not None
    assert found.other.judged.false_zupt == 0


def test_thresholds_far_too_wide_show_as_false_updates_against_the_truth(clean):
    wide = ["zupt_accel_var=5", "zupt_gyro_var=0.5", "zupt_level_mps2=5", "zupt_gate=1000"]
    found = rerun(clean, wide)
    assert found.default.judged is not None
    assert found.default.judged.false_zupt == 0
    assert found.other.judged is not None
    assert found.other.judged.false_zupt > 100
    assert found.other.errors_mps[0] > 10 * found.default.errors_mps[0]
    text = io.StringIO()
    show.render("clean", found, Console(file=text, width=120))
    assert "zupt_gate" in text.getvalue()
    assert "false zero-velocity steps" in text.getvalue()


def test_a_wrong_lever_scales_what_is_shown_of_the_velocity(clean):
    found = rerun(clean, ["lever_leader_m=0,0,0"])
    # The leader's own end is reported as the centre: bar rotation is in it, up to 40 %.
    assert max(abs(b.peak_mps - a.peak_mps) for a, b in found.paired() if a and b) > 0.02


def test_spans_are_the_runs_of_the_flag():
    rows = np.zeros(7, [("t_ticks", np.int64), ("flags", np.uint32)])
    rows["t_ticks"] = 16_000_000 * np.arange(7)
    rows["flags"] = [4, 4, 8, 6, 0, 3, 4]
    assert zupt_spans_s(rows) == [(0.0, 1.0), (3.0, 3.0), (6.0, 6.0)]


def test_a_recording_without_batches_is_a_clear_error(clean):
    with pytest.raises(RecordingError, match="no IMU batch"):
        rerun(dataclasses.replace(clean, serial={}), [])
