# SPDX-License-Identifier: Apache-2.0
"""Every check can fail, and does so for its own fault and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil import checks
from hil.measure import Measurement, Verdict
from hil.recording import Recording
from hil.synthesis import FAULTS, Plan, save, synthesise
from hil.synthesis.caught_by import CAUGHT_BY

PLAN = Plan(duration_s=14.0)


@pytest.fixture(scope="module")
def clean() -> Recording:
    return synthesise(PLAN)


def bad(measurements: list[Measurement]) -> dict[str, Verdict]:
    return {m.name: m.verdict for m in measurements if m.verdict is not Verdict.PASS}


def test_every_fault_is_in_the_table() -> None:
    assert set(CAUGHT_BY) == set(FAULTS)


def test_every_check_is_caught_failing_by_some_fault(clean: Recording) -> None:
    names = {m.name for m in checks.evaluate(clean)}
    assert names == set().union(*CAUGHT_BY.values())


@pytest.mark.parametrize("fault", CAUGHT_BY)
def test_fault_is_caught_by_its_checks_and_no_other(fault: str) -> None:
    found = bad(checks.evaluate(synthesise(PLAN, [fault])))
    assert set(found) == CAUGHT_BY[fault], FAULTS[fault].meaning
    worst = Verdict.INCONCLUSIVE if fault == "coarse_analyser" else Verdict.FAIL
    assert set(found.values()) == {worst}


@pytest.mark.parametrize(
    "plan",
    [
        PLAN,
        Plan(duration_s=30.0, conn_interval_us=30_000, seed=5),
        Plan(duration_s=20.0, loss=0.04, seed=6),
        Plan(duration_s=20.0, conn_interval_us=30_000, loss=0.04, seed=7),
        Plan(duration_s=14.0, phy=1, delay_us=9.0),
    ],
    ids=["7.5 ms", "30 ms", "lossy", "lossy 30 ms", "1M"],
)
def test_sound_run_passes_everything(plan: Plan) -> None:
    assert bad(checks.evaluate(synthesise(plan))) == {}


def test_verdicts_are_the_same_live_and_replayed(clean: Recording, tmp_path: Path) -> None:
    """Written to a file and read back, a run is judged by the same numbers."""
    for number, recording in enumerate((clean, synthesise(PLAN, ["swapped_pair"]))):
        replayed = save(recording, tmp_path / f"{number}.mcap")
        before = {m.name: m for m in checks.evaluate(recording)}
        after = {m.name: m for m in checks.evaluate(replayed)}
        assert list(before) == list(after)
        for name, m in before.items():
            # A file keeps the chip's own times to 1 ns, everything else to the bit.
            exact = "truth_time" not in name and "truth_period" not in name
            assert after[name].value == (m.value if exact else pytest.approx(m.value, abs=2e-3))
            assert after[name].verdict is m.verdict


def test_suites_partition_the_list(clean: Recording) -> None:
    suites = checks.evaluate_suites(clean)
    assert tuple(suites) == checks.SUITES
    for name, measurements in suites.items():
        assert measurements == checks.suite(clean, name)
        # No firmware ran, so there is no estimator to judge; nor is the run long.
        assert {checks.suite_of(m) for m in measurements} == ({name} - {"ekf", "soak"})
    everything = [m.name for m in checks.evaluate(clean)]
    assert len(everything) == len(set(everything))
    with pytest.raises(ValueError, match="no suite 'motion'"):
        checks.suite(clean, "motion")


def test_every_measurement_says_how_and_cites_a_line(clean: Recording) -> None:
    for m in checks.evaluate(clean):
        assert len(m.how) > 20, m.name
        assert m.budget, m.name
        assert m.to_json()["verdict"] == "pass"


def test_unknown_fault_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown fault 'gremlins'"):
        synthesise(PLAN, ["gremlins"])
