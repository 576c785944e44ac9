# SPDX-License-Identifier: Apache-2.0
"""The door between Python and the core: parameters, arguments, refusals, state."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from hil.core import (
    MAX_FOLLOWER_SAMPLES,
    NOTHING,
    TICKS_PER_S,
    Estimator,
    Samples,
    _core,
    arrivals,
    as_dict,
    default_params,
    seconds,
    ticks,
)
from hil.reference import estimator as reference
from hil.reference.estimator import Flag
from hil.reference.params import Params

G = 9.80665
PERIOD_TICKS = 38461
STEPS = 400


def resting(n: int = STEPS, *, first: int = 0, seed: int = 1) -> Samples:
    """``n`` samples of a sensor lying level, with noise."""
    rng = np.random.default_rng([seed, first])
    force = np.array([0.0, 0.0, G]) + 0.01 * rng.standard_normal((n, 3))
    t = (first + np.arange(n, dtype=np.int64)) * PERIOD_TICKS
    return Samples(t, force, 1e-3 * rng.standard_normal((n, 3)))


def part(samples: Samples, begin: int, end: int) -> Samples:
    return Samples(*(column[begin:end] for column in samples.columns()))


def with_value(samples: Samples, name: str, row: int, value: float) -> Samples:
    column = np.array(getattr(samples, name))
    column[row] = value
    return dataclasses.replace(samples, **{name: column})


def same_state(a: Estimator, b: Estimator) -> bool:
    one, two = (dataclasses.astuple(e.nav) for e in (a, b))
    return all(np.array_equal(x, y) for x, y in zip(one, two, strict=True))


# Parameters ----------------------------------------------------------------------------------


def test_every_parameter_is_known_to_both_sides_with_the_same_default():
    assert list(default_params()) == [f.name for f in dataclasses.fields(Params)]
    assert default_params() == as_dict(Params())


def test_parameters_are_wanted_complete_and_nothing_else():
    values = as_dict(Params())
    with pytest.raises(ValueError, match="'align_s' is missing"):
        _core.Estimator64({k: v for k, v in values.items() if k != "align_s"})
    with pytest.raises(ValueError, match="does not know"):
        _core.Estimator64({**values, "another": 1.0})
    with pytest.raises(ValueError, match="'lever_leader_m' needs 3 numbers"):
        _core.Estimator64({**values, "lever_leader_m": [1.0, 2.0]})


@pytest.mark.parametrize(
    ("change", "mend"),
    [
        ({"rate_hz": 0.0}, "rate_hz must be positive"),
        ({"average_length": 17}, "1..16"),
        ({"average_length": 0}, "1..16"),
        ({"cutoff_hz": 208.0}, "below half of rate_hz"),
        ({"zupt_window": 65}, "2..64"),
        ({"zupt_variance": 0.0}, "without noise"),
        ({"rigid_samples": 0}, "at least 1"),
        ({"align_s": float("nan")}, "finite"),
        ({"lever_leader_m": np.array([0.0, np.inf, 0.0])}, "finite"),
    ],
)
def test_impossible_parameters_are_refused(change, mend):
    with pytest.raises(ValueError, match=mend):
        Estimator(Params(**change))


def test_only_float_and_double():
    with pytest.raises(ValueError, match="float32 or float64"):
        Estimator(dtype=np.float16)


# Arguments -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "mend"),
    [
        ({"t_ticks": np.arange(STEPS) / 416.0}, "integers"),
        ({"accel_mps2": np.zeros((STEPS, 4))}, "accel_mps2 has shape"),
        ({"gyro_radps": np.zeros((STEPS - 1, 3))}, "one row per sample"),
        ({"clipped": np.zeros(3, bool)}, "clipped has shape"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, mend):
    with pytest.raises(ValueError, match=mend):
        Estimator().run(dataclasses.replace(resting(), **change))


@pytest.mark.parametrize("arrival", [[-1, 0], [0, STEPS], [5, 4]])
def test_arrivals_must_be_steps_in_order(arrival):
    with pytest.raises(ValueError, match="index of a leader step, never falling"):
        Estimator().run(resting(), resting(2), np.array(arrival))


def test_follower_without_arrivals_is_refused():
    with pytest.raises(ValueError, match=r"hil\.core\.arrivals"):
        Estimator().run(resting(), resting(2))
    with pytest.raises(ValueError, match="give one row per sample"):
        Estimator().run(resting(), resting(2), np.array([1]))


def test_arrivals_ride_on_the_first_step_not_before_them():
    t = np.array([0, 10, 20])
    np.testing.assert_array_equal(arrivals(t, np.array([0, 1, 10, 11, 20])), [0, 1, 1, 2, 2])


def test_ticks_are_the_nearest():
    assert TICKS_PER_S == 16_000_000
    t_s = np.array([0.0, 1.0, 60.0 + 30e-9, 60.0 + 33e-9])
    np.testing.assert_array_equal(ticks(t_s) - ticks(np.floor(t_s)), [0, 0, 0, 1])
    np.testing.assert_allclose(seconds(ticks(t_s)), t_s, atol=31.25e-9)


# Steps ---------------------------------------------------------------------------------------


def test_step_by_step_is_the_same_as_one_run():
    own, theirs = resting(), resting(seed=2)
    lag = np.minimum(np.arange(STEPS) + 3, STEPS - 1)
    whole = Estimator().run(own, theirs, lag)
    single = Estimator()
    rows = []
    for k in range(STEPS):
        arrived = np.flatnonzero(lag == k)
        some = part(theirs, arrived[0], arrived[-1] + 1) if len(arrived) else NOTHING
        rows.append(single.step(part(own, k, k + 1), some))
    aligning = STEPS - len(whole.outputs)
    assert rows[:aligning] == [None] * aligning
    for k, row in enumerate(rows[aligning:]):
        for name in set(whole.outputs.dtype.names) - {"step"}:
            np.testing.assert_array_equal(row[name], whole.outputs[k][name])


def test_step_takes_one_leader_sample():
    with pytest.raises(ValueError, match="use run"):
        Estimator().step(resting(2))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_outputs_are_in_the_arithmetic_asked_for(dtype):
    result = Estimator(dtype=dtype).run(resting(), covariances=True)
    assert result.outputs["v"].dtype == dtype
    assert result.covariances.dtype == dtype
    assert result.covariances.shape == (len(result.outputs), 15, 15)
    diagonal = np.einsum("nii->ni", result.covariances)
    np.testing.assert_array_equal(diagonal, result.outputs["variance"])


def test_the_firmwares_estimator_is_small():
    assert Estimator(dtype=np.float32).state_bytes < 12 * 1024


# Bad samples ---------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["accel_mps2", "gyro_radps"])
def test_a_leader_sample_that_is_not_finite_is_refused_and_leaves_the_state(name, value):
    own = resting()
    estimator, twin = Estimator(), Estimator()
    with pytest.raises(ValueError, match="leader sample 300 is not finite: leave it out"):
        estimator.run(with_value(own, name, 300, value))
    twin.run(part(own, 0, 300))
    assert same_state(estimator, twin)
    rest = part(own, 301, STEPS)
    assert estimator.run(rest).outputs.tobytes() == twin.run(rest).outputs.tobytes()


@pytest.mark.parametrize("back", [0, 1])
def test_time_that_does_not_increase_is_refused_and_leaves_the_state(back):
    own = resting()
    estimator, twin = Estimator(), Estimator()
    for e in (estimator, twin):
        e.run(part(own, 0, 300))
    with pytest.raises(ValueError, match="leader sample 0: its time does not follow"):
        estimator.run(part(own, 299 - back, 310))
    rest = part(own, 300, STEPS)
    assert estimator.run(rest).outputs.tobytes() == twin.run(rest).outputs.tobytes()


def test_too_many_followers_on_one_step_are_refused():
    crowd = resting(MAX_FOLLOWER_SAMPLES + 1)
    with pytest.raises(ValueError, match="leader sample 399: more than 16 follower samples"):
        Estimator().run(resting(), crowd, np.full(len(crowd.t_ticks), STEPS - 1))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gyro_radps", np.nan),
        ("accel_mps2", np.inf),
        ("t_sigma_s", np.nan),
        ("t_ticks", 299 * PERIOD_TICKS),
        ("t_ticks", 300 * PERIOD_TICKS + TICKS_PER_S),
    ],
)
def test_a_bad_follower_sample_is_left_out_and_flagged_by_core_and_reference(name, value):
    own, theirs = resting(), resting(seed=2)
    theirs = dataclasses.replace(theirs, t_sigma_s=np.zeros(STEPS))
    bad = with_value(theirs, name, 300, value)
    at = np.arange(STEPS)
    outputs = Estimator().run(own, bad, at).outputs
    refused = (outputs["flags"] & Flag.FOLLOWER_REFUSED) > 0
    np.testing.assert_array_equal(outputs["step"][refused], [300])

    good = part(bad, 0, 300), part(bad, 301, STEPS)
    without = Samples(*(np.concatenate(c) for c in zip(*(g.columns() for g in good), strict=True)))
    expected = Estimator().run(own, without, np.delete(at, 300)).outputs
    for field in ("v", "q", "b_a", "b_g", "variance"):
        np.testing.assert_array_equal(outputs[field], expected[field])

    numpy = reference.Estimator(Params())
    flags = []
    for k in range(STEPS):
        one, two = (
            reference.Sample(float(seconds(t[k])), a[k], g[k], bool(c[k]), float(s[k]))
            for t, a, g, c, s in (own.columns(), bad.columns())
        )
        output = numpy.step(one, [two])
        if output is not None:
            flags.append(int(output.flags))
    np.testing.assert_array_equal(flags, outputs["flags"])


def test_the_reference_refuses_what_is_not_finite_and_keeps_its_state():
    numpy = reference.Estimator(Params())
    good = reference.Sample(1.0, np.array([0.0, 0.0, G]), np.zeros(3))
    numpy.step(good)
    with pytest.raises(ValueError, match="not finite"):
        numpy.step(reference.Sample(1.1, np.array([0.0, np.nan, G]), np.zeros(3)))
    assert np.isfinite(numpy.leader.prefilter(np.ones(6))).all()


# State ---------------------------------------------------------------------------------------


def test_a_copy_goes_its_own_way():
    own = resting()
    one = Estimator()
    one.run(part(own, 0, 300))
    two = one.copy()
    assert same_state(one, two)
    rest = part(own, 300, STEPS)
    after = one.run(rest).outputs
    assert not same_state(one, two)
    assert two.run(rest).outputs.tobytes() == after.tobytes()


def test_the_navigation_state_can_be_set():
    estimator = Estimator()
    estimator.run(resting())
    before = estimator.nav
    np.testing.assert_array_equal(before.covariance, before.covariance.T)
    moved = dataclasses.replace(before, p=before.p + 1.0)
    estimator.nav = moved
    np.testing.assert_array_equal(estimator.nav.p, moved.p)
    np.testing.assert_array_equal(estimator.nav.covariance, before.covariance)
    following = part(resting(STEPS + 1), STEPS, STEPS + 1)
    output = estimator.step(following)
    np.testing.assert_allclose(output["p"], moved.p, atol=0.01)
    with pytest.raises(ValueError, match="not finite"):
        estimator.nav = dataclasses.replace(before, v=np.full(3, np.nan))
    with pytest.raises(ValueError, match="15 x 15"):
        estimator.nav = dataclasses.replace(before, covariance=np.eye(14))


def test_importing_the_core_loads_no_test_or_serial_library():
    code = (
        "import sys, hil.core;"
        "print([m for m in ('pytest','serial','hil.backends','hil.plugin') if m in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.strip() == "[]"
