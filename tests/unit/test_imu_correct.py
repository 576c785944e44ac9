# SPDX-License-Identifier: Apache-2.0
"""The correction that a recording says a node applied: by hand, and as the node's own C has it."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.imu import correct
from hil.imu.correct import Correction
from hil.synthesis import Plan, synthesise
from hil.wire.messages import BY_NAME
from hil.wire.records import record_type
from tests.unit.native import STRICT, shared_library

ROOT = Path(__file__).resolve().parents[2]
CALIB = ROOT / "firmware" / "lib" / "calib"
DRIVER = ROOT / "firmware" / "drivers" / "lsm6dsox"
WIRE = ROOT / "firmware" / "lib" / "wire"
SHIM = ROOT / "tests" / "unit" / "c" / "calib_shim.c"
Counts = NDArray[np.int16]

# One count at 16 g and 2000 dps, as DS12814 gives them: 0.488 mg and 70 mdps.
ACCEL_LSB = np.float32(0.488e-3 * 9.80665)
GYRO_LSB = np.float32(70e-3 * np.pi / 180)


ZERO = (0.0, 0.0, 0.0)
IDENTITY = np.eye(3)


def a_correction(bias: Any = ZERO, matrix: Any = IDENTITY, gyro: Any = ZERO) -> Correction:
    return Correction(np.float32(bias), np.float32(matrix), np.float32(gyro))


def rows(*counts: tuple[int, ...]) -> Counts:
    return np.array(counts, np.int16)


# By hand -------------------------------------------------------------------------------------


def test_bias_then_matrix_then_the_nearest_count() -> None:
    """c = (1000 - 10.5, -2000 + 4, 3000); row y: 0.5*989.5 + 1*-1996 + 0.25*3000 = -751.25."""
    c = a_correction((10.5, -4.0, 0.0), [[2, 0, 0], [0.5, 1, 0.25], [0, 0, 1]], (100.25, 0, -0.75))
    got = c.apply(rows((1000, 7, -3, 1000, -2000, 3000)))
    assert got.tolist() == [[900, 7, -2, 1979, -751, 3000]]
    assert got.dtype == np.int16


@pytest.mark.parametrize(
    ("raw", "bias", "expected"),
    [(1, 0.5, 0), (2, 0.5, 2), (3, 0.5, 2), (-1, 0.5, -2), (-2, -0.5, -2)],
)
def test_a_half_goes_to_the_even_count(raw: int, bias: float, expected: int) -> None:
    got = a_correction((bias,) * 3, gyro=(bias,) * 3).apply(rows((raw,) * 6))
    assert got.tolist() == [[expected] * 6]


def test_sums_are_of_single_precision_in_the_written_order() -> None:
    """(2^24 + 1) is no single: (16384*1024 + 1*1) - 16384*1024 is 0 there, and 1 in double."""
    big = [[1024.0, 1.0, -1024.0], [0, 1, 0], [0, 0, 1]]
    assert a_correction(matrix=big).apply(rows((0, 0, 0, 16384, 1, 16384)))[0, 3] == 0
    other = [[1024.0, -1024.0, 1.0], [0, 1, 0], [0, 0, 1]]
    assert a_correction(matrix=other).apply(rows((0, 0, 0, 16384, 16384, 1)))[0, 3] == 1


def test_an_axis_at_the_end_of_its_range_is_passed_on() -> None:
    c = a_correction((5.0,) * 3, 1.05 * np.eye(3), (5.0,) * 3)
    ends = rows(*[(count,) * 6 for count in (32700, 32767, -32700, -32768)])
    np.testing.assert_array_equal(c.apply(ends), ends)
    # 1.05 * (32699 - 5) = 34328.7 is clamped; the gyroscope has no matrix.
    assert c.apply(rows((32699,) * 6)).tolist() == [[32694] * 3 + [32767] * 3]
    # Each axis for itself.
    assert c.apply(rows((32767, 0, 0, 0, 0, 0)))[0].tolist() == [32767, -5, -5, -5, -5, -5]


def test_identity_leaves_every_count() -> None:
    every = np.arange(-32768, 32768, dtype=np.int16)
    table = np.stack([np.roll(every, 9973 * k) for k in range(6)], axis=1)
    np.testing.assert_array_equal(a_correction().apply(table), table)


# Against the node's C --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return shared_library(
        tmp_path_factory.mktemp("correct") / "calib.so",
        [*(CALIB / f"calib_{part}.c" for part in ("correct", "boot", "record")), SHIM],
        [CALIB, WIRE, DRIVER],
        (*STRICT, "-O2", "-ffp-contract=off"),
    )


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


class Line:
    """As much of a recording as the module reads: the messages of one role."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **messages: NDArray[Any]) -> None:
        monkeypatch.setattr(correct, "frames", lambda recording, role, name: messages[name])


def status(*given: dict[str, Any]) -> NDArray[Any]:
    table = np.zeros(len(given), record_type(BY_NAME["cal_status"]))
    table["accel_matrix"] = np.eye(3).ravel()
    table["ready"] = 1
    for row, fields in zip(table, given, strict=True):
        for name, value in fields.items():
            row[name] = value
    return table


def batches(fs_g: int = 16, fs_dps: int = 2000, source: int = 0) -> NDArray[Any]:
    table = np.zeros(3, record_type(BY_NAME["imu_batch"]))
    table["source"], table["accel_fs_g"], table["gyro_fs_dps"] = source, fs_g, fs_dps
    return table


def found(role: str = "leader") -> Correction | None:
    return correct.correction(None, role)  # type: ignore[arg-type]


@pytest.mark.parametrize("fs_g", [2, 4, 8, 16])
@pytest.mark.parametrize("fs_dps", [125, 250, 500, 1000, 2000])
def test_c_and_python_come_to_the_same_bits(
    library: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch, fs_g: int, fs_dps: int
) -> None:
    rng = np.random.default_rng([fs_g, fs_dps])
    edges = np.array([-32768, -32767, -32700, -32699, -1, 0, 1, 32699, 32700, 32767], np.int16)
    for _ in range(20):
        values = np.float32(
            [
                *rng.uniform(-1.9, 1.9, 3),
                *(np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3))).ravel(),
                *rng.uniform(-0.35, 0.35, 3),
            ]
        )
        raw = np.concatenate(
            [
                rng.integers(-32768, 32768, (2000, 6)).astype(np.int16),
                rng.choice(edges, (300, 6)),
                rng.normal(0, 30, (300, 6)).astype(np.int16),
            ]
        )
        Line(
            monkeypatch,
            cal_status=status(
                {
                    "accel_bias_mps2": values[:3],
                    "accel_matrix": values[3:12],
                    "gyro_bias_radps": values[12:],
                }
            ),
            imu_batch=batches(fs_g, fs_dps),
        )
        c = found()
        assert c is not None
        out = np.ascontiguousarray(raw).copy()
        library.shim_correct(
            pointer(values),
            ctypes.c_uint8(fs_g),
            ctypes.c_uint16(fs_dps),
            pointer(out),
            ctypes.c_size_t(len(out)),
        )
        np.testing.assert_array_equal(c.apply(raw), out)
        assert np.any(out != raw)


# Which one -------------------------------------------------------------------------------------


def test_biases_become_counts_of_the_scale_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"accel_bias_mps2": [0.5, -0.25, 0.0], "gyro_bias_radps": [0.01, 0.0, -0.02]}
    Line(monkeypatch, cal_status=status(given), imu_batch=batches())
    c = found()
    assert c is not None
    np.testing.assert_allclose(c.accel_bias_lsb, [0.5 / ACCEL_LSB, -0.25 / ACCEL_LSB, 0], rtol=1e-6)
    np.testing.assert_allclose(c.gyro_bias_lsb, [0.01 / GYRO_LSB, 0, -0.02 / GYRO_LSB], rtol=1e-6)


def test_the_status_before_the_boot_check_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    early = {"ready": 0, "gyro_bias_radps": [0.3, 0.0, 0.0]}
    late = {"gyro_bias_radps": [0.1, 0.0, 0.0]}
    Line(monkeypatch, cal_status=status(early, late, late), imu_batch=batches())
    c = found()
    assert c is not None
    assert c.gyro_bias_lsb[0] == pytest.approx(0.1 / GYRO_LSB, rel=1e-6)


@pytest.mark.parametrize(
    "given",
    [
        [],
        [{"ready": 0}],
        [{}, {"gyro_bias_radps": [0.1, 0, 0]}],
        [{}, {"accel_bias_mps2": [0.1, 0, 0]}],
        [{}, {"accel_matrix": 1.01 * np.eye(3).ravel()}],
        [{"accel_bias_mps2": [np.nan, 0, 0]}],
        [{"gyro_bias_radps": [np.inf, 0, 0]}],
    ],
)
def test_none_several_and_impossible_ones_are_none(
    monkeypatch: pytest.MonkeyPatch, given: list[dict[str, Any]]
) -> None:
    Line(monkeypatch, cal_status=status(*given), imu_batch=batches())
    assert found() is None


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([], False),
        ([{}, {}], False),
        ([{}, {"gyro_bias_radps": [0.1, 0, 0]}], True),
        ([{"accel_bias_mps2": [0.1, 0, 0]}, {}], True),
    ],
)
def test_a_calibration_within_the_run_is_seen(
    monkeypatch: pytest.MonkeyPatch, given: list[dict[str, Any]], expected: bool
) -> None:
    """The samples are then not compared: which correction made which is not known."""
    Line(monkeypatch, cal_status=status(*given), imu_batch=batches())
    assert bool(correct.changed(None, "leader")) is expected  # type: ignore[arg-type]


def test_only_the_nodes_own_batches_tell_its_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    both = np.concatenate([batches(4, 500, source=0), batches(16, 2000, source=1)])
    Line(monkeypatch, cal_status=status({"accel_bias_mps2": [1.0, 0, 0]}), imu_batch=both)
    c = found()
    assert c is not None
    assert c.accel_bias_lsb[0] == pytest.approx(4.0 / ACCEL_LSB, rel=1e-6)
    Line(monkeypatch, cal_status=status({}), imu_batch=batches(source=1))
    assert found("leader") is None


def test_a_stream_without_the_field_was_not_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings from before the correction was on the node hold no such status."""
    old = np.zeros(2, [("ready", "u1"), ("accel_bias_mps2", "f4", 3)])
    Line(monkeypatch, cal_status=old, imu_batch=batches())
    assert found() is None


class Flags:
    def has(self, name: str) -> NDArray[np.bool_]:
        assert name == "uncorrected"
        return np.array([True, False])


def test_batches_that_say_uncorrected_are_compared_raw() -> None:
    raw = rows((0,) * 6, (100,) * 6, (100,) * 6)
    of_batch = np.array([1, 0, 1])
    c = a_correction((3.0,) * 3, gyro=(2.0,) * 3)
    got = correct.expected_counts(Flags(), of_batch, raw, c)  # type: ignore[arg-type]
    assert got.tolist() == [[-2] * 3 + [-3] * 3, [100] * 6, [98] * 3 + [97] * 3]
    assert correct.expected_counts(Flags(), of_batch, raw, None) is raw  # type: ignore[arg-type]


def test_a_synthesised_run_is_read_through_its_recording() -> None:
    """Its nodes say identity and zero, once their boot check has decided in the second second."""
    c = correct.correction(synthesise(Plan(duration_s=5.0)), "follower")
    assert c is not None
    assert c.accel_bias_lsb.tolist() == c.gyro_bias_lsb.tolist() == [0.0] * 3
    assert c.accel_matrix.tolist() == np.eye(3).tolist()
    assert correct.correction(synthesise(Plan(duration_s=1.5)), "follower") is None
