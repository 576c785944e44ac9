# SPDX-License-Identifier: Apache-2.0
"""Change-points: found where they are, and not where there is only noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from hil.history import changes
from hil.history.changes import ALPHA, MAX_RUNS, MIN_RUNS, find

NOISES: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
    "normal": lambda r, n: r.normal(size=n),
    "heavy tails": lambda r, n: r.standard_cauchy(n),
    "small counts": lambda r, n: r.poisson(0.3, n).astype(float),
}


def found(values: np.ndarray, uncertainty: float = 0.0) -> list[changes.Change]:
    return find(np.asarray(values, float), np.full(len(values), uncertainty))


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("n", [12, 40, 100])
def test_false_alarms_are_as_rare_as_documented(noise: str, n: int) -> None:
    """At 1 of 100, more than 4 in 100 seeds happen once in 300: binomial, 1 - cdf(4) = 0.0034."""
    assert ALPHA == 0.01
    alarms = [bool(found(NOISES[noise](np.random.default_rng(seed), n))) for seed in range(100)]
    assert sum(alarms) <= 4


@pytest.mark.parametrize("seed", range(30))
def test_a_step_is_found_within_one_run(seed: int) -> None:
    random = np.random.default_rng(1000 + seed)
    at = int(random.integers(8, 32))
    values = random.normal(size=40) + 5.0 * (np.arange(40) >= at)
    steps = [c for c in found(values) if abs(c.after - c.before) > 2.5]
    assert [c.kind for c in steps] == ["step"]
    assert abs(steps[0].start - at) <= 1
    assert steps[0].after - steps[0].before == pytest.approx(5.0, abs=1.5)


@pytest.mark.parametrize("seed", range(10))
def test_a_level_that_comes_back_gives_two_steps(seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=60)
    values[20:40] += 8.0
    big = [c for c in found(values) if abs(c.after - c.before) > 4]
    assert [(c.start, c.kind) for c in big] == [(20, "step"), (40, "step")]


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("rise", [6.0, 20.0])
def test_a_drift_is_one_drift_and_no_flight_of_steps(seed: int, rise: float) -> None:
    values = np.random.default_rng(seed).normal(size=60) + np.linspace(0, rise, 60)
    (change,) = found(values)
    assert (change.kind, change.start, change.stop) == ("drift", 0, 60)
    assert change.after - change.before == pytest.approx(rise, abs=2.0)


def test_a_noiseless_step_and_a_noiseless_ramp() -> None:
    (step,) = found(np.repeat([3.0, 4.0], 12))
    assert step == changes.Change("step", 12, 24, 3.0, 4.0)
    (drift,) = found(np.arange(24.0))
    assert (drift.kind, drift.before, drift.after) == (
        "drift",
        pytest.approx(0.0),
        pytest.approx(23.0),
    )


def test_a_step_within_the_uncertainty_is_none() -> None:
    """Levels 0 and 1, each known to 0.8: the difference is known to 1.13, more than it is."""
    values = np.repeat([0.0, 1.0], 15) + np.tile([0.01, -0.01], 15)
    assert [c.start for c in found(values)] == [15]
    assert [c.start for c in found(values, 0.6)] == [15]
    assert found(values, 0.8) == []
    ramp = np.linspace(0, 1, 30)
    assert [c.kind for c in found(ramp, 0.6)] == ["drift"]
    assert found(ramp, 0.8) == []


def test_one_outlier_is_no_change() -> None:
    values = np.random.default_rng(3).normal(size=40)
    assert found(values) == []
    values[20] = 1e6
    assert found(values) == []


def test_equal_values_and_short_histories_say_nothing() -> None:
    assert found(np.ones(200)) == []
    few = np.repeat([0.0, 100.0], [MIN_RUNS - 6, 5])
    assert found(few) == []
    assert found(np.array([])) == []


def test_the_same_history_gives_the_same_answer() -> None:
    values = np.random.default_rng(5).normal(size=80) + 1.2 * (np.arange(80) > 40)
    assert found(values) == found(values)


def test_a_long_history_is_looked_at_from_its_end() -> None:
    values = np.random.default_rng(0).normal(size=MAX_RUNS + 400)
    values[100:] += 8
    values[700:] += 8
    assert [c.start for c in found(values) if abs(c.after - c.before) > 4] == [700]


@pytest.mark.parametrize(
    ("values", "uncertainty"),
    [([1.0, np.nan], [0.0, 0.0]), ([1.0, 2.0], [0.0, np.inf]), ([1.0], [0.0, 0.0])],
)
def test_what_is_no_history_is_refused(values: list[float], uncertainty: list[float]) -> None:
    with pytest.raises(ValueError, match=r"finite|shapes"):
        find(np.array(values), np.array(uncertainty))


def test_the_rate_depends_on_the_permutation_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """The alarm counts above can fail: without the test of order, noise is full of steps."""
    monkeypatch.setattr(changes, "_changes", lambda part, random: True)
    alarms = [bool(found(np.random.default_rng(seed).normal(size=40))) for seed in range(10)]
    assert sum(alarms) > 4
