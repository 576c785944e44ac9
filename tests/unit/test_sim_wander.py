# SPDX-License-Identifier: Apache-2.0
"""The crystal in the simulator is the crystal that the checks compute with.

The runner-side C code is compiled here against stand-ins for the simulator's headers and for the
stock drift model that it wraps.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hil.recording import ClockModel, WanderTerm

SOURCES = Path(__file__).parents[2] / "firmware" / "sim"
COMPILER = shutil.which("gcc") or shutil.which("cc")

HEADERS = {
    "bs_cmd_line.h": """
typedef struct {
    const char *option, *name; char type; void *dest;
    void (*call_when_found)(char *, int); const char *descript;
} bs_args_struct_t;
#define ARG_TABLE_ENDMARKER { .option = 0 }
""",
    "bs_dynargs.h": "static inline void bs_add_extra_dynargs(bs_args_struct_t *a) { (void)a; }",
    "bs_tracing.h": """
extern const char *problem_seen;
#define bs_trace_error_line(format, argument, problem) ((void)(argument), problem_seen = (problem))
""",
    "bs_types.h": "#include <stdbool.h>",
    "nsi_tasks.h": "#define NSI_TASK(f, level, priority) void (*task_##f)(void) = f",
}

HARNESS = """
#include "xo_wander.c"
const char *problem_seen;
static double drift, offset_s;
long double __real_dev_time_from_phy(long double t) { return (1.0 + drift) * t - offset_s; }
long double __real_phy_time_from_dev(long double t) { return (t + offset_s) / (1.0 + drift); }
const char *set_up(double new_drift, double new_offset_us, char *text)
{
    drift = new_drift;
    offset_s = new_offset_us / 1e6;
    problem_seen = 0;
    wander.count = 0;
    wander_text = text;
    if (text[0]) wander_found(text, 0);
    return problem_seen;
}
double local_us(double true_us) { return 1e6L * __wrap_dev_time_from_phy(true_us * 1e-6L); }
double true_us(double local_us) { return 1e6L * __wrap_phy_time_from_dev(local_us * 1e-6L); }
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    if COMPILER is None:
        pytest.skip("no C compiler: apt-get install gcc")
    folder = tmp_path_factory.mktemp("wander")
    for name, text in HEADERS.items():
        (folder / name).write_text(text)
    (folder / "harness.c").write_text(HARNESS)
    built = folder / "wander.so"
    subprocess.run(
        [
            *(COMPILER, "-shared", "-fPIC", "-O2", "-std=gnu11", "-Wall", "-Wextra", "-Werror"),
            *("-o", built, f"-I{folder}", f"-I{SOURCES}"),
            *(folder / "harness.c", SOURCES / "wander.c", "-lm"),
        ],
        check=True,
        timeout=60,
    )
    loaded = ctypes.CDLL(str(built))
    loaded.set_up.argtypes = [ctypes.c_double, ctypes.c_double, ctypes.c_char_p]
    loaded.set_up.restype = ctypes.c_char_p
    for name in ("local_us", "true_us"):
        getattr(loaded, name).argtypes = [ctypes.c_double]
        getattr(loaded, name).restype = ctypes.c_double
    return loaded


CLOCKS = [
    ClockModel(),
    ClockModel(13.7e-6, 12345, (WanderTerm(2e-7, 37.0, 0.5),)),
    ClockModel(-31.1e-6, 87654, (WanderTerm(4e-7, 29.0, 1.0), WanderTerm(-6e-8, 7.0))),
    ClockModel(3e-4, 0, (WanderTerm(5e-4, 0.5, 3.0), WanderTerm(4e-4, 0.03, -1.0))),
]


def set_up(library: ctypes.CDLL, clock: ClockModel) -> None:
    text = ",".join(f"{t.amplitude!r}:{t.period_s!r}:{t.phase_rad!r}" for t in clock.wander)
    assert library.set_up(clock.drift, clock.start_offset_us, text.encode()) is None


@pytest.mark.parametrize("clock", CLOCKS)
def test_same_formula_as_the_clock_model(library: ctypes.CDLL, clock: ClockModel) -> None:
    set_up(library, clock)
    true_us = np.linspace(0, 3.6e9, 1001)
    ours = np.array([library.local_us(t) for t in true_us])
    # A float64 resolves an hour in us to 0.5 ns.
    np.testing.assert_allclose(ours, clock.local_us(true_us), rtol=0, atol=2e-3)


@pytest.mark.parametrize("clock", CLOCKS)
def test_there_and_back_lands_on_the_same_microsecond(
    library: ctypes.CDLL, clock: ClockModel
) -> None:
    set_up(library, clock)
    local_us = np.arange(0, 3.6e9, 3.6e6 + 1)
    true_us = np.array([library.true_us(t) for t in local_us])
    back_us = np.array([library.local_us(t) for t in true_us])
    np.testing.assert_allclose(back_us, local_us, rtol=0, atol=2e-3)
    np.testing.assert_allclose(true_us, clock.true_us(local_us), rtol=0, atol=2e-3)


@pytest.mark.parametrize("clock", CLOCKS)
def test_time_never_goes_back(library: ctypes.CDLL, clock: ClockModel) -> None:
    set_up(library, clock)
    local_us = [library.local_us(t) for t in np.arange(0, 2e6, 100.0)]
    assert np.all(np.diff(local_us) > 0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1e-7", "amplitude:period_s:phase_rad"),
        ("1e-7:5", "amplitude:period_s:phase_rad"),
        ("x:5:0", "amplitude:period_s:phase_rad"),
        ("1e-7:5:nan", "amplitude:period_s:phase_rad"),
        ("1e-7:0:0", "period must be positive"),
        ("1e-7:-3:0", "period must be positive"),
        ("1e-7:5:0;1e-7:5:0", "separated by commas"),
        ("1e-7:5:0,", "amplitude:period_s:phase_rad"),
        ("6e-4:5:0,-6e-4:5:0", "add up to more than"),
        (",".join(["1e-7:5:0"] * 17), "too many terms"),
    ],
)
def test_wrong_options_are_refused(library: ctypes.CDLL, text: str, says: str) -> None:
    assert says in library.set_up(0.0, 0.0, text.encode()).decode()
