# SPDX-License-Identifier: Apache-2.0
"""The decimator of IMU batches: what it passes, what it stops, and whose times it keeps.

The filter is the firmware's own C source, compiled by the host's compiler.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.native import USUAL, shared_library

ROOT = Path(__file__).resolve().parents[2]
IMU = ROOT / "firmware" / "lib" / "imu"
WIRE = ROOT / "firmware" / "lib" / "wire"
SHIM = ROOT / "tests" / "unit" / "c" / "imu_decimate_shim.c"

BATCH = 16
PERIOD_Q8 = 2575 * 256 + 77
T_ZERO = 10**12
HARDWARE_TIME, OVERRUN_BEFORE, CLIPPED = 1, 2, 4
FACTORS = (2, 4, 8, 16)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    output = tmp_path_factory.mktemp("imu") / "decimate.so"
    loaded = shared_library(output, [IMU / "imu_decimate.c", SHIM], [IMU, WIRE], USUAL)
    loaded.shim_new.restype = ctypes.c_void_p
    loaded.shim_rows.restype = ctypes.c_size_t
    return loaded


def t_ticks(index: NDArray[np.int64] | int) -> NDArray[np.float64]:
    """Time of sample ``index`` of the input."""
    return np.asarray(T_ZERO + np.asarray(index) * PERIOD_Q8 / 256, dtype=np.float64)


def run(
    library: ctypes.CDLL,
    factor: int,
    samples: NDArray[np.int16],
    *,
    first: int = 0,
    holes: frozenset[int] = frozenset(),
    flags: dict[int, int] | None = None,
    batch: int = BATCH,
) -> NDArray[np.float64]:
    """Columns: index, t of its batch, period, flags, place in the batch, six counts.

    ``holes`` and the keys of ``flags`` are numbers of input batches.
    """
    handle = ctypes.c_void_p(library.shim_new(factor, batch))
    for number, at in enumerate(range(0, len(samples) - BATCH + 1, BATCH)):
        if number in holes:
            continue
        block = np.ascontiguousarray(samples[at : at + BATCH], dtype=np.int16)
        library.shim_push(
            handle,
            ctypes.c_uint32(first + at),
            ctypes.c_uint64(round(float(t_ticks(first + at)))),
            ctypes.c_uint32(PERIOD_Q8),
            ctypes.c_uint8((flags or {}).get(number, HARDWARE_TIME)),
            block.ctypes.data_as(ctypes.POINTER(ctypes.c_int16)),
            ctypes.c_uint8(BATCH),
        )
    rows = np.empty((library.shim_rows(handle), 11))
    library.shim_copy(handle, rows.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))
    library.shim_free(handle)
    return rows


def tone(cycles_per_sample: float, count: int, amplitude: float = 20000.0) -> NDArray[np.int16]:
    phase = 2 * np.pi * cycles_per_sample * np.arange(count)
    return np.rint(amplitude * np.sin(phase)[:, None] * np.ones(6)).astype(np.int16)


def test_factor_one_passes_batches_through(library: ctypes.CDLL) -> None:
    samples = tone(0.1, 160)
    rows = run(library, 1, samples)
    np.testing.assert_array_equal(rows[:, 5:], samples)
    np.testing.assert_array_equal(rows[:, 0], np.arange(160))


@pytest.mark.parametrize("factor", FACTORS)
def test_a_constant_comes_out_exactly(library: ctypes.CDLL, factor: int) -> None:
    samples = np.tile(np.array([32767, -32768, 1, -1, 2049, 0], np.int16), (640, 1))
    rows = run(library, factor, samples)
    assert len(rows) > 10
    np.testing.assert_array_equal(rows[:, 5:], np.tile(samples[0], (len(rows), 1)))


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("first", [0, 5, 123457])
def test_a_sample_belongs_to_the_instant_of_the_one_it_names(
    library: ctypes.CDLL, factor: int, first: int
) -> None:
    """A ramp passes a symmetric filter unchanged: the value tells which input it stands for."""
    samples = np.tile(np.arange(1600, dtype=np.int16)[:, None], (1, 6))
    rows = run(library, factor, samples, first=first)
    index = rows[:, 0].astype(np.int64)
    assert np.all(np.diff(index) == 1)
    np.testing.assert_array_equal(rows[:, 5], index * factor - first)
    at = rows[:, 1] + rows[:, 4] * rows[:, 2] / 256
    assert np.max(np.abs(at - t_ticks(index * factor))) <= 1.0
    np.testing.assert_array_equal(rows[:, 2], PERIOD_Q8 * factor)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("output_band", [0.02, 0.1, 0.2, 0.3, 0.36])
def test_passes_what_the_output_can_hold(
    library: ctypes.CDLL, factor: int, output_band: float
) -> None:
    frequency = output_band / factor
    rows = run(library, factor, tone(frequency, 8000))
    expected = 20000.0 * np.sin(2 * np.pi * frequency * factor * rows[:, 0])
    assert len(rows) > 8000 / factor - 40
    assert np.max(np.abs(rows[:, 5] - expected)) < 20000.0 * 2e-3 + 1


@pytest.mark.parametrize("factor", FACTORS)
def test_stops_what_would_fold_into_the_lower_band(library: ctypes.CDLL, factor: int) -> None:
    for frequency in np.arange(0.64 / factor, 0.5, 0.017):
        folded = abs(frequency * factor - round(frequency * factor))
        if folded > 0.36:
            continue  # Folds to where nobody looks
        rows = run(library, factor, tone(frequency, 4000))
        assert np.max(np.abs(rows[:, 5])) < 20000.0 * 10 ** (-56 / 20), frequency


@pytest.mark.parametrize("factor", FACTORS)
def test_a_hole_restarts_the_filter_and_shows(library: ctypes.CDLL, factor: int) -> None:
    samples = np.tile(np.arange(3200, dtype=np.int16)[:, None], (1, 6))
    rows = run(library, factor, samples, holes=frozenset({100, 101}))
    index = rows[:, 0].astype(np.int64)
    np.testing.assert_array_equal(rows[:, 5], index * factor)
    jumps = np.flatnonzero(np.diff(index) != 1)
    assert jumps.size == 1
    # No output is made of samples from both sides of the hole.
    assert index[jumps[0]] * factor < 1600
    assert index[jumps[0] + 1] * factor > 1632
    at = rows[:, 1] + rows[:, 4] * rows[:, 2] / 256
    assert np.max(np.abs(at - t_ticks(index * factor))) <= 1.0


def test_flags_are_passed_on(library: ctypes.CDLL) -> None:
    samples = np.zeros((3200, 6), np.int16)
    flags = {50: HARDWARE_TIME | CLIPPED, 120: HARDWARE_TIME | OVERRUN_BEFORE}
    rows = run(library, 8, samples, flags=flags)
    seen = rows[:, 3].astype(int)
    starts = rows[:, 4] == 0
    assert np.sum(seen[starts] & CLIPPED != 0) == 1
    assert np.sum(seen[starts] & OVERRUN_BEFORE != 0) == 1
    assert np.all(seen & HARDWARE_TIME)


def test_batches_have_the_size_asked_for(library: ctypes.CDLL) -> None:
    rows = run(library, 4, np.zeros((3200, 6), np.int16), batch=5)
    assert rows[:, 4].max() == 4
    assert np.all(rows[:-1, 4][np.diff(rows[:, 4]) < 0] == 4)
