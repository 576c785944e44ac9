# SPDX-License-Identifier: Apache-2.0
"""Scenario files: what is read, and what each wrong one is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hil import scenario
from hil.errors import ScenarioError

FULL = """
name = "full"
description = "every key"
duration_s = 12.5
seed = 7
expect_fail = ["sync.error_p99_ns"]

[firmware.leader]
BV_CONN_INTERVAL = 24

[nodes.leader]
drift_ppm = 13.7
start_offset_us = 12345
wander = [{ amplitude_ppm = 0.2, period_s = 37.0, phase_rad = 0.5 }]

[nodes.follower]
drift_ppm = -31.1
imu = { odr_hz = 1667, odr_error = -0.068, faults = [{ kind = "overrun", at_s = 4 }] }

[motion]
lift = "bench"
rests = true

[[link_drops]]
at_s = 5

[channel]
kind = "multiatt"
attenuation_db = 90
"""

CALIBRATION = 'name = "x"\n[nodes.leader.calibration]\n'
MOTION = 'name = "x"\n[motion]\nlift = "still"\n'


def write(folder: Path, text: str) -> Path:
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_is_read(tmp_path: Path) -> None:
    read = scenario.load(write(tmp_path, FULL))
    assert read.duration_s == 12.5
    assert read.kconfig == {"leader": {"BV_CONN_INTERVAL": 24}}
    assert read.node("leader").wander == (scenario.Wander(0.2, 37.0, 0.5),)
    assert read.node("follower").imu == scenario.ImuScenario(
        odr_hz=1667, odr_error=-0.068, faults=(scenario.ImuFault("overrun", 4),)
    )
    assert read.node("leader").imu == scenario.ImuScenario()
    assert read.motion == scenario.Motion("bench", rests=True)
    assert read.link_drops == (scenario.LinkDrop(5),)
    assert read.channel == scenario.Channel("multiatt", 90)
    assert read.expect_fail == ("sync.error_p99_ns",)


def test_plain_data_round_trip(tmp_path: Path) -> None:
    read = scenario.load(write(tmp_path, FULL))
    assert scenario.from_mapping(scenario.to_mapping(read), "again") == read


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = ", "not valid TOML"),
        ("duration_s = 3", "'name' is missing"),
        ('name = "x"\nduration = 3', "unknown key 'duration'"),
        ('name = "x"\nduration_s = 0', "must be positive"),
        ('name = "x"\nduration_s = "long"', "wrong type"),
        ('name = "x"\nseed = true', "wrong type"),
        ('name = "x"\n[nodes.middle]\ndrift_ppm = 1', "unknown role 'nodes.middle'"),
        ('name = "x"\n[channel]\nkind = "noisy"', "'noisy' is unknown"),
        ('name = "x"\n[nodes.leader]\nwander = [{ amplitude_ppm = 1 }]', "period_s > 0"),
        ('name = "x"\n[nodes.leader]\ncalibration = 1', "'calibration' has the wrong type"),
        (CALIBRATION + "gyro_bias_dps = [0, 0, 0]", "unknown key 'gyro_bias_dps'"),
        (CALIBRATION + "gyro_offset_dps = [0, 0]", "needs three numbers"),
        (CALIBRATION + "gyro_offset_dps = [0, true, 0]", "needs three numbers"),
        (CALIBRATION + 'gyro_offset_dps = [0, "1", 0]', "needs three numbers"),
        (CALIBRATION + "gyro_offset_dps = [0, nan, 0]", "needs three numbers"),
        (MOTION + "handled_s = true", "wrong type"),
        (MOTION + "handled_s = 3", "not within 0 and start_s = 3"),
        (MOTION + "start_s = 2\nhandled_s = 2.5", "not within 0 and start_s = 2"),
        (MOTION + "handled_s = -1", "not within 0 and start_s = 3"),
        (MOTION + "handled_s = nan", "no finite number of use"),
    ],
)
def test_a_wrong_file_is_named_with_its_fault(tmp_path: Path, text: str, says: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ScenarioError, match=r"scenario\.toml") as caught:
        scenario.load(path)
    assert says in str(caught.value)


def test_a_stored_calibration_and_a_handled_bar_are_read_and_kept(tmp_path: Path) -> None:
    text = (
        CALIBRATION + "gyro_offset_dps = [0.5, 0, -1]\n[nodes.follower.calibration]\n"
        '[motion]\nlift = "still"\nstart_s = 9\nhandled_s = 6.5'
    )
    read = scenario.load(write(tmp_path, text))
    assert read.node("leader").calibration == scenario.StoredCalibration((0.5, 0.0, -1.0))
    # An empty table is a calibration that is right; no table is none.
    assert read.node("follower").calibration == scenario.StoredCalibration((0.0, 0.0, 0.0))
    assert scenario.load(write(tmp_path, FULL)).node("leader").calibration is None
    assert read.motion == scenario.Motion("still", start_s=9, handled_s=6.5)
    again = scenario.from_mapping(json.loads(json.dumps(scenario.to_mapping(read))), "provenance")
    assert again == read


def test_a_missing_file_says_so(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read"):
        scenario.load(tmp_path / "none.toml")


@pytest.mark.parametrize(
    "path",
    sorted((Path(__file__).parents[2] / "fixtures/scenarios").glob("*.toml")),
    ids=lambda p: p.stem,
)
def test_every_committed_scenario_is_valid(path: Path) -> None:
    assert scenario.load(path).name == path.stem
