# SPDX-License-Identifier: Apache-2.0
"""The shadow log and the REP frames on the simulated bench: one short set of bench presses.

What the lines say is worked out in NumPy from the batches that the same nodes sent.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from hil import build, checks, scenario
from hil.backends.sim import SimBackend
from hil.build import Manifest
from hil.fusion.inputs import runs
from hil.log.text import SHADOW, Table, tables
from hil.measure import Verdict
from hil.recording import Recording
from hil.reference.params import Params
from hil.streams import frames, last_value, rows
from hil.wire.messages import IMU_FLAGS

Float = NDArray[np.float64]
DURATION_S = 16.0
CELL_US = 10_000
ACCEL = ("ax_mps2", "ay_mps2", "az_mps2")
GYRO = ("gx_radps", "gy_radps", "gz_radps")
# Half of the last decimal, and the rounding of floats in the leader's filter.
ACCEL_MPS2, GYRO_RADPS = 0.6e-4, 0.6e-5


@pytest.fixture(scope="module")
def logging_images(build_environment: dict[str, str]) -> Mapping[str, Manifest]:
    """Both nodes' images with the log."""
    del build_environment
    return build.build_images({role: {"BV_SHADOW_LOG": True} for role in scenario.ROLES}, "sim")


@pytest.fixture(scope="module")
def recording(
    logging_images: Mapping[str, Manifest], tmp_path_factory: pytest.TempPathFactory
) -> Recording:
    plan = scenario.from_mapping(
        {
            "name": "shadow",
            "duration_s": DURATION_S,
            "motion": {"lift": "bench", "seed": 3},
            "nodes": {
                "leader": {"drift_ppm": 13.7, "start_offset_us": 12345},
                "follower": {"drift_ppm": -31.1, "start_offset_us": 87654},
            },
        },
        "test",
    )
    target = tmp_path_factory.mktemp("shadow") / "recording.mcap"
    return SimBackend(images=logging_images).run(plan, target, lambda *_: None)


def log_of(recording: Recording, role: str) -> tuple[Table, Float, Float]:
    """The table, and its accelerations and rates, (n, 3) each."""
    table = tables(recording, role)[SHADOW]
    vectors = [np.column_stack([table.columns[c] for c in names]) for names in (ACCEL, GYRO)]
    return table, *vectors


@pytest.mark.parametrize("role", scenario.ROLES)
def test_the_log_has_100_rows_a_second_and_loses_none(recording: Recording, role: str) -> None:
    table, _, _ = log_of(recording, role)
    t_us = table.columns["t_us_node"]
    assert table.bad_rows == 0
    # With each HELLO.
    assert table.headings >= DURATION_S / 2 - 1
    assert t_us.dtype == np.int64
    # One row in each 10 ms of the node's clock, without exception.
    assert np.unique(np.diff(t_us // CELL_US)).tolist() == [1]
    assert (len(t_us) - 1) / (t_us[-1] - t_us[0]) * 1e6 == pytest.approx(100.0, abs=0.1)
    assert (t_us[-1] - t_us[0]) / 1e6 > DURATION_S - 3.0
    assert last_value(frames(recording, role, "system"), "uart_dropped") == 0


def test_the_leaders_rows_are_what_its_estimator_sees(recording: Recording) -> None:
    table, accel, gyro = log_of(recording, "leader")
    fed = runs(recording)[-1].samples.leader
    length = Params().average_length
    kernel = np.ones(length) / length
    filtered = [
        np.column_stack([np.convolve(axis, kernel, "valid") for axis in x.T])
        for x in (fed.accel_mps2, fed.gyro_radps)
    ]
    # A mean of samples belongs to the middle of their times.
    t_us = (fed.t_ticks[length - 1 :] + fed.t_ticks[: 1 - length]) / 2.0 / 16.0
    at = np.argmin(np.abs(table.columns["t_us_node"][:, np.newaxis] - t_us), axis=1)
    assert np.abs(table.columns["t_us_node"] - t_us[at]).max() < 2.0
    assert np.abs(accel - filtered[0][at]).max() < ACCEL_MPS2
    assert np.abs(gyro - filtered[1][at]).max() < GYRO_RADPS
    # The first one in its cell: the one before it lies in another.
    cells = (t_us // CELL_US).astype(np.int64)
    assert (cells[at[1:]] != cells[at[1:] - 1]).all()
    # The bar moves: the figures are not those of a bar at rest.
    assert np.ptp(accel[:, 2]) > 1.0


def test_the_followers_rows_are_means_of_its_samples(recording: Recording) -> None:
    table, accel, gyro = log_of(recording, "follower")
    sent, raw = (of(recording, "follower", "imu_batch") for of in (frames, rows))
    head = sent[raw["row"]]
    count = sent["count"].astype(np.int64)
    within = np.arange(len(raw)) - np.repeat(np.cumsum(count) - count, count)
    t_ticks = head["t_first_ticks_node"].astype(np.int64) + (
        (within * head["period_ticks"].astype(np.int64) + 128) >> 8
    )
    a = raw["accel_lsb"] * (head["accel_fs_g"] * 30.5e-6 * 9.80665)[:, np.newaxis]
    g = raw["gyro_lsb"] * (head["gyro_fs_dps"] * 35e-6 * np.pi / 180)[:, np.newaxis]
    cells, first, size = np.unique(t_ticks // 160_000, return_index=True, return_counts=True)
    known = np.isin(cells, table.columns["t_us_node"] // CELL_US)
    assert np.count_nonzero(known) == len(table)
    means = [np.add.reduceat(x, first)[known] / size[known, np.newaxis] for x in (a, g)]
    assert np.abs(accel - means[0]).max() < ACCEL_MPS2
    assert np.abs(gyro - means[1]).max() < GYRO_RADPS
    middle_us = (t_ticks[first] + t_ticks[first + size - 1])[known] // 32
    assert np.abs(table.columns["t_us_node"] - middle_us).max() <= 0
    uncorrected = np.add.reduceat((head["flags"] & IMU_FLAGS["uncorrected"]) != 0, first)[known]
    assert np.array_equal((table.columns["flags"] & 2) != 0, uncorrected > 0)


def test_frames_are_untouched_and_repetitions_are_those_of_the_definition(
    recording: Recording,
) -> None:
    found = {m.name: m for m in checks.evaluate(recording)}
    assert found["ekf.core_mismatches"].value == 0
    assert len(frames(recording, "leader", "rep")) >= 2
    for name in ("ekf.rep_frames_wrong", "ekf.rep_velocity_error_mmps"):
        assert found[name].verdict is Verdict.PASS, found[name]
    lossless = [m for m in found.values() if m.name.startswith("link.") and not m.verdict.ok]
    assert lossless == []
