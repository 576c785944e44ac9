# SPDX-License-Identifier: Apache-2.0
"""The whole reference estimator on seeded sets: accuracy, false stillness, faults, consistency."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hil.core import NOTHING, Samples, ticks
from hil.motion import lifts
from hil.motion.imu_model import ErrorSpread
from hil.motion.lifts import Lift
from hil.motion.plan import Plan
from hil.parity import Batch, relative_errors, run_core, run_reference
from hil.reference import broad
from hil.reference.estimator import Estimator, Flag, Sample
from hil.reference.params import Params
from hil.reference.study import Link, Run, run_set, summarise

LEVEL = np.array([0.0, 0.0, 9.80665])


def flags(run: Run, flag: Flag) -> np.ndarray:
    return np.array([bool(o.flags & flag) for o in run.outputs])


@pytest.fixture(scope="module")
def touch_and_go() -> Run:
    return run_set(lifts.bench(3, reps=5), 3)


def test_touch_and_go_without_rest(touch_and_go):
    s = summarise([touch_and_go])
    assert (s.reps, s.missed, s.invented, s.false_zupt) == (5, 0, 0, 0)
    assert s.mean_rmse < 0.010
    assert s.peak_rmse < 0.015
    assert flags(touch_and_go, Flag.ROUND_TRIP).sum() >= 3


def test_with_rests():
    run = run_set(lifts.deadlift(5, reps=3, rests=True), 5)
    s = summarise([run])
    assert (s.reps, s.missed, s.invented, s.false_zupt) == (3, 0, 0, 0)
    assert s.mean_rmse < 0.005
    assert s.peak_rmse < 0.008


def test_peak_is_not_late(touch_and_go):
    """Group delay is taken off: the peak's time is right to well below the filter's delay."""
    late = np.mean([b.t_peak_s - a.t_peak_s for a, b in touch_and_go.pairs])
    assert abs(late) < 0.003


def test_no_stillness_in_a_slow_eccentric_or_a_bounce():
    for lift in (lifts.slow_eccentric(4, reps=1), lifts.deadlift(4, reps=3)):
        run = run_set(lift, 4)
        assert run.false_zupt == 0
        still = flags(run, Flag.STILL)
        spans = np.zeros_like(still)
        for begin, end in lift.still_spans_s:
            spans |= (run.t_s >= begin) & (run.t_s <= end + 0.12)
        assert not np.any(still & ~spans)
        assert np.any(still)


def test_impacts_beyond_full_scale_do_not_throw_the_state():
    run = run_set(lifts.drop(3, reps=1), 3)
    assert flags(run, Flag.CLIPPED).any()
    assert run.false_zupt == 0
    last = run.outputs[-1]
    assert np.abs(last.v).max() < 0.01
    assert np.linalg.norm(run.errors[-1, 6:8]) < np.radians(0.5)


def test_a_lost_follower_degrades_and_recovers():
    link = Link(lost_s=((3.0, 5.0),))
    run = run_set(lifts.bench(6, reps=3), 6, link=link)
    lost = flags(run, Flag.FOLLOWER_LOST)
    during = (run.t_s > 3.3) & (run.t_s < 4.9)
    after = run.t_s > 5.2
    assert lost[during].all()
    assert not lost[after].any()
    assert flags(run, Flag.RIGID)[after].any()
    assert summarise([run]).mean_rmse < 0.015


def test_one_imu_alone_works():
    run = run_set(lifts.bench(2, reps=3), 2, two=False)
    s = summarise([run])
    assert (s.missed, s.false_zupt) == (0, 0)
    assert s.mean_rmse < 0.015
    assert not flags(run, Flag.RIGID).any()


def test_a_follower_on_another_bar_is_gated_out():
    """Residuals of a motion that is not rigid must not reach the biases."""
    rng = np.random.default_rng(1)
    estimator = Estimator(Params())
    gated = 0
    for k in range(1200):
        shake = 3.0 * np.sin(0.3 * k) if k > 600 else 0.0
        noise = 0.015 * rng.standard_normal(3)
        other = np.array([25.0 if k > 600 else 0.0, shake, 0.0])
        own = Sample(k / 416.0, LEVEL + noise, 1e-3 * rng.standard_normal(3))
        theirs = Sample(k / 416.0 - 0.001, LEVEL + other, np.zeros(3))
        output = estimator.step(own, [theirs])
        gated += output is not None and bool(output.flags & Flag.RIGID_GATED)
    assert gated > 10
    assert np.abs(estimator.nav.b_a).max() < 0.05


def test_late_packets_are_worth_as_much_as_punctual_ones():
    lift = lifts.bench(8, reps=1)
    on_time = run_set(lift, 8, link=Link(latency_s=0.003, batch=1))
    late = run_set(lift, 8, link=Link(latency_s=0.060, batch=8))
    assert flags(late, Flag.RIGID).sum() > 0.95 * flags(on_time, Flag.RIGID).sum()
    assert not flags(late, Flag.RIGID_GATED).any()


def test_butterworth_prefilter_keeps_mean_velocity_and_its_time():
    run = run_set(lifts.bench(3, reps=2), 3, Params(prefilter_iir=True))
    s = summarise([run])
    assert s.mean_rmse < 0.010
    late = np.mean([b.t_peak_s - a.t_peak_s for a, b in run.pairs])
    assert abs(late) < 0.006


def test_shoe_detector_finds_the_same_rests():
    lift = lifts.deadlift(7, reps=2, rests=True)
    variance, shoe = (run_set(lift, 7, Params(zupt_shoe=choice)) for choice in (False, True))
    assert shoe.false_zupt == 0
    a, b = flags(variance, Flag.ZUPT), flags(shoe, Flag.ZUPT)
    assert np.mean(a == b) > 0.9


def test_variance_of_scale_errors_grows_with_the_square_of_a_turn_and_not_with_sway():
    """Along one way the bias variance gains (s g phi)^2; less than turn_step_rad adds nothing."""
    params = Params(accel_walk_mps2_rts=0.0)

    def gained(angles):
        estimator, dt = Estimator(params), 1.0 / 416.0
        rates = np.diff(angles, prepend=angles[0]) / dt
        return sum(
            estimator._inflation(LEVEL, np.array([w, 0.0, 0.0]), dt, clipped=False)[1][2]
            for w in rates
        )

    t = np.linspace(0.0, 1.0, 417)
    unit = (params.accel_scale_sigma * params.gravity_mps2) ** 2
    assert gained(1.4 * t) == pytest.approx(unit * 1.4**2, rel=0.01)
    assert gained(0.12 * np.sin(40.0 * t)) == 0.0
    there_and_back = np.concatenate([1.4 * t, 1.4 * t[::-1]])
    assert gained(there_and_back) == pytest.approx(2.0 * unit * 1.4**2, rel=0.01)


def test_a_bar_held_after_a_clean_keeps_its_velocity():
    """Four to eight seconds between the turnover and the floor, bounded by the holds."""
    run = run_set(lifts.clean_and_jerk(4, reps=1), 4)
    held = flags(run, Flag.BOUND) & np.array([o.gate == Params().hold_gate for o in run.outputs])
    assert held.sum() >= 3
    without = run_set(lifts.clean_and_jerk(4, reps=1), 4, Params(hold_span_s=0.0))
    assert np.abs(run.errors[:, 5]).max() < 0.6 * np.abs(without.errors[:, 5]).max()


def test_starting_in_motion_is_survived():
    """No still second at the start: alignment is poor, says so, and the next rest mends it."""
    lift = lifts.deadlift(9, reps=2, rests=True)
    whole = run_set(lift, 9)
    begin = lift.still_spans_s[0][1] + 0.3

    class Late(Estimator):
        def step(self, leader, followers=()):
            return None if leader.t_s < begin else super().step(leader, followers)

    late = run_set(lift, 9, make=Late)
    first, last = late.outputs[0], late.outputs[-1]
    assert first.variance[6] > 100 * whole.outputs[0].variance[6]
    assert np.abs(last.v).max() < 0.01


def test_baseline_runs_beside_and_its_divergence_is_reported(touch_and_go):
    divergence = np.array([o.divergence_rad for o in touch_and_go.outputs])
    assert divergence[0] < 1e-3
    assert 0.0 < divergence.max() < np.radians(20.0)


def test_the_same_input_gives_the_same_output_bit_for_bit():
    lift = lifts.bench(1, reps=1)
    one, two = (run_set(lift, 1).outputs[-1] for _ in range(2))
    for name in ("p", "v", "q", "b_a", "b_g", "variance"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_time_must_increase():
    estimator = Estimator(Params())
    estimator.step(Sample(1.0, LEVEL, np.zeros(3)))
    with pytest.raises(ValueError, match="does not follow"):
        estimator.step(Sample(1.0, LEVEL, np.zeros(3)))


def test_too_many_follower_samples_at_once_are_refused():
    sample = Sample(1.0, LEVEL, np.zeros(3))
    with pytest.raises(ValueError, match="17 follower samples on one step: give at most 16"):
        Estimator(Params()).step(sample, [sample] * 17)


def matched_set(seed: int) -> Lift:
    """A short carry with hands on the bar: rest, lift, hold, lower, hold."""
    plan = Plan(np.random.default_rng([seed, 77]), 1.0)
    plan.rest(0.8)
    plan.move(0.6, 1.3)
    plan.hold(0.5)
    plan.move(0.7, 0.9)
    plan.hold(0.6)
    return Lift("matched", seed, plan.finish(), tuple(plan.still_spans_s), (), ())


def test_nees_is_inside_its_95_percent_band_when_the_model_holds():
    """Chips drawn from the filter's own model: E[NEES] = 5, averaged over 40 runs.

    Everything that the filter rounds up on purpose (stillness that is exact, bounds, scale
    errors) is switched off, so what is tested is the propagation itself. The chi-square band
    for 40 x 5 degrees of freedom at 95 % is 4.07..6.02.
    """
    params = Params(
        accel_bias_sigma_mps2=0.02,
        accel_scale_sigma=0.0,
        gyro_scale_sigma=0.0,
        gyro_bias_sigma_still_radps=7e-5,
        tilt_sigma_still_rad=8e-5,
        velocity_sigma_still_mps=5e-4,
        zupt_dwell=10**9,
        bound_period_s=0.0,
        round_trip=False,
    )
    spread = ErrorSpread(
        accel_bias_mps2=0.02,
        gyro_bias_radps=2e-3,
        accel_walk_mps2_rts=1.5e-4,
        gyro_walk_radps_rts=3e-6,
        accel_scale=0.0,
        gyro_scale=0.0,
        accel_misalign_rad=0.0,
        gyro_misalign_rad=0.0,
    )
    runs = [
        run_set(matched_set(seed), seed, params, spread=spread, two=False) for seed in range(40)
    ]
    final = np.array([run.nees[-1] for run in runs])
    assert 4.07 <= final.mean() <= 6.02


def test_vertical_velocity_of_a_known_motion():
    """A level sensor on a sine: both integration and truth give it back through their filters."""
    rate = 285.0
    t = np.arange(0.0, 20.0, 1.0 / rate)
    w, n = 2 * np.pi * 0.8, len(t)
    rng = np.random.default_rng(1)
    position = np.zeros((n, 3))
    position[:, 2] = 0.2 * np.sin(w * t) + 2e-4 * rng.standard_normal(n)
    accel = np.zeros((n, 3))
    accel[:, 2] = 9.80665 - 0.2 * w * w * np.sin(w * t)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    still = np.zeros((n, 3))
    trial = broad.Trial(rate, accel, still, q, position, np.ones(n, bool))
    assert broad.velocity_rmse_mps(0.2 * w * np.cos(w * t), trial, washout=False) < 0.005
    ours = broad.integrated(trial, q)
    assert broad.velocity_rmse_mps(ours, trial, washout=True) < 0.01
    tilted = np.tile([np.cos(0.05), np.sin(0.05), 0.0, 0.0], (n, 1))
    assert broad.velocity_rmse_mps(broad.integrated(trial, tilted), trial, washout=True) > 0.02
    position[2000:2100] = np.nan
    assert np.isfinite(broad.velocity_rmse_mps(ours, trial, washout=True))


@cache
def broad_trial(name: str) -> tuple[broad.Trial, Batch]:
    """A trial, and its samples as reference and core take them."""
    pytest.importorskip("h5py", reason="pip install h5py")
    trial = broad.load(os.environ["HIL_DATA"], name)
    t_ticks = ticks(np.arange(len(trial.accel_mps2)) / trial.rate_hz)
    samples = Samples(t_ticks, trial.accel_mps2, trial.gyro_radps)
    return trial, Batch(samples, NOTHING, np.zeros(0, np.int64))


def estimated_by(run: Callable[[Batch, Params], np.ndarray], trial: broad.Trial, samples: Batch):
    """What :func:`hil.reference.broad.estimate` says of a trial, by the core or the reference."""
    params = broad.params(trial.rate_hz)
    outputs = run(samples, params)
    delay = round(Estimator(params).leader.prefilter.delay_samples)
    n = len(samples.leader.t_ticks)
    q, velocity = np.full((n, 4), np.nan), np.full(n, np.nan)
    q[outputs["step"] - delay], velocity[outputs["step"] - delay] = outputs["q"], outputs["v"][:, 2]
    return q, velocity


@cache
def broad_figures(name: str) -> dict[str, tuple[float, float]]:
    """Inclination, deg, and vertical velocity, m/s, by method, over the whole trial.

    The core in double stands for the reference, which takes a minute for the three trials;
    that they are the same on these is the next test's.
    """
    pytest.importorskip("vqf", reason="pip install vqf")
    trial, samples = broad_trial(name)
    return broad.figures(trial, estimated_by(run_core, trial, samples))


@pytest.mark.skipif(not os.environ.get("HIL_DATA"), reason="set HIL_DATA to the real recordings")
@pytest.mark.parametrize("name", ["14", "15", "24"])
def test_reference_and_core_are_the_same_on_broad(name):
    """From four seconds of rest to the eleventh second of motion; every decision too."""
    trial, samples = broad_trial(name)
    moves = int(np.flatnonzero(trial.counts)[0])
    chosen = slice(moves - round(4 * trial.rate_hz), moves + round(11 * trial.rate_hz))
    cut = replace(samples, leader=Samples(*(column[chosen] for column in samples.leader.columns())))
    params = broad.params(trial.rate_hz)
    core, reference = run_core(cut, params), run_reference(cut, params)
    errors = relative_errors(core, reference)
    assert max(errors.values()) <= 1e-9, errors
    np.testing.assert_array_equal(core["flags"], reference["flags"])
    # And the reference's own loop over a trial gives the same from sample to sample.
    begun = replace(
        trial, accel_mps2=trial.accel_mps2[chosen][:900], gyro_radps=trial.gyro_radps[chosen][:900]
    )
    few = replace(cut, leader=Samples(*(column[:900] for column in cut.leader.columns())))
    for mine, theirs in zip(broad.estimate(begun), estimated_by(run_core, begun, few), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-7)


@pytest.mark.skipif(not os.environ.get("HIL_DATA"), reason="set HIL_DATA to the real recordings")
@pytest.mark.parametrize("trial", ["14", "15"])
def test_vertical_velocity_on_broad(trial):
    """Beside the same integration on VQF's attitude; the filter's own bounds keep it from drift."""
    rows = broad_figures(trial)
    ours, theirs = (rows[f"integration on {whose}"][1] for whose in ("this attitude", "VQF-6D's"))
    assert ours <= 1.5 * theirs
    assert ours <= rows["integration on Madgwick's"][1]


@pytest.mark.skipif(not os.environ.get("HIL_DATA"), reason="set HIL_DATA to the real recordings")
@pytest.mark.parametrize("trial", ["14", "15", "24"])
def test_inclination_on_broad(trial):
    """BROAD with optical truth: at least as good as Madgwick, within 1.5 times VQF-6D."""
    rows = broad_figures(trial)
    ours, madgwick, theirs = (
        rows[f"integration on {whose}"][0] for whose in ("this attitude", "Madgwick's", "VQF-6D's")
    )
    assert ours <= madgwick
    assert ours <= 1.5 * theirs
