# SPDX-License-Identifier: Apache-2.0
"""The C++ core against the NumPy reference, on every kind of lift and every choice of algorithm.

Both take discrete decisions (gates, stillness, turning points) by comparing real numbers. In
double the two differ by some 1e-13, and no decision of these sets lies that close to its edge:
flags must agree on every step. Where a comparison would be decided by rounding by design, at a
sample rate that divides a period, both leave half a sample of room. In float a decision may fall
one step earlier or later; what that costs is inside the bound on velocity.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest

from hil.core import Estimator, Samples
from hil.motion import lifts
from hil.motion.imu_model import ImuConfig
from hil.parity import (
    Batch,
    attitude_error_rad,
    batch,
    first_steps,
    relative_errors,
    run_core,
    run_reference,
)
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.reference.study import Link, simulate

DOUBLE_LIMIT = 1e-9
BASELINE_LIMIT = 1e-7
"""Madgwick's filter steps by a fixed angle, 8e-5 rad, down a gradient made a unit vector: once it
has converged on a quiet signal, the last bits decide the direction of that step."""
FLOAT_VELOCITY_LIMIT_MPS = 1e-3
FLOAT_ATTITUDE_LIMIT_RAD = np.radians(0.05)

SCENARIOS: dict[str, tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    # name: (lift, its options, parameters, chip and link)
    "bench": ("bench", {"reps": 2}, {}, {}),
    "bench with rests": ("bench", {"reps": 1, "rests": True}, {}, {}),
    "squat": ("squat", {"reps": 1}, {"prefilter_iir": True}, {}),
    "squat, one IMU": ("squat", {"reps": 1}, {}, {"two": False}),
    "deadlift": ("deadlift", {"reps": 2}, {}, {"odr_error": -0.068}),
    "deadlift in doubt": (
        *("deadlift", {"reps": 3}),
        *({"height_jump_m": 0.02, "turn_confirm_s": 0.01}, {}),
    ),
    "deadlift with rests": ("deadlift", {"reps": 1, "rests": True}, {"zupt_shoe": True}, {}),
    "snatch": ("snatch", {"reps": 1}, {}, {}),
    "clean and jerk": ("clean_and_jerk", {"reps": 1}, {}, {}),
    "drop": ("drop", {"reps": 1}, {}, {}),
    "slow eccentric": ("slow_eccentric", {"reps": 1}, {}, {}),
    "tilted, late link": ("tilted", {"reps": 1}, {}, {"link": Link(0.06, 8, t_sigma_s=1e-4)}),
    "spinning, lossy link": ("spinning", {"reps": 1}, {}, {"link": Link(lost_s=((2.0, 3.5),))}),
    "begun in motion": ("deadlift", {"reps": 1, "rests": True}, {}, {"begin": 1100}),
}


@cache
def scenario(name: str) -> tuple[Batch, Params]:
    lift, options, parameters, how = SCENARIOS[name]
    config = ImuConfig(odr_error=how.get("odr_error", 0.0))
    leader, follower = simulate(lifts.LIFTS[lift](3, **options), 3, config=config)
    samples = batch(leader, follower if how.get("two", True) else None, how.get("link"))
    samples = without_beginning(samples, how.get("begin", 0))
    return samples, Params(rate_hz=config.rate_hz, **parameters)


def without_beginning(samples: Batch, begin: int) -> Batch:
    def cut(s: Samples, n: int) -> Samples:
        return Samples(*(column[n:] for column in s.columns()))

    kept = int(np.searchsorted(samples.arrival, begin))
    return Batch(
        cut(samples.leader, begin), cut(samples.follower, kept), samples.arrival[kept:] - begin
    )


@cache
def reference_outputs(name: str) -> np.ndarray:
    return run_reference(*scenario(name))


def worst(ours: np.ndarray, theirs: np.ndarray) -> float:
    errors = relative_errors(ours, theirs)
    return max(error for name, error in errors.items() if name != "q_madgwick")


def test_every_kind_of_lift_is_compared():
    """``touch_and_go_ten`` is a bench set of ten."""
    assert {s[0] for s in SCENARIOS.values()} == set(lifts.LIFTS) - {"touch_and_go_ten"}


@pytest.mark.parametrize("name", SCENARIOS)
def test_double_agrees_with_the_reference(name):
    ours, theirs = run_core(*scenario(name)), reference_outputs(name)
    errors = relative_errors(ours, theirs)
    assert errors.pop("q_madgwick") <= BASELINE_LIMIT
    assert max(errors.values()) <= DOUBLE_LIMIT, errors
    np.testing.assert_array_equal(ours["flags"], theirs["flags"])
    np.testing.assert_allclose(ours["nis"], theirs["nis"], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(ours["innovation"], theirs["innovation"], atol=1e-9)
    np.testing.assert_array_equal(ours["gate"], theirs["gate"])
    np.testing.assert_allclose(
        ours["divergence_rad"], theirs["divergence_rad"], atol=BASELINE_LIMIT
    )
    assert np.abs(ours["t_ticks"] - theirs["t_ticks"]).max() <= 1


@pytest.mark.parametrize("name", SCENARIOS)
def test_float_agrees_with_the_reference(name):
    ours, theirs = run_core(*scenario(name), np.float32), reference_outputs(name)
    assert_float_is_close(ours, theirs)


@pytest.mark.parametrize(
    ("lift", "options"),
    [
        ("bench", {"reps": 26}),
        ("deadlift", {"reps": 19, "rests": True}),
        ("slow_eccentric", {"reps": 9}),
        ("snatch", {"reps": 8}),
        ("clean_and_jerk", {"reps": 6}),
    ],
)
def test_float_over_a_minute(lift, options):
    """Against the core in double, which the tests above hold to the reference at 1e-9."""
    made = lifts.LIFTS[lift](5, **options)
    assert made.duration_s >= 60.0
    samples = batch(*simulate(made, 5))
    assert_float_is_close(run_core(samples, Params(), np.float32), run_core(samples, Params()))


def assert_float_is_close(ours, theirs):
    for name in ("v", "centre_velocity_mps"):
        assert np.abs(ours[name] - theirs[name]).max() <= FLOAT_VELOCITY_LIMIT_MPS
    assert attitude_error_rad(ours, theirs).max() <= FLOAT_ATTITUDE_LIMIT_RAD


# The checks above can fail --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gravity_mps2", 9.80665 * (1 + 1e-6)),
        ("lever_follower_m", np.array([-1.05, 1e-4, 0.02])),
        ("rigid_gyro_sigma_radps", 3.01e-3),
        ("zupt_variance", 1.001e-4),
        ("accel_noise_mps2_rthz", 1.101e-3),
        ("height_sigma_m", 0.01501),
        ("bound_sigma_mps", 0.301),
    ],
)
def test_the_double_check_sees_a_changed_parameter(name, value):
    samples, params = scenario("bench")
    changed = dataclasses.replace(params, **{name: value})
    assert worst(run_core(samples, changed), reference_outputs("bench")) > DOUBLE_LIMIT


def test_the_baselines_check_sees_a_changed_gain():
    samples, params = scenario("bench")
    ours = run_core(samples, dataclasses.replace(params, madgwick_gain=0.03301))
    assert relative_errors(ours, reference_outputs("bench"))["q_madgwick"] > BASELINE_LIMIT


def test_the_float_checks_see_a_changed_parameter():
    samples, params = scenario("bench")
    theirs = reference_outputs("bench")
    heavier = dataclasses.replace(params, gravity_mps2=9.816)
    with pytest.raises(AssertionError):
        assert_float_is_close(run_core(samples, heavier, np.float32), theirs)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -2e-3], [0.0, 2e-3, 1.0]])
    turned = dataclasses.replace(params, rotation_leader=turn)
    assert (
        attitude_error_rad(run_core(samples, turned, np.float32), theirs).max()
        > FLOAT_ATTITUDE_LIMIT_RAD
    )


def test_outputs_for_other_steps_are_not_compared():
    samples, params = scenario("bench")
    later = run_core(samples, dataclasses.replace(params, align_s=0.6))
    with pytest.raises(ValueError, match="alignments ended apart"):
        relative_errors(later, reference_outputs("bench"))


@pytest.mark.parametrize("window", [2, 3, 31, 64])
def test_a_window_of_any_length_judges_like_the_reference(window):
    """Short and odd ones too: the core sums a window in two halves, the reference looks at all."""
    whole, params = scenario("begun in motion")
    samples = first_steps(whole, 900)
    params = dataclasses.replace(params, zupt_window=window)
    ours, theirs = run_core(samples, params), run_reference(samples, params)
    np.testing.assert_array_equal(ours["flags"], theirs["flags"])
    assert len(set((ours["flags"] & int(Flag.STILL)).tolist())) == 2
    assert worst(ours, theirs) <= DOUBLE_LIMIT


CHANGES: dict[str, Any] = {
    "prefilter_iir": True,
    "zupt_shoe": True,
    "round_trip": False,
    "average_length": 5,
    "rigid_samples": 6,
    "rigid_fast": 3,
    "zupt_window": 30,
    "zupt_dwell": 60,
    "rotation_leader": np.diag([-1.0, -1.0, 1.0]),
    "rotation_follower": np.eye(3),
    "lever_leader_m": np.array([1.0, 0.0, 0.02]),
    "lever_follower_m": np.array([-1.0, 0.0, 0.02]),
    "height_far_m": 1e-4,
    "doubt_gate": 1e-6,
    "height_lost_m": 1e-3,
    "zupt_gyro_var": 1e-7,
    "turn_accel_mps2": 50.0,
}
"""What a parameter is changed to; all others are first doubled, then divided by eight."""

SETTING = {
    "cutoff_hz": {"prefilter_iir": True},
    "shoe_threshold": {"zupt_shoe": True},
    "shoe_accel_sigma_mps2": {"zupt_shoe": True},
    "shoe_gyro_sigma_radps": {"zupt_shoe": True},
    "rate_hz": {"prefilter_iir": True},
    "zupt_level_mps2": {"gravity_mps2": 9.76},
    # Two descents must differ, the height be in doubt, or the bar be still in disbelief, before
    # these have a say.
    "travel_share": {"height_jump_m": 0.6},
    "height_far_m": {"height_jump_m": 0.02},
    "doubt_gate": {"height_jump_m": 0.02, "height_far_m": 2.0},
    "height_doubt_m": {"height_jump_m": 0.02, "height_far_m": 2.0},
    "turn_accel_mps2": {"height_jump_m": 0.02, "turn_confirm_s": 0.01},
    "zupt_force_s": {"zupt_gate": 1e-3},
}


KINDS = ("bench", "snatch", "drop", "clean and jerk", "begun in motion", "deadlift in doubt")


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Params)])
def test_every_parameter_has_a_say(name):
    """None is read and forgotten: changing it changes some output of some set."""
    base = Params(**SETTING.get(name, {}))
    value = getattr(base, name)
    values = [CHANGES[name]] if name in CHANGES else [2.0 * value, value / 8.0]
    for kind in KINDS:
        samples, _ = scenario(kind)
        before = run_core(samples, base)
        for changed in values:
            after = run_core(samples, dataclasses.replace(base, **{name: changed}))
            if after.tobytes() != before.tobytes():
                return
    pytest.fail(f"{name} changes nothing")


def test_ten_minutes_keep_the_covariance_positive():
    """A squat set without end: 250,000 steps in float and in double, P looked at every 2 s."""
    samples, params = scenario("squat, one IMU")
    n, repeats = len(samples.leader.t_ticks), 70
    t = samples.leader.t_ticks
    for dtype, least in ((np.float64, 1e-9), (np.float32, 0.0)):
        estimator = Estimator(params, dtype)
        smallest = np.inf
        for k in range(repeats):
            shifted = dataclasses.replace(samples.leader, t_ticks=t + k * (t[-1] - t[0] + 38461))
            result = estimator.run(shifted, covariances=True)
            for matrix in result.covariances[::832].astype(np.float64):
                np.testing.assert_array_equal(matrix, matrix.T)
                sigma = np.sqrt(np.diag(matrix))
                smallest = min(smallest, np.linalg.eigvalsh(matrix / np.outer(sigma, sigma))[0])
        assert n * repeats > 200_000
        assert smallest > least, (dtype, smallest)
