# SPDX-License-Identifier: Apache-2.0
"""Laws of the clock model: what must hold for every crystal, before any number."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.errors import RecordingError
from hil.recording import ClockModel, WanderTerm

HOURS_3_US = 1e10
"""1e4 s."""


def random_models(count: int, ppm: float) -> list[ClockModel]:
    rng = np.random.default_rng(7)
    return [
        ClockModel(
            drift=rng.uniform(-ppm, ppm) * 1e-6,
            start_offset_us=float(rng.integers(0, 1_000_000)),
            wander=tuple(
                WanderTerm(
                    amplitude=rng.uniform(0, ppm) * 1e-6,
                    period_s=float(10 ** rng.uniform(-1, 4)),
                    phase_rad=rng.uniform(-10, 10),
                )
                for _ in range(rng.integers(0, 4))
            ),
        )
        for _ in range(count)
    ]


@pytest.mark.parametrize("model", random_models(20, ppm=100))
def test_round_trip(model: ClockModel) -> None:
    true_us = np.sort(np.random.default_rng(1).uniform(0, HOURS_3_US, 5000))
    error_us = np.abs(model.true_us(model.local_us(true_us)) - true_us)
    # Above 2^33 us neighbouring float64 are 1.9e-6 us apart, and local time is one of them.
    assert np.all(error_us <= np.maximum(1e-6, np.spacing(true_us)))
    assert error_us[true_us < 2**32].max() < 1e-6


@pytest.mark.parametrize("model", random_models(20, ppm=100))
def test_local_time_is_monotone(model: ClockModel) -> None:
    true_us = np.arange(0, 3e5, 1.0) + 1e9
    assert np.all(np.diff(model.local_us(true_us)) > 0.999)


@pytest.mark.parametrize("model", random_models(10, ppm=100))
def test_local_time_is_the_integral_of_the_frequency(model: ClockModel) -> None:
    """Simpson's rule over y(t), written out independently, gives the same local time."""
    end_s = 50.0
    t_s = np.linspace(0.0, end_s, 200_001)
    y = np.full_like(t_s, model.drift)
    for term in model.wander:
        y += term.amplitude * np.sin(2 * math.pi * t_s / term.period_s + term.phase_rad)
    weights = np.ones_like(t_s)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    integral_us = 1e6 * (weights @ y) * (t_s[1] - t_s[0]) / 3.0
    expected_us = end_s * 1e6 + integral_us - model.start_offset_us
    assert model.local_us(end_s * 1e6) == pytest.approx(expected_us, abs=1e-6)


def test_drift_only_equals_the_closed_form() -> None:
    model = ClockModel(drift=-31.1e-6, start_offset_us=12345.0)
    true_us = np.linspace(0.0, HOURS_3_US, 1001)
    closed_us = true_us * (1 - 31.1e-6) - 12345.0
    np.testing.assert_allclose(model.local_us(true_us), closed_us, rtol=4e-16, atol=2e-6)
    local_us = np.linspace(0.0, HOURS_3_US, 1001)
    closed_us = (local_us + 12345.0) / (1 - 31.1e-6)
    np.testing.assert_allclose(model.true_us(local_us), closed_us, rtol=4e-16, atol=2e-6)


def test_one_wander_term_by_hand() -> None:
    """0.2 ppm over 40 s from phase 0: half a period gains 2 A T / (2 pi), a whole one nothing."""
    model = ClockModel(wander=(WanderTerm(0.2e-6, 40.0, 0.0),))
    gain_us = 2 * 0.2e-6 * 40.0 / (2 * math.pi) * 1e6
    assert model.local_us(20e6) - 20e6 == pytest.approx(gain_us, abs=1e-8)
    assert model.local_us(40e6) - 40e6 == pytest.approx(0.0, abs=1e-8)
    assert model.local_us(0.0) == 0.0


def test_the_largest_crystal_error_allowed_still_inverts() -> None:
    model = ClockModel(drift=-0.1, wander=(WanderTerm(0.1, 1.0, 0.3),))
    true_us = np.linspace(0.0, 1e7, 10_001)
    assert np.abs(model.true_us(model.local_us(true_us)) - true_us).max() < 1e-6


def test_shapes() -> None:
    model = random_models(3, 50)[1]
    assert model.local_us(1e6).shape == ()
    assert model.true_us(np.zeros((3, 4))).shape == (3, 4)
    assert model.local_us(np.zeros(0)).shape == (0,)
    assert np.isnan(model.true_us(math.nan))


def test_from_a_scenario() -> None:
    model = ClockModel.from_mapping(
        {
            "drift_ppm": 13.7,
            "start_offset_us": 12345,
            "wander": [{"amplitude_ppm": 0.2, "period_s": 37.0, "phase_rad": 1.0}],
            "imu": {"rate_hz": 104},
        }
    )
    assert model.drift == pytest.approx(13.7e-6)
    assert model.start_offset_us == 12345
    assert model.wander == (WanderTerm(pytest.approx(0.2e-6), 37.0, 1.0),)
    assert ClockModel.from_mapping({}) == ClockModel()


@pytest.mark.parametrize(
    "node",
    [
        {"drift_ppm": "13"},
        {"drift_ppm": True},
        {"drift_ppm": math.nan},
        {"drift_ppm": math.inf},
        {"drift_ppm": 10**400},
        {"drift_ppm": 200_000},
        {"start_offset_us": None},
        {"wander": 3},
        {"wander": [3]},
        {"wander": [{"amplitude_ppm": 1}]},
        {"wander": [{"amplitude_ppm": 1, "period_s": 0}]},
        {"wander": [{"amplitude_ppm": 1, "period_s": -1}]},
        {"wander": [{"amplitude_ppm": math.nan, "period_s": 1}]},
        {"wander": [{"amplitude_ppm": 60_000, "period_s": 1}] * 2},
        [],
        None,
    ],
)
def test_a_clock_that_is_none_is_refused(node: object) -> None:
    with pytest.raises(RecordingError, match="clock model") as caught:
        ClockModel.from_mapping(node)  # type: ignore[arg-type]
    assert "scenario" in caught.value.mend
