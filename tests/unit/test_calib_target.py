# SPDX-License-Identifier: Apache-2.0
"""The calibration on the target: correction in counts, boot check, stored form.

The code is the firmware's own C source, compiled by the host's compiler. The correction is repeated
in NumPy's float32 bit for bit; thresholds come from made samples whose statistics are exact; the
stored form is put together with :mod:`struct` and :mod:`zlib`.
"""

from __future__ import annotations

import ctypes
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.wire.messages import BOOT_CHECKS, CAL_REASONS
from tests.unit.native import STRICT, shared_library

ROOT = Path(__file__).resolve().parents[2]
CALIB = ROOT / "firmware" / "lib" / "calib"
WIRE = ROOT / "firmware" / "lib" / "wire"
DRIVER = ROOT / "firmware" / "drivers" / "lsm6dsox"
SHIM = ROOT / "tests" / "unit" / "c" / "calib_shim.c"

G_MPS2 = 9.80665
TICKS_PER_S = 16_000_000
DEVICE_ID = 0x0123456789ABCDEF
OPEN, MOVED, STILL = 0, 1, 2

Floats = NDArray[np.float32]
Counts = NDArray[np.int16]
IDENTITY = np.concatenate([np.zeros(3), np.eye(3).ravel(), np.zeros(3)]).astype(np.float32)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return shared_library(
        tmp_path_factory.mktemp("calib") / "calib.so",
        [*(CALIB / f"calib_{part}.c" for part in ("correct", "boot", "record")), SHIM],
        [CALIB, WIRE, DRIVER],
        (*STRICT, "-O2", "-ffp-contract=off"),
    )


def pointer(array: NDArray[np.generic]) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


# Correction ----------------------------------------------------------------------------------


def correct(
    library: ctypes.CDLL, values: Floats, rows: Counts, fs_g: int = 16, fs_dps: int = 2000
) -> Counts:
    """int16[n, 6]: gyro, accel. ``values``: accel bias, matrix, gyro bias; in SI units."""
    out = np.ascontiguousarray(rows).copy()
    library.shim_correct(
        pointer(np.ascontiguousarray(values, dtype=np.float32)),
        ctypes.c_uint8(fs_g),
        ctypes.c_uint16(fs_dps),
        pointer(out),
        ctypes.c_size_t(len(out)),
    )
    return out


def expected_counts(values: Floats, rows: Counts, fs_g: int, fs_dps: int) -> Counts:
    """The same in NumPy, every operation one float32."""
    mps2_per_lsb = np.float32(fs_g * 3.05e-5 * 9.80665)
    radps_per_lsb = np.float32(fs_dps * 3.5e-5 * np.pi / 180)
    bias, m, drift = values[:3], values[3:12].reshape(3, 3), values[12:]
    gyro = rows[:, :3].astype(np.float32) - drift / radps_per_lsb
    c = rows[:, 3:].astype(np.float32) - bias / mps2_per_lsb
    accel = np.stack(
        [(m[i, 0] * c[:, 0] + m[i, 1] * c[:, 1]) + m[i, 2] * c[:, 2] for i in range(3)], axis=1
    )
    assert gyro.dtype == accel.dtype == np.float32
    out = np.clip(np.rint(np.concatenate([gyro, accel], axis=1)), -32767, 32767).astype(np.int16)
    clipped = np.abs(rows.astype(np.int32)) >= 32700
    return np.asarray(np.where(clipped, rows, out), dtype=np.int16)


def random_values(rng: np.random.Generator) -> Floats:
    return np.concatenate(
        [
            rng.uniform(-0.5, 0.5, 3),
            (np.eye(3) + rng.uniform(-0.05, 0.05, (3, 3))).ravel(),
            rng.uniform(-0.05, 0.05, 3),
        ]
    ).astype(np.float32)


ALL_COUNTS = np.arange(-32768, 32768, dtype=np.int16)


def test_identity_and_zero_leave_every_count_as_it_is(library: ctypes.CDLL) -> None:
    others = np.random.default_rng(1).permutation(ALL_COUNTS)
    rows = np.stack([ALL_COUNTS, others, ALL_COUNTS[::-1]] * 2, axis=1)
    np.testing.assert_array_equal(correct(library, IDENTITY, rows), rows)


@pytest.mark.parametrize("fs_g", [2, 4, 8, 16])
@pytest.mark.parametrize("fs_dps", [125, 250, 500, 1000, 2000])
def test_numpy_comes_to_the_same_counts(library: ctypes.CDLL, fs_g: int, fs_dps: int) -> None:
    rng = np.random.default_rng([fs_g, fs_dps])
    rows = rng.integers(-32768, 32768, (20_000, 6)).astype(np.int16)
    for _ in range(5):
        values = random_values(rng)
        np.testing.assert_array_equal(
            correct(library, values, rows, fs_g, fs_dps),
            expected_counts(values, rows, fs_g, fs_dps),
        )


def test_a_known_chip_is_put_right_to_half_a_count(library: ctypes.CDLL) -> None:
    """In double, from the chip's own model: raw = M^-1 a + b."""
    rng = np.random.default_rng(3)
    values = random_values(rng)
    m = values[3:12].reshape(3, 3).astype(float)
    lsb = 16 * 3.05e-5 * G_MPS2
    truth = rng.uniform(-100, 100, (1000, 3))
    raw = np.rint((truth @ np.linalg.inv(m).T + values[:3].astype(float)) / lsb).astype(np.int16)
    rows = np.concatenate([np.zeros_like(raw), raw], axis=1)
    got = correct(library, values, rows)[:, 3:] * lsb
    # The sensor's own rounding through M, and that of the result.
    assert np.max(np.abs(got - truth)) < 0.5 * lsb * (np.max(np.sum(np.abs(m), axis=1)) + 1.01)


def test_half_a_count_goes_to_the_even_neighbour(library: ctypes.CDLL) -> None:
    lsb = np.float32(2000 * 3.5e-5 * np.pi / 180)
    values = IDENTITY.copy()
    values[12] = lsb / np.float32(2)
    rows = np.zeros((4, 6), np.int16)
    rows[:, 0] = [1, 2, 3, -1]
    np.testing.assert_array_equal(correct(library, values, rows)[:, 0], [0, 2, 2, -2])


def test_the_end_of_the_range_stays_visible(library: ctypes.CDLL) -> None:
    values = IDENTITY.copy()
    values[:3] = values[12:] = 1.0
    rows = np.repeat(np.array([[32767], [-32768], [32700], [-32700]], np.int16), 6, axis=1)
    np.testing.assert_array_equal(correct(library, values, rows), rows)
    # One count less is corrected.
    assert np.all(correct(library, values, rows[2:3] - np.int16(1)) < 32699)


def test_results_beyond_the_range_are_clamped(library: ctypes.CDLL) -> None:
    values = IDENTITY.copy()
    values[3:12:4] = 1.1
    rows = np.array([[0, 0, 0, 32000, -32000, 32000]], np.int16)
    np.testing.assert_array_equal(correct(library, values, rows), [[0, 0, 0, 32767, -32767, 32767]])


# Boot check ----------------------------------------------------------------------------------


def run_boot(
    library: ctypes.CDLL, t_ticks: NDArray[np.uint64], rows: Floats, restart_at: int = -1
) -> tuple[NDArray[np.intc], Floats, int]:
    """Events, the last measured bias [rad/s], attempts."""
    rows = np.ascontiguousarray(rows, dtype=np.float32)
    events = np.empty(len(rows), np.intc)
    bias = np.empty(3, np.float32)
    library.shim_boot.restype = ctypes.c_uint32
    attempts = library.shim_boot(
        pointer(t_ticks),
        pointer(rows),
        ctypes.c_size_t(len(rows)),
        ctypes.c_size_t(restart_at % 2**64),
        pointer(events),
        pointer(bias),
    )
    return events, bias, int(attempts)


def times(rate_hz: float, n: int, first_ticks: int = 10**12) -> NDArray[np.uint64]:
    since = np.rint(np.arange(n) * TICKS_PER_S / rate_hz).astype(np.uint64)
    return since + np.uint64(first_ticks)


def resting(n: int, bias_dps: tuple[float, float, float] = (0.5, -0.7, 0.2)) -> NDArray[np.float64]:
    """A sensor that hangs askew, without noise."""
    row = [*np.deg2rad(bias_dps), 3.0, -4.0, 8.4]
    return np.tile(np.array(row), (n, 1))


def with_std(n: int, axis: int, std: float) -> NDArray[np.float64]:
    """Alternates about the mean, so that the standard deviation over even counts is exact."""
    rows = resting(n)
    rows[:, axis] += std * np.where(np.arange(n) % 2 == 0, 1, -1)
    return rows


@pytest.mark.parametrize("rate_hz", [12.5 * 0.93, 12.5, 26, 104, 417, 833, 1000, 1667])
def test_a_still_second_gives_the_bias(library: ctypes.CDLL, rate_hz: float) -> None:
    """With the sensor's own noise: 3.8 mdps/rtHz and 110 ug/rtHz in half of the rate."""
    rng = np.random.default_rng(int(rate_hz * 10))
    n = int(rate_hz * 1.2) + 2
    rows = resting(n)
    rows[:, :3] += rng.normal(0, np.deg2rad(3.8e-3) * np.sqrt(rate_hz / 2), (n, 3))
    rows[:, 3:] += rng.normal(0, 110e-6 * G_MPS2 * np.sqrt(rate_hz / 2), (n, 3))
    events, bias, attempts = run_boot(library, times(rate_hz, n), rows)
    at = int(np.flatnonzero(events == STILL)[0])
    # The first sample a second or more after the window's first ends it.
    assert (times(rate_hz, n)[at] - times(rate_hz, n)[0]) >= TICKS_PER_S
    assert (times(rate_hz, n)[at - 1] - times(rate_hz, n)[0]) < TICKS_PER_S
    np.testing.assert_allclose(bias, rows[:at, :3].mean(axis=0), atol=np.deg2rad(1e-5))
    np.testing.assert_allclose(np.rad2deg(bias), [0.5, -0.7, 0.2], atol=0.012)
    assert attempts == 1


@pytest.mark.parametrize("axis", range(6))
def test_each_axis_has_its_limit_of_noise(library: ctypes.CDLL, axis: int) -> None:
    limit = np.deg2rad(0.3) if axis < 3 else 15e-3 * G_MPS2
    t = times(100, 102)
    for std, expected in ((0.98 * limit, STILL), (1.02 * limit, MOVED)):
        events, _, _ = run_boot(library, t, with_std(102, axis, std))
        assert events[100] == expected, (axis, std)


def test_a_steady_turn_shows_in_the_direction_of_gravity(library: ctypes.CDLL) -> None:
    """0.46 dps about a level axis; no deviation from the mean betrays it."""
    t = times(200, 202)
    since_s = (t - t[0]).astype(float) / TICKS_PER_S
    for rate_dps, expected in ((0.3, STILL), (0.6, MOVED)):
        rows = np.zeros((202, 6))
        angle = np.deg2rad(rate_dps) * since_s
        rows[:, 0] = np.deg2rad(rate_dps)
        rows[:, 4], rows[:, 5] = G_MPS2 * np.sin(angle), G_MPS2 * np.cos(angle)
        events, _, _ = run_boot(library, t, rows)
        assert events[200] == expected, rate_dps


def test_a_step_of_the_mean_force_is_motion(library: ctypes.CDLL) -> None:
    t = times(100, 102)
    for step_mg, expected in ((3.8, STILL), (4.2, MOVED)):
        rows = resting(102)
        rows[50:, 3] += step_mg * 1e-3 * G_MPS2
        events, _, _ = run_boot(library, t, rows)
        assert events[100] == expected, step_mg


def test_windows_go_on_until_one_is_still(library: ctypes.CDLL) -> None:
    t = times(100, 402)
    rows = resting(402)
    rows[10:250, 0] += np.deg2rad(50) * np.sin(np.arange(240))
    rows[10:240, 3] += 2.0
    events, bias, attempts = run_boot(library, t, rows)
    ends = np.flatnonzero(events)
    np.testing.assert_array_equal(ends, [100, 200, 300, 400])
    np.testing.assert_array_equal(events[ends], [MOVED, MOVED, MOVED, STILL])
    np.testing.assert_allclose(np.rad2deg(bias), [0.5, -0.7, 0.2], atol=1e-5)
    assert attempts == 4


def test_a_gap_begins_the_window_anew(library: ctypes.CDLL) -> None:
    t = times(100, 170)
    for gap_s, end in ((0.2, 80), (0.26, 160)):
        late = t.copy()
        # Sample 60 comes this much after sample 59.
        late[60:] += np.uint64(round((gap_s - 0.01) * TICKS_PER_S))
        events, _, attempts = run_boot(library, late, resting(170))
        assert np.flatnonzero(events)[0] == pytest.approx(end, abs=1), gap_s
        assert attempts == 1


def test_time_that_runs_back_begins_the_window_anew(library: ctypes.CDLL) -> None:
    t = times(100, 200)
    t[60:] -= np.uint64(5 * TICKS_PER_S)
    events, _, _ = run_boot(library, t, resting(200))
    assert np.flatnonzero(events)[0] == 160


def test_a_restart_drops_the_window_and_keeps_the_count(library: ctypes.CDLL) -> None:
    rows = with_std(320, 0, np.deg2rad(2.0))
    rows[150:] = resting(170)
    events, _, attempts = run_boot(library, times(100, 320), rows, restart_at=150)
    np.testing.assert_array_equal(np.flatnonzero(events), [100, 250])
    np.testing.assert_array_equal(events[[100, 250]], [MOVED, STILL])
    assert attempts == 2


def test_too_few_samples_are_no_stillness(library: ctypes.CDLL) -> None:
    for rate_hz, expected in ((9.0, MOVED), (10.0, STILL)):
        events, _, _ = run_boot(library, times(rate_hz, 12), resting(12))
        assert events[np.flatnonzero(events)[0]] == expected


def test_a_large_constant_does_not_drown_the_noise(library: ctypes.CDLL) -> None:
    """16 g and 2000 dps of constant, for 1667 samples: the sums are of differences."""
    n = 1670
    rng = np.random.default_rng(9)
    rows = np.tile([35.0, -35.0, 35.0, 157.0, -157.0, 157.0], (n, 1))
    rows[:, :3] += rng.normal(0, np.deg2rad(0.2), (n, 3))
    rows[:, 3:] += rng.normal(0, 10e-3 * G_MPS2, (n, 3))
    events, bias, _ = run_boot(library, times(1667, n), rows)
    end = int(np.flatnonzero(events)[0])
    assert events[end] == STILL
    np.testing.assert_allclose(
        bias, rows[:end, :3].astype(np.float32).astype(float).mean(axis=0), atol=1e-5
    )


def test_what_is_no_number_is_no_stillness(library: ctypes.CDLL) -> None:
    for axis in range(6):
        rows = resting(102)
        rows[40, axis] = np.nan
        events, _, _ = run_boot(library, times(100, 102), rows)
        assert events[100] == MOVED


@pytest.mark.parametrize(
    ("delta_dps", "expected"),
    [
        (0.0, "applied"),
        (0.299, "applied"),
        (0.301, "warned"),
        (1.999, "warned"),
        (2.001, "refused"),
        (50.0, "refused"),
    ],
)
def test_the_decision_is_by_the_length_of_the_difference(
    library: ctypes.CDLL, delta_dps: float, expected: str
) -> None:
    stored = np.array([0.01, -0.02, 0.03], np.float32)
    direction = np.array([2.0, -3.0, 6.0]) / 7.0
    measured = (stored + np.deg2rad(delta_dps) * direction).astype(np.float32)
    delta = ctypes.c_float()
    got = library.shim_decide(pointer(measured), pointer(stored), ctypes.byref(delta))
    assert got == BOOT_CHECKS[expected]
    assert delta.value == pytest.approx(delta_dps, abs=2e-6 * (1 + delta_dps))


# Stored form ---------------------------------------------------------------------------------

NUMBERS = np.array(
    [0.1, -0.2, 0.3, 1.01, 0.02, 0, -0.01, 0.99, 0.005, 0, 0.001, 1.002, 0.01, -0.02, 0.003],
    np.float32,
)
MAGIC, VERSION = 0x4143, 1


def stored_form(
    numbers: Floats = NUMBERS,
    *,
    magic: int = MAGIC,
    version: int = VERSION,
    device_id: int = DEVICE_ID,
    tail: bytes = b"",
) -> bytes:
    """By the description in calib_record.h, with its CRC right."""
    body = struct.pack("<HHQIh15f", magic, version, device_id, 1_790_000_000, 2475, *numbers) + tail
    return body + struct.pack("<I", zlib.crc32(body))


def decode(library: ctypes.CDLL, data: bytes, device_id: int = DEVICE_ID) -> tuple[str, Floats]:
    numbers = np.zeros(15, np.float32)
    crc = ctypes.c_uint32()
    reason = library.shim_decode(
        data,
        ctypes.c_size_t(len(data)),
        ctypes.c_uint64(device_id),
        ctypes.byref(crc),
        pointer(numbers),
    )
    name = next(name for name, value in CAL_REASONS.items() if value == reason)
    if name == "none":
        assert crc.value == zlib.crc32(data[:-4])
    return name, numbers


def test_the_stored_form_is_as_described(library: ctypes.CDLL) -> None:
    out = np.zeros(82, np.uint8)
    library.shim_encode.restype = ctypes.c_uint32
    crc = library.shim_encode(
        pointer(out),
        ctypes.c_uint64(DEVICE_ID),
        ctypes.c_uint32(1_790_000_000),
        ctypes.c_int16(2475),
        pointer(NUMBERS),
    )
    assert out.tobytes() == stored_form()
    assert crc == zlib.crc32(stored_form()[:-4])


def test_what_is_stored_is_read(library: ctypes.CDLL) -> None:
    reason, numbers = decode(library, stored_form())
    assert reason == "none"
    np.testing.assert_array_equal(numbers, NUMBERS)


def test_every_flipped_bit_is_found(library: ctypes.CDLL) -> None:
    good = stored_form()
    for bit in range(8 * len(good)):
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        assert decode(library, bytes(bad))[0] == "corrupt", bit


def test_every_length_but_its_own_is_refused(library: ctypes.CDLL) -> None:
    good = stored_form()
    assert decode(library, b"")[0] == "absent"
    for length in range(1, len(good)):
        assert decode(library, good[:length])[0] == "corrupt", length
    assert decode(library, stored_form(tail=b"\0"))[0] == "corrupt"


def test_reasons(library: ctypes.CDLL) -> None:
    assert decode(library, stored_form(), DEVICE_ID + 1)[0] == "other_device"
    assert decode(library, stored_form(version=2))[0] == "version"
    assert decode(library, stored_form(version=2, tail=b"more of it"))[0] == "version"
    assert decode(library, stored_form(magic=MAGIC ^ 1))[0] == "corrupt"


def changed(*changes: tuple[int, float]) -> Floats:
    numbers = NUMBERS.copy()
    for at, value in changes:
        numbers[at] = value
    return numbers


@pytest.mark.parametrize("at", range(15))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3.4e38])
def test_numbers_must_be_finite_and_possible(library: ctypes.CDLL, at: int, value: float) -> None:
    assert decode(library, stored_form(changed((at, value))))[0] == "corrupt"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (((0, 1.1), (1, 1.1), (2, 1.2)), "none"),  # 1.97 m/s^2
        (((0, 1.2), (1, 1.2), (2, 1.2)), "corrupt"),  # 2.08 m/s^2
        (((0, -2.01), (1, 0), (2, 0)), "corrupt"),
        (((3, 1.0999),), "none"),
        (((3, 1.1001),), "corrupt"),
        (((7, 0.8999),), "corrupt"),
        (((4, 0.0999),), "none"),
        (((4, -0.1001),), "corrupt"),
        (((10, 0.1001),), "corrupt"),
        (((12, 0.2), (13, 0.2), (14, 0.2)), "none"),  # 0.346 rad/s
        (((12, 0.21), (13, 0.2), (14, 0.2)), "corrupt"),  # 0.352 rad/s
    ],
)
def test_limits(
    library: ctypes.CDLL, changes: tuple[tuple[int, float], ...], expected: str
) -> None:
    assert decode(library, stored_form(changed(*changes)))[0] == expected
