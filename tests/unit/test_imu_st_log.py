# SPDX-License-Identifier: Apache-2.0
"""Logs of real chips: their counts, our scale factors, ST's conversion beside them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from hil.errors import RigError
from hil.imu import st_log

ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("HIL_DATA", ROOT.parent / "shared" / "data")) / "lsm6dsox"
WITH_COUNTS = ("tennis_backhand", "tennis_forehand", "tennis_serve")
TRUE_RATE_HZ = 96.88


def real(name: str) -> st_log.StLog:
    path = FOLDER / f"{name}.txt"
    if not path.exists():
        pytest.skip(f"no real log at {path}; set HIL_DATA to the folder that holds lsm6dsox/")
    return st_log.load(path)


@pytest.mark.parametrize("name", WITH_COUNTS)
def test_counts_times_our_scale_are_the_values_beside_them(name: str) -> None:
    log = real(name)
    assert log.accel_lsb is not None
    assert log.gyro_lsb is not None
    assert log.temperature_lsb is not None
    assert len(log.accel_lsb) > 1500
    # Computed in single precision and printed with three decimals.
    near = {"rtol": 2.0**-23, "atol": 0.000501}
    np.testing.assert_allclose(st_log.accel_mg(log.accel_lsb, 16), log.accel_mg, **near)
    np.testing.assert_allclose(st_log.gyro_dps(log.gyro_lsb, 2000), log.gyro_dps, **near)
    degc = st_log.temperature_degc(log.temperature_lsb)
    np.testing.assert_allclose(degc, log.temperature_degc, **near)


@pytest.mark.parametrize("name", WITH_COUNTS)
def test_another_full_scale_would_not_fit(name: str) -> None:
    log = real(name)
    assert log.accel_lsb is not None
    assert log.gyro_lsb is not None
    assert np.max(np.abs(st_log.accel_mg(log.accel_lsb, 8) - log.accel_mg)) > 100
    assert np.max(np.abs(st_log.gyro_dps(log.gyro_lsb, 1000) - log.gyro_dps)) > 100


@pytest.mark.parametrize("name", WITH_COUNTS)
def test_the_true_rate_is_6_8_percent_below_the_nominal_one(name: str) -> None:
    rate_hz = real(name).rate_hz
    assert round(rate_hz, 2) == TRUE_RATE_HZ
    assert round(100 * (rate_hz / 104 - 1), 1) == -6.8


def test_clipped_samples_are_found_in_the_log_that_clips() -> None:
    clips = {name: np.flatnonzero(real(name).clipped) for name in WITH_COUNTS}
    assert {name: rows.size > 0 for name, rows in clips.items()} == {
        "tennis_backhand": False,
        "tennis_forehand": False,
        "tennis_serve": True,
    }
    # Only the axis of the racket's centrifugal force, which rests there from sample to sample.
    serve = real("tennis_serve")
    assert serve.accel_lsb is not None
    assert serve.gyro_lsb is not None
    at_rail = serve.accel_lsb[clips["tennis_serve"], 1]
    assert at_rail.max() == 32742
    assert np.sum(at_rail == 32742) > np.sum(at_rail != 32742)
    assert np.min(np.diff(clips["tennis_serve"])) == 1
    assert np.max(np.abs(serve.gyro_lsb.astype(int))) < st_log.RAIL_LSB


def test_a_log_without_counts_lies_on_the_grid_of_our_scale() -> None:
    """Six significant digits are printed: each rate must be a whole number of 8.75 mdps."""
    log = real("head_nod")
    assert log.t_us is None
    assert log.accel_lsb is None
    assert log.gyro_dps is not None
    assert np.isnan(log.rate_hz)
    assert log.clipped.size == 0
    lsb = st_log.GYRO_LSB_DPS[250]
    off = np.abs(log.gyro_dps - np.rint(log.gyro_dps / lsb) * lsb)
    digits = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(log.gyro_dps), 1e-3))) - 5)
    assert np.all(off <= 0.501 * digits + 1e-9)
    other = st_log.GYRO_LSB_DPS[500]
    assert np.mean(np.abs(log.gyro_dps / other - np.rint(log.gyro_dps / other)) > 0.4) > 0.3


def test_a_log_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text(
        "Timestamp [us]\tA_X [LSB]\tA_Y [LSB]\tA_Z [LSB]\tG_X [LSB]\tG_Y [LSB]\tG_Z [LSB]\t\n"
        "0\t1\t2\t3\t4\t5\t6\t\n10000\t-32768\t0\t0\t0\t0\t0\t\n20000\t0\t0\t0\t0\t32767\t-1\t\n"
    )
    log = st_log.load(path)
    assert log.rate_hz == pytest.approx(100.0)
    assert log.clipped.tolist() == [False, True, True]
    assert log.gyro_lsb is not None
    assert log.gyro_lsb.tolist() == [[4, 5, 6], [0, 0, 0], [0, 32767, -1]]
    assert log.accel_mg is None
    assert log.temperature_lsb is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "names no columns"),
        ("1\t2\t3\n", "names no columns"),
        ("A_X [mg]\tA_Y [mg]\n1\t2\n1\n", "not as long"),
        ("A_X [mg]\tA_Y [mg]\n1\t2\t3\n", "2 columns"),
        ("A_X [mg]\n", "1 columns"),
    ],
)
def test_what_is_no_log(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "log.txt"
    path.write_text(text)
    with pytest.raises(RigError, match=says):
        st_log.load(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="cannot be read"):
        st_log.load(tmp_path / "missing.txt")
