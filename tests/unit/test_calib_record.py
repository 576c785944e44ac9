# SPDX-License-Identifier: Apache-2.0
"""Calibration records: what is written is read, and nothing else is; Kconfig fragments."""

from __future__ import annotations

import copy
import json
import math
import os
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hil.calibration.kconfig import fragment
from hil.calibration.poses import FACES, Pose
from hil.calibration.record import MAX_FILE_BYTES, Record, check_device, load, record_of
from hil.calibration.solve import GyroRest, Method, solve
from hil.errors import HilError

G = 9.80665


def made() -> Record:
    poses = tuple(
        Pose(
            tuple(1.01 * G * face.direction + [0.1, -0.2, 0.3]),
            (0.011, 0.012, 0.013),
            (0.001, 0.002, 0.003),
            500,
            face,
            24.0 + 0.5 * i,
        )
        for i, face in enumerate(FACES)
    )
    gyro = GyroRest(np.array([0.01, -0.02, 0.03]), np.full(3, 1e-5), 25_000, 417.0)
    return record_of(
        solve(poses, gyro),
        poses,
        device_id=0x0123456789ABCDEF,
        role="leader",
        firmware_build_id=0xFEED,
        created=datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC),
        gyro_samples=25_000,
    )


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / made().path
    made().save(path)
    return path


def test_what_is_written_is_read(saved):
    wrote, read = made(), load(saved)
    for name in ("device_id", "role", "created_utc", "temperature_degc", "firmware_build_id"):
        assert getattr(read, name) == getattr(wrote, name)
    assert read.poses == wrote.poses
    assert read.gyro_samples == 25_000
    for name, value in vars(wrote.calibration).items():
        np.testing.assert_array_equal(getattr(read.calibration, name), value)
    assert read.calibration.method is Method.MAGNITUDE_DIAGONAL


def test_names_and_times():
    record = made()
    assert str(record.path) == "calibrations/0123456789abcdef-20260304T050607Z.json"
    assert record.firmware_build_id == "000000000000feed"
    assert record.temperature_degc == 25.25
    # date -u -d 2026-03-04T05:06:07Z +%s
    assert record.created_unix_s == 1772600767
    east = datetime(2026, 3, 4, 7, 6, 7, tzinfo=timezone(timedelta(hours=2)))
    assert (
        record_of(
            record.calibration,
            record.poses,
            device_id=1,
            role="follower",
            firmware_build_id=2,
            created=east,
            gyro_samples=1,
        ).created_utc
        == record.created_utc
    )


def test_unknown_temperature_is_null(tmp_path):
    record = replace(made(), temperature_degc=math.nan)
    record.save(tmp_path / "r.json")
    assert json.loads((tmp_path / "r.json").read_text())["temperature_degc"] is None
    assert math.isnan(load(tmp_path / "r.json").temperature_degc)


def test_a_crash_while_writing_leaves_the_old_file(saved, monkeypatch):
    before = saved.read_bytes()

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(HilError, match="No space left") as refused:
        replace(made(), role="follower").save(saved)
    assert str(saved) in refused.value.message
    assert saved.read_bytes() == before
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_an_impossible_record_is_not_written(tmp_path):
    good = made()
    bad = replace(
        good, calibration=replace(good.calibration, accel_bias_mps2=np.array([5.0, 0, 0]))
    )
    with pytest.raises(HilError, match="x bias is 510 mg"):
        bad.save(tmp_path / "bad.json")
    assert not list(tmp_path.iterdir())


def test_another_devices_calibration_is_refused():
    check_device(made(), "0123456789abcdef")
    check_device(made(), "0x0123456789ABCDEF")
    check_device(replace(made(), device_id="0000000000001001"), "0x1001")
    with pytest.raises(HilError, match="0123456789abcdef, the one here is 0123456789abcdee"):
        check_device(made(), "0123456789abcdee")


def changed(saved, change):
    tree = json.loads(saved.read_text())
    change(tree)
    saved.write_text(json.dumps(tree))
    return saved


def put(path, value):
    def change(tree):
        for key in path[:-1]:
            tree = tree[key]
        tree[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        (["schema_version"], 2, "schema_version is 2"),
        (["schema_version"], True, "schema_version"),
        (["device_id"], 5, "device_id"),
        (["device_id"], "0x0123456789abcdef", "device_id"),
        (["device_id"], "../../../../etc/x", "device_id"),
        (["role"], "boss", "role: 'boss' is none of leader, follower"),
        (["role"], ["leader"], "role"),
        (["created_utc"], "2026-13-04T05:06:07Z", "created_utc: no date"),
        (["created_utc"], "yesterday", "created_utc"),
        (["temperature_degc"], 300, "temperature_degc"),
        (["temperature_degc"], "warm", "temperature_degc"),
        (["firmware_build_id"], "feed", "firmware_build_id"),
        (["gyro_samples"], -1, "gyro_samples"),
        (["gyro_samples"], 1.5, "gyro_samples"),
        (["poses"], {}, "poses"),
        (["poses"], [7] * 6, "poses[0] is no object"),
        (["poses", 1, "face"], "+w", "poses[1].face"),
        (["poses", 1, "face"], {}, "poses[1].face"),
        (["poses", 1, "mean_mps2"], [1, 2], "poses[1].mean_mps2"),
        (["poses", 1, "mean_mps2"], [1, 2, 1e6], "poses[1].mean_mps2"),
        (["poses", 1, "mean_mps2"], [1, 2, 10**400], "poses[1].mean_mps2"),
        (["poses", 1, "mean_mps2"], [1, 2, True], "poses[1].mean_mps2"),
        (["poses", 1, "std_mps2"], [1, 2, -0.1], "poses[1].std_mps2"),
        (["poses", 1, "n"], 0, "poses[1].n"),
        (["poses", 1, "more"], 0, "poses[1].more: is no key"),
        (["residuals_mg"], [0.0], "residuals_mg"),
        (["calibration"], None, "calibration is no object"),
        (["calibration", "method"], "guess", "calibration.method"),
        (["calibration", "gravity_mps2"], 1.6, "calibration.gravity_mps2"),
        (["calibration", "accel_matrix"], [1] * 9, "calibration.accel_matrix"),
        (["calibration", "accel_matrix"], [[1, 0], [0, 1, 0], [0, 0, 1]], "accel_matrix"),
        (["calibration", "accel_matrix"], [[2, 0, 0], [0, 1, 0], [0, 0, 1]], "scale is off"),
        (["calibration", "gyro_bias_radps"], [0, 0, 0.4], "z bias is 22.9 dps"),
        (["calibration", "more"], 0, "calibration.more: is no key"),
        (["surprise"], 1, "surprise: is no key"),
    ],
)
def test_a_wrong_value_is_named(saved, path, value, key):
    with pytest.raises(HilError, match=re.escape(key)) as refused:
        load(changed(saved, put(path, value)))
    assert str(saved) in refused.value.message
    assert refused.value.mend


def keys(tree, prefix=()):
    for key, value in tree.items():
        yield (*prefix, key)
        if isinstance(value, dict):
            yield from keys(value, (*prefix, key))


def test_each_key_is_needed(saved):
    whole = json.loads(saved.read_text())
    every = [*keys(whole), *(("poses", 0, key) for key in whole["poses"][0])]
    assert len(every) > 20
    for path in every:
        tree = copy.deepcopy(whole)
        part = tree
        for key in path[:-1]:
            part = part[key]
        del part[path[-1]]
        saved.write_text(json.dumps(tree))
        with pytest.raises(HilError, match=f"{path[-1]}: is missing"):
            load(saved)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"", "line 1: no JSON"),
        (b'{\n"schema_version": 1,\n}', "line 3: no JSON"),
        (b"\xff\xfe", "not UTF-8 at byte 0"),
        (b"[]", "the file is no object"),
        (b"NaN", "NaN is not a number"),
        (b'{"schema_version": Infinity}', "Infinity is not a number"),
        (b'{"role": 1, "role": 2}', "key 'role' stands twice"),
        (b"[" * 100_000, "recursion"),
        (b'{"schema_version": ' + b"9" * 5000 + b"}", "digits"),
        (b" " * (MAX_FILE_BYTES + 1), "larger than"),
    ],
)
def test_what_is_no_record(tmp_path, data, what):
    path = tmp_path / "bad.json"
    path.write_bytes(data)
    with pytest.raises(HilError, match=re.escape(what)) as refused:
        load(path)
    assert str(path) in refused.value.message


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(HilError, match="could not be read") as refused:
        load(tmp_path / "none.json")
    assert "calibrations/" in refused.value.mend
    with pytest.raises(HilError, match="could not be read"):
        load(tmp_path)


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(at=st.floats(0.0, 1.0), byte=st.integers(0, 255), cut=st.booleans())
def test_damage_is_refused_or_harmless(saved, at, byte, cut):
    """Whatever happens to one byte: an error of the family, or numbers within the limits."""
    whole = saved.read_bytes()
    i = int(at * (len(whole) - 1))
    path = saved.with_name("damaged.json")
    path.write_bytes(whole[:i] if cut else whole[:i] + bytes([byte]) + whole[i + 1 :])
    refusal = ""
    try:
        record = load(path)
    except HilError as error:
        refusal = error.message
    if refusal:
        assert str(path) in refusal
    else:
        assert np.abs(record.calibration.accel_bias_mps2).max() < 2.0


def test_kconfig_fragment_by_hand():
    """Scale 1.01 is 990,099 ppm."""
    text = fragment(made().calibration, "calibrations/a.json\nCONFIG_EVIL=y")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert lines == [
        "CONFIG_BV_CAL_ACCEL_BIAS_X_UMPS2=100000",
        "CONFIG_BV_CAL_ACCEL_BIAS_Y_UMPS2=-200000",
        "CONFIG_BV_CAL_ACCEL_BIAS_Z_UMPS2=300000",
        "CONFIG_BV_CAL_ACCEL_M_XX_PPM=990099",
        "CONFIG_BV_CAL_ACCEL_M_XY_PPM=0",
        "CONFIG_BV_CAL_ACCEL_M_XZ_PPM=0",
        "CONFIG_BV_CAL_ACCEL_M_YX_PPM=0",
        "CONFIG_BV_CAL_ACCEL_M_YY_PPM=990099",
        "CONFIG_BV_CAL_ACCEL_M_YZ_PPM=0",
        "CONFIG_BV_CAL_ACCEL_M_ZX_PPM=0",
        "CONFIG_BV_CAL_ACCEL_M_ZY_PPM=0",
        "CONFIG_BV_CAL_ACCEL_M_ZZ_PPM=990099",
        "CONFIG_BV_CAL_GYRO_BIAS_X_URADPS=10000",
        "CONFIG_BV_CAL_GYRO_BIAS_Y_URADPS=-20000",
        "CONFIG_BV_CAL_GYRO_BIAS_Z_URADPS=30000",
    ]
    assert "# Calibration of one unit, from calibrations/a.json CONFIG_EVIL=y" in text


def test_kconfig_rows_are_rows():
    matrix = np.array([[1.0, 0.001, 0.002], [0.003, 1.0, 0.004], [0.005, 0.006, 1.0]])
    text = fragment(replace(made().calibration, accel_matrix=matrix), "x")
    found = dict(re.findall(r"M_(..)_PPM=(-?\d+)", text))
    assert found["XY"] == "1000"
    assert found["YX"] == "3000"
    assert found["ZY"] == "6000"


def test_kconfig_rounding_leaves_what_the_manual_says():
    """docs/calibration.md, section 6: 15 um/s^2 of force at 1 g, under 0.11 deg/h of rate."""
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(200):
        c = made().calibration
        c = replace(
            c,
            accel_matrix=np.eye(3) + 0.01 * rng.standard_normal((3, 3)),
            accel_bias_mps2=0.2 * rng.standard_normal(3),
            gyro_bias_radps=0.02 * rng.standard_normal(3),
        )
        values = [int(v) * 1e-6 for v in re.findall(r"=(-?\d+)", fragment(c, "x"))]
        bias, matrix, gyro = np.split(np.array(values), [3, 12])
        u = rng.standard_normal(3)
        raw = G * u / np.linalg.norm(u)
        rounded = (raw - bias) @ matrix.reshape(3, 3).T
        worst = max(worst, np.abs(rounded - c.accel(raw)).max())
        assert np.degrees(np.abs(gyro - c.gyro_bias_radps)).max() * 3600 < 0.11
    assert 4e-6 < worst < 15e-6


def test_an_impossible_calibration_makes_no_fragment():
    with pytest.raises(HilError, match="scale"):
        fragment(replace(made().calibration, accel_matrix=2 * np.eye(3)), "x")
