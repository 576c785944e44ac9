# SPDX-License-Identifier: Apache-2.0
"""The estimator's sources with a bare compiler: what they need, and the laws of their parts.

Warnings are errors, exceptions and RTTI are off, and Eigen's own asserts are on.
"""

from __future__ import annotations

import ctypes
import math
import os
import shutil
import subprocess
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pytest

from hil.reference import attitude
from tests.unit.native import cached

ROOT = Path(__file__).resolve().parents[2]
ESTIMATOR = ROOT / "firmware" / "lib" / "estimator"
SHIM = ROOT / "tests" / "unit" / "c" / "estimator_shim.cpp"
FLAGS = (
    *("-std=c++17", "-O0", "-fPIC", "-ffp-contract=off", "-fno-exceptions", "-fno-rtti"),
    *("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"),
)
ALLOCATORS = {
    *("malloc", "calloc", "realloc", "free", "aligned_alloc", "posix_memalign"),
    *("_Znwm", "_Znam", "_ZdlPv", "_ZdlPvm", "_ZdaPv", "_ZnwmSt11align_val_t"),
    *("_ZdlPvmSt11align_val_t", "_ZdlPvSt11align_val_t"),
}
RATE_HZ = 416.0


def compiler() -> str:
    found = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++")
    assert found, "no C++ compiler: install g++, or set CXX"
    return found


def compiled(source: Path) -> Path:
    eigen = distribution("cmeel-eigen").locate_file("cmeel.prefix/include/eigen3")
    target = source.with_suffix(".o")
    include = ("-isystem", str(eigen), "-I", str(ESTIMATOR), "-I", str(SHIM.parent))
    # By its name alone: the folder is another one each time, and would be part of the text.
    subprocess.run(
        [*cached(compiler()), *FLAGS, *include, "-c", source.name, "-o", target.name],
        cwd=source.parent,
        check=True,
    )
    return target


def wanted_symbols(compiled_object: Path) -> set[str]:
    listing = subprocess.run(
        ["nm", "--undefined-only", compiled_object], check=True, capture_output=True, text=True
    )
    return {line.split()[-1] for line in listing.stdout.splitlines()}


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All sources in one translation unit, so that Eigen is read once."""
    source = tmp_path_factory.mktemp("estimator") / "core.cpp"
    names = [*(path.name for path in sorted(ESTIMATOR.glob("*.cpp"))), SHIM.name]
    source.write_text("".join(f'#include "{name}"\n' for name in names))
    return compiled(source)


@pytest.fixture(scope="module")
def lib(core: Path) -> ctypes.CDLL:
    path = core.with_suffix(".so")
    subprocess.run([compiler(), "-shared", "-o", path, core], check=True)
    library = ctypes.CDLL(str(path))
    library.shim_arctangent.restype = ctypes.c_double
    library.shim_arctangent.argtypes = (ctypes.c_double, ctypes.c_double)
    return library


def test_no_allocator_and_no_exception_is_referred_to(core, tmp_path):
    wanted = wanted_symbols(core)
    assert not wanted & ALLOCATORS
    assert not {s for s in wanted if s.startswith("__cxa_throw")}
    sinner = tmp_path / "sinner.cpp"
    sinner.write_text("int *f() { return new int; }\n")
    assert wanted_symbols(compiled(sinner)) & ALLOCATORS


def test_no_libm_function_decides_the_numbers(core):
    """Only what IEEE 754 defines to the last bit, so host and target can agree to the last bit."""
    wanted = wanted_symbols(core)
    inexact = {"sin", "cos", "tan", "atan2", "atan", "asin", "acos", "exp", "log", "pow", "hypot"}
    assert not wanted & (inexact | {f + "f" for f in inexact})


def test_steps_pass_eigens_asserts(lib):
    assert lib.shim_rest(1000) == 1000 - 209


def filtered(lib, x, *, iir, cutoff_hz=15.0, rate_hz=RATE_HZ, length=4, dtype=np.float64):
    scalar = ctypes.c_double if dtype is np.float64 else ctypes.c_float
    call = lib.shim_filter if dtype is np.float64 else lib.shim_filter_float
    call.restype, pointer = None, ctypes.POINTER(scalar)
    call.argtypes = (ctypes.c_bool, scalar, scalar, ctypes.c_int, pointer, pointer, ctypes.c_int)
    x = np.ascontiguousarray(x, dtype)
    y = np.empty_like(x)
    call(
        iir,
        cutoff_hz,
        rate_hz,
        length,
        x.ctypes.data_as(pointer),
        y.ctypes.data_as(pointer),
        len(x),
    )
    return y


def impulse_response(lib, n=4096, **options):
    """After a zero, in whose steady state the filter starts."""
    x = np.zeros(n + 1)
    x[1] = 1.0
    return filtered(lib, x, **options)[1:]


def response(h, frequency_hz, rate_hz=RATE_HZ):
    """Gain and group delay, samples, of an impulse response at one frequency."""
    n = np.arange(len(h))
    turn = np.exp(-2j * np.pi * frequency_hz / rate_hz * n)
    gain = np.sum(h * turn)
    return abs(gain), float(np.real(np.sum(n * h * turn) / gain))


@pytest.mark.parametrize("rate_hz", [104.0, 416.0, 387.52, 1667.0])
def test_butterworth_poles_are_those_of_the_analogue_prototype(lib, rate_hz):
    """s = w_c exp(+-j 3 pi / 4) with w_c pre-warped, mapped by z = (1 + s/2f) / (1 - s/2f)."""
    w_c = 2.0 * rate_hz * math.tan(math.pi * 15.0 / rate_hz)
    s = w_c * np.exp(0.75j * np.pi) / (2.0 * rate_hz)
    z = (1.0 + s) / (1.0 - s)
    a = [1.0, -2.0 * z.real, abs(z) ** 2]
    b = np.array([1.0, 2.0, 1.0]) * sum(a) / 4.0
    h = impulse_response(lib, 64, iir=True, rate_hz=rate_hz)
    expected = np.zeros(64)
    for n in range(64):
        expected[n] = b[n] if n < 3 else 0.0
        expected[n] -= sum(a[i] * expected[n - i] for i in (1, 2) if n >= i)
    np.testing.assert_allclose(h, expected, atol=1e-14)


def test_butterworth_gain_and_delay(lib):
    h = impulse_response(lib, iir=True)
    gain, delay = response(h, 0.0)
    assert gain == pytest.approx(1.0, abs=1e-12)
    assert delay == pytest.approx(1.0 / (math.sqrt(2.0) * math.tan(math.pi * 15.0 / RATE_HZ)))
    gain, _ = response(h, 15.0)
    assert 20.0 * math.log10(gain) == pytest.approx(-3.0103, abs=1e-4)
    gain, _ = response(h, 150.0)
    # 40 dB a decade, and the double zero at Nyquist on top.
    assert 20.0 * math.log10(gain) < -40.0


@pytest.mark.parametrize("length", [1, 4, 7, 16])
def test_moving_average_gain_and_delay(lib, length):
    h = impulse_response(lib, 64, iir=False, length=length)
    np.testing.assert_allclose(h[:length], 1.0 / length, rtol=1e-15)
    np.testing.assert_array_equal(h[length:], 0.0)
    for frequency_hz in (0.0, 7.0, 15.0):
        assert response(h, frequency_hz)[1] == pytest.approx(0.5 * (length - 1))


def test_moving_average_in_float_forgets_a_large_sample_at_once(lib):
    """A running sum would keep the rounding of 1e6 for ever."""
    x = np.full(64, 0.1)
    x[10] = 1e6
    y = filtered(lib, x, iir=False, dtype=np.float32)
    np.testing.assert_array_equal(y[14:], y[8])


@pytest.mark.parametrize("iir", [False, True])
def test_prefilters_start_in_their_steady_state(lib, iir):
    np.testing.assert_allclose(filtered(lib, np.full(50, 9.8), iir=iir), 9.8, rtol=1e-13)


def doubles(values):
    return (ctypes.c_double * len(values))(*values)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 0.08, 0.4999, 0.5001, 2.0, 3.1, 40.0])
def test_exp_is_right_at_any_angle(lib, angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = (ctypes.c_double * 4)()
    lib.shim_exp(doubles(angle * axis), q)
    expected = [math.cos(angle / 2), *(math.sin(angle / 2) * axis)]
    np.testing.assert_allclose(list(q), expected, atol=1e-14)


def test_from_gravity_is_the_references(lib):
    rng = np.random.default_rng(1)
    forces = [*(9.8 * rng.standard_normal((50, 3))), [0, 0, -9.8], [9.8, 0, 0], [-9.8, 1e-9, -1e-9]]
    for force in forces:
        q = (ctypes.c_double * 4)()
        lib.shim_from_gravity(doubles(force), q)
        np.testing.assert_allclose(
            list(q), attitude.from_gravity(np.array(force, float)), atol=1e-14
        )


def test_arctangent_is_right_over_its_quadrant(lib):
    for angle in (0.0, 1e-9, 0.1, 0.7, 1.2, math.pi / 2 - 1e-9, math.pi / 2):
        found = lib.shim_arctangent(math.sin(angle), max(math.cos(angle), 0.0))
        assert found == pytest.approx(angle, abs=1e-15, rel=1e-14)
