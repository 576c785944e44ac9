# SPDX-License-Identifier: Apache-2.0
"""The simulation held to real time: firmware/sim/pace.c, with a clock of the test's own."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest

from tests.unit.native import USUAL, shared_library

ROOT = Path(__file__).parents[2]
LOOKS, PERIOD_S = 4000, 0.005
SIMULATED_S = LOOKS * PERIOD_S


@pytest.fixture(scope="module")
def pace(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("pace")
    for name in ("bs_cmd_line", "bs_dynargs", "bs_types"):
        (folder / f"{name}.h").touch()
    for name in ("nsi_hw_scheduler", "nsi_hws_models_if", "nsi_tasks"):
        (folder / f"{name}.h").touch()
    shim = ROOT / "tests" / "unit" / "c" / "pace_shim.c"
    loaded = shared_library(folder / "pace.so", [shim], [folder, ROOT / "firmware/sim"], USUAL)
    loaded.shim_run.restype = ctypes.c_double
    return loaded


def took_s(
    pace: ctypes.CDLL,
    work_s: float,
    *,
    burst_s: float = 0.0,
    sleeps_late_s: float = 0.0,
    stands_s: float = 0.0,
) -> float:
    values = (ctypes.c_double(v) for v in (work_s, burst_s, sleeps_late_s, stands_s))
    return float(pace.shim_run(LOOKS, *values))


def test_sleeps_that_end_late_do_not_slow_it_down(pace: ctypes.CDLL) -> None:
    assert took_s(pace, 0.001) == pytest.approx(SIMULATED_S, abs=0.01)
    assert took_s(pace, 0.001, sleeps_late_s=0.003) == pytest.approx(SIMULATED_S, abs=0.01)


def test_work_that_comes_in_bursts_is_made_up_for(pace: ctypes.CDLL) -> None:
    assert took_s(pace, 0.001, burst_s=0.007) == pytest.approx(SIMULATED_S, abs=0.01)


def test_a_simulation_that_is_too_slow_takes_its_time(pace: ctypes.CDLL) -> None:
    assert took_s(pace, 0.006) == pytest.approx(1.2 * SIMULATED_S, abs=0.01)


def test_a_stop_is_not_made_up_for(pace: ctypes.CDLL) -> None:
    """A debugger, a reader that waits: all but a tenth of a second of it is lost for good."""
    assert took_s(pace, 0.001, stands_s=3.0) == pytest.approx(SIMULATED_S + 2.9, abs=0.01)
