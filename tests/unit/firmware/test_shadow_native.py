# SPDX-License-Identifier: Apache-2.0
"""The shadow log's means and lines: against NumPy, and by hand."""

from __future__ import annotations

import ctypes
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from hil.wire.codec import encode_payload
from tests.unit.native import shared_library

ROOT = Path(__file__).resolve().parents[3]
FIRMWARE = ROOT / "firmware"
TICKS_PER_CELL = 160_000
TEXT_MAX = 112


@pytest.fixture(scope="module")
def lib(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    diag = FIRMWARE / "lib" / "diag"
    found = shared_library(
        tmp_path_factory.mktemp("shadow") / "shadow.so",
        [diag / "shadow_mean.c", diag / "shadow_row.c", ROOT / "tests/unit/c/shadow_shim.c"],
        [diag, FIRMWARE / "lib" / "wire", FIRMWARE / "drivers" / "lsm6dsox"],
    )
    for name in ("shim_push", "shim_text", "shim_text_of"):
        getattr(found, name).restype = ctypes.c_size_t
    return found


def line(lib: ctypes.CDLL, t_us: int, accel: int, gyro: int, flags: int) -> str:
    text = ctypes.create_string_buffer(TEXT_MAX)
    size = lib.shim_text_of(
        ctypes.c_uint64(t_us), ctypes.c_int32(accel), ctypes.c_int32(gyro), flags, text
    )
    assert size == len(text.value)
    return text.value.decode("ascii")


def test_lines_are_fixed_point(lib: ctypes.CDLL) -> None:
    assert line(lib, 0, 0, 0, 0) == "shadow,0" + 3 * ",0.0000" + 3 * ",0.00000" + ",0"
    a, g = ",-0.0001", ",-1.00009"
    assert line(lib, 12345678901, -1, -100009, 5) == f"shadow,12345678901{3 * a}{3 * g},5"
    # The longest there can be just fits.
    low = -(2**31)
    longest = line(lib, 2**64 - 1, low, low, 65535)
    assert longest == f"shadow,{2**64 - 1}{3 * ',-214748.3648'}{3 * ',-21474.83648'},65535"
    assert len(longest) == TEXT_MAX - 1


def fed(
    lib: ctypes.CDLL, batches: list[bytes]
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(n, 8) rows of the log after these batches."""
    lib.shim_begin()
    count = 0
    for payload in batches:
        count = lib.shim_push(payload, ctypes.c_size_t(len(payload)))
    text = ctypes.create_string_buffer(TEXT_MAX)
    rows = []
    for k in range(count):
        lib.shim_text(ctypes.c_size_t(k), text)
        kind, *values = text.value.decode("ascii").split(",")
        assert kind == "shadow"
        rows.append([float(v) for v in values])
    return np.array(rows)


def batch(
    index: int,
    t_ticks: int,
    period: int,
    lsb: np.ndarray[tuple[int, int], np.dtype[np.int16]],
    flags: int = 1,
) -> bytes:
    values = {
        "source": 1,
        "flags": flags,
        "accel_fs_g": 16,
        "gyro_fs_dps": 2000,
        "sample_index": index,
        "t_first_ticks_node": t_ticks,
        "period_ticks": period * 256,
        "t_sigma_ticks": 0,
        "temperature_cdegc": 2500,
        "count": len(lsb),
        "samples": [{"gyro_lsb": r[:3].tolist(), "accel_lsb": r[3:].tolist()} for r in lsb],
    }
    return encode_payload("imu_batch", values)


@pytest.mark.parametrize("rate_hz", [12.5, 104.0, 416.0, 1667.0, 6667.0])
def test_means_are_numpys(lib: ctypes.CDLL, rate_hz: float) -> None:
    rng = np.random.default_rng(int(rate_hz))
    n, period = 1600, round(16e6 / rate_hz)
    lsb = rng.integers(-32000, 32000, (n, 6)).astype(np.int16)
    t = 7_777_777 + period * np.arange(n)
    found = fed(lib, [batch(k, int(t[k]), period, lsb[k : k + 8]) for k in range(0, n, 8)])
    cells, first = np.unique(t // TICKS_PER_CELL, return_index=True)
    # The last cell has not ended yet.
    spans = list(pairwise(first))
    assert len(found) == len(cells) - 1
    scale = np.r_[[35e-6 * 2000 * np.pi / 180] * 3, [30.5e-6 * 16 * 9.80665] * 3]
    means = np.array([(lsb[a:b].astype(float) * scale).mean(axis=0) for a, b in spans])
    np.testing.assert_allclose(found[:, 1:4], means[:, 3:], atol=0.5e-4 * 1.001)
    np.testing.assert_allclose(found[:, 4:7], means[:, :3], atol=0.5e-5 * 1.001)
    middle = np.array([(t[a] + t[b - 1]) // 32 for a, b in spans])
    np.testing.assert_array_equal(found[:, 0], middle)
    assert not found[:, 7].any()


def test_flags_say_clipped_uncorrected_and_a_gap(lib: ctypes.CDLL) -> None:
    lsb = np.zeros((8, 6), np.int16)
    edge = lsb.copy()
    edge[2, 1] = -32700
    period = 40_000
    found = fed(
        lib,
        [
            batch(0, 0, period, lsb),
            batch(8, 8 * period, period, edge),
            batch(16, 16 * period, period, lsb, flags=1 | 8),
            batch(40, 40 * period, period, lsb),
            batch(48, 48 * period, period, lsb),
        ],
    )
    # Four samples to a cell.
    assert found[:, 7].tolist() == [0, 0, 1, 0, 2, 2, 4, 0, 0]
