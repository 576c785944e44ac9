# SPDX-License-Identifier: Apache-2.0
"""The reference's parts, each against a hand-worked case or a law."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.reference import hold, rigid_body, round_trip, zupt
from hil.reference.attitude import (
    angle_between,
    conjugate,
    exp,
    from_gravity,
    matrix,
    multiply,
    normalised,
    skew,
    tilt_between,
)
from hil.reference.madgwick import madgwick_step
from hil.reference.params import Params
from hil.reference.prefilter import Butterworth2, MovingAverage
from hil.reference.state import G_, PZ, V_, Nav, correct, nis, predict

G = 9.80665


def random_quaternion(rng):
    return normalised(rng.standard_normal(4))


def random_nav(rng) -> Nav:
    root = 0.1 * rng.standard_normal((15, 15))
    return Nav(
        rng.standard_normal(3),
        rng.standard_normal(3),
        random_quaternion(rng),
        0.1 * rng.standard_normal(3),
        0.01 * rng.standard_normal(3),
        root @ root.T,
    )


def test_group_laws():
    rng = np.random.default_rng(1)
    p, q = random_quaternion(rng), random_quaternion(rng)
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(multiply(p, conjugate(p)), identity, atol=1e-15)
    np.testing.assert_allclose(matrix(multiply(p, q)), matrix(p) @ matrix(q), atol=1e-15)
    np.testing.assert_allclose(skew(p[:3]) @ q[:3], np.cross(p[:3], q[:3]), atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 0.99e-4, 1.01e-4, 0.5, 3.0])
def test_exp_turns_by_its_angle(angle):
    axis = np.array([1.0, -2.0, 2.0]) / 3.0
    q = exp(angle * axis)
    expected = np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * axis])
    np.testing.assert_allclose(q, expected, atol=1e-16)


def test_gravity_gives_tilt_and_no_yaw():
    force = matrix(exp(np.array([0.3, -0.2, 0.0]))).T @ np.array([0.0, 0.0, G])
    R = matrix(from_gravity(force))  # noqa: N806
    np.testing.assert_allclose(R @ force, [0.0, 0.0, G], atol=1e-12)
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(0.0, abs=1e-12)


def test_tilt_ignores_yaw():
    q = exp(np.array([0.1, 0.2, 0.3]))
    turned = multiply(exp(np.array([0.0, 0.0, 1.1])), q)
    assert tilt_between(q, turned) == pytest.approx(0.0, abs=1e-7)
    leaned = multiply(exp(np.array([0.05, 0.0, 0.0])), turned)
    assert tilt_between(turned, leaned) == pytest.approx(0.05)
    assert angle_between(q, turned) == pytest.approx(1.1)


def test_moving_average_is_a_mean_with_half_its_length_of_delay():
    f = MovingAverage(4)
    ramp = [f(np.full(6, float(k))) for k in range(12)]
    assert f.delay_samples == 1.5
    np.testing.assert_allclose([y[0] for y in ramp[4:]], np.arange(4, 12) - 1.5)


@pytest.mark.parametrize("rate_hz", [104.0, 416.0, 1667.0])
def test_butterworth_against_its_definition(rate_hz):
    """Unit gain at zero, -3.01 dB at the cut-off, zero at Nyquist, delay 1/(sqrt(2) K)."""
    f = Butterworth2(15.0, rate_hz)

    def gain(frequency_hz: float) -> complex:
        z = np.exp(-2j * np.pi * frequency_hz / rate_hz)
        top = f.b[0] + f.b[1] * z + f.b[2] * z * z
        return complex(top / (1.0 + f.a[0] * z + f.a[1] * z * z))

    assert abs(gain(0.0)) == pytest.approx(1.0)
    assert abs(gain(15.0)) == pytest.approx(math.sqrt(0.5))
    assert abs(gain(rate_hz / 2.0)) == pytest.approx(0.0, abs=1e-9)
    k = math.tan(math.pi * 15.0 / rate_hz)
    assert f.delay_samples == pytest.approx(1.0 / (math.sqrt(2.0) * k))
    ramp = [f(np.full(6, float(n)))[0] for n in range(3000)]
    assert 2999 - ramp[-1] == pytest.approx(f.delay_samples, rel=1e-6)


@pytest.mark.parametrize("make", [lambda: MovingAverage(5), lambda: Butterworth2(15.0, 416.0)])
def test_prefilters_start_without_a_transient(make):
    f, x = make(), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    for _ in range(30):
        np.testing.assert_allclose(f(x), x, rtol=1e-12)


@pytest.mark.parametrize(
    "make", [lambda: MovingAverage(0), lambda: MovingAverage(17), lambda: Butterworth2(60.0, 104.0)]
)
def test_impossible_prefilters_are_refused(make):
    with pytest.raises(ValueError, match=r"length|cut-off"):
        make()


def test_prediction_jacobian_against_differences():
    """Perturb the true state, propagate truth and nominal, compare with F from P = I."""
    rng = np.random.default_rng(2)
    params = Params()
    force, rate, dt = np.array([1.0, -2.0, 11.0]), np.array([0.3, -0.4, 0.5]), 1e-3
    nominal = random_nav(rng)
    nominal.P = np.zeros((15, 15))

    def propagate(dx):
        nav = Nav(
            nominal.p + dx[0:3],
            nominal.v + dx[3:6],
            multiply(exp(dx[6:9]), nominal.q),
            nominal.b_a + dx[9:12],
            nominal.b_g + dx[12:15],
        )
        a = nav.R @ (force - nav.b_a) - np.array([0.0, 0.0, G])
        predict(params, nav, a_before=a, force=force, rate=rate, dt=dt, extra=(0.0, 0.0, 0.0))
        return nav

    base, eps = propagate(np.zeros(15)), 1e-5
    F = np.zeros((15, 15))  # noqa: N806
    for i in range(15):
        dx = np.zeros(15)
        dx[i] = eps
        moved = propagate(dx)
        turn = 2.0 * multiply(moved.q, conjugate(base.q))[1:]
        F[:, i] = (
            np.concatenate(
                [
                    moved.p - base.p,
                    moved.v - base.v,
                    turn,
                    moved.b_a - base.b_a,
                    moved.b_g - base.b_g,
                ]
            )
            / eps
        )
    start = rng.standard_normal((15, 15))
    start = start @ start.T
    nominal.P = start.copy()
    a = nominal.R @ (force - nominal.b_a) - np.array([0.0, 0.0, G])
    quiet = Params(
        accel_noise_mps2_rthz=0.0,
        gyro_noise_radps_rthz=0.0,
        accel_walk_mps2_rts=0.0,
        gyro_walk_radps_rts=0.0,
        height_walk_m_rts=0.0,
    )
    predict(quiet, nominal, a_before=a, force=force, rate=rate, dt=dt, extra=(0.0, 0.0, 0.0))
    # The filter's F is first order in dt; what it leaves out is below 3e-5 at 1 kHz.
    np.testing.assert_allclose(nominal.P, F @ start @ F.T, atol=1e-3)


def test_correction_is_the_textbook_kalman_update():
    rng = np.random.default_rng(3)
    nav = random_nav(rng)
    P, v = nav.P.copy(), nav.v.copy()  # noqa: N806
    H = np.zeros((3, 15))  # noqa: N806
    H[:, V_] = np.eye(3)
    R = np.array([0.02, 0.03, 0.04])  # noqa: N806
    y = np.array([0.1, -0.2, 0.05])
    S = H @ P @ H.T + np.diag(R)  # noqa: N806
    expected_nis = y @ np.linalg.inv(S) @ y
    assert nis(nav, H, y, R) == pytest.approx(expected_nis)
    correct(nav, H, y, R)
    K = P @ H.T @ np.linalg.inv(S)  # noqa: N806
    np.testing.assert_allclose(nav.P, (np.eye(15) - K @ H) @ P, atol=1e-12)
    np.testing.assert_allclose(nav.v, v + (K @ y)[V_], atol=1e-12)


def test_components_one_by_one_give_the_same_as_together():
    """What lets the core update with scalars only."""
    rng = np.random.default_rng(4)
    joint, single = (random_nav(np.random.default_rng(9)) for _ in range(2))
    H = rng.standard_normal((3, 15))  # noqa: N806
    y, R = 0.01 * rng.standard_normal(3), np.array([0.5, 0.2, 0.9])  # noqa: N806
    dx_joint = correct(joint, H, y, R)
    dx = np.zeros(15)
    for i in range(3):
        rest = Nav(P=single.P)
        dx = dx + correct(rest, H[i : i + 1], y[i : i + 1] - H[i] @ dx, R[i : i + 1])
        single.P = rest.P
    np.testing.assert_allclose(dx, dx_joint, atol=1e-14)
    np.testing.assert_allclose(single.P, joint.P, atol=1e-14)


def test_covariance_stays_symmetric_and_positive_over_many_steps():
    rng, params = np.random.default_rng(5), Params()
    nav = random_nav(rng)
    a = np.zeros(3)
    for k in range(2000):
        force = np.array([0.0, 0.0, G]) + 0.5 * rng.standard_normal(3)
        extra = (0.0, 0.0, 0.0)
        a = predict(
            params, nav, a_before=a, force=force, rate=0.3 * rng.standard_normal(3), dt=0.0024,
            extra=extra,
        )  # fmt: skip
        if k % 3 == 0:
            correct(nav, *zupt.velocity_measurement(params, nav))
    np.testing.assert_array_equal(nav.P, nav.P.T)
    assert np.linalg.eigvalsh(nav.P).min() > 0.0


def test_gravity_alignment_leaves_yaw_free():
    params, nav = Params(), Nav(q=exp(np.array([0.02, -0.03, 0.7])))
    nav.P = np.diag(np.full(15, 0.01))
    tilted = nav.q.copy()
    H, y, R = zupt.gravity_measurement(params, nav, np.array([0.0, 0.0, G]))  # noqa: N806
    np.testing.assert_array_equal(H[:, 8], 0.0)
    dx = correct(nav, H, y, R)
    assert dx[8] == 0.0
    level = np.array([1.0, 0.0, 0.0, 0.0])
    assert tilt_between(nav.q, level) < 0.2 * tilt_between(tilted, level)


def test_rigid_body_residual_is_the_difference_of_biases():
    """Truth with known biases: d_f and d_w must come out as b_L - b_F, and H must be right."""
    rng, params = np.random.default_rng(6), Params()
    nav = Nav()
    w, alpha, f = np.array([0.4, -1.0, 0.7]), np.array([2.0, 3.0, -1.0]), np.array([1.0, 2.0, 9.0])
    b_al, b_af, b_gl, b_gf = (0.01 * rng.standard_normal(3) for _ in range(4))
    r = params.lever_follower_m - params.lever_leader_m
    f_follower = f + np.cross(alpha, r) + np.cross(w, np.cross(w, r))
    leader = rigid_body.Past(0.0, f + b_al, w + b_gl, alpha)
    follower = rigid_body.Arrival(0.0, f_follower + b_af, w + b_gf, 1e-6)
    nav.b_g = b_gl
    sums = rigid_body.Averager()
    d_f, d_w = rigid_body.add_residual(
        params, nav, sums, leader=leader, slope=np.zeros(3), follower=follower
    )
    np.testing.assert_allclose(d_f, b_al - b_af, atol=1e-12)
    np.testing.assert_allclose(d_w, b_gl - b_gf, atol=1e-12)
    H, _, _ = rigid_body.force_measurement(params, nav, sums)  # noqa: N806
    error, eps = np.array([0.3, -0.2, 0.5]), 1e-6
    nav.b_g = b_gl - eps * error
    moved = rigid_body.Averager()
    d_moved, _ = rigid_body.add_residual(
        params, nav, moved, leader=leader, slope=np.zeros(3), follower=follower
    )
    np.testing.assert_allclose((d_moved - d_f) / eps, H[:, G_] @ error, atol=1e-5)


def test_time_uncertainty_widens_the_rigid_body_noise():
    params, nav = Params(), Nav()
    past = rigid_body.Past(0.0, np.array([0.0, 0.0, G]), np.zeros(3), np.zeros(3))
    variances = []
    for sigma in (0.0, 1e-3):
        sums = rigid_body.Averager()
        arrival = rigid_body.Arrival(0.0, past.force, past.rate, sigma)
        slope = np.array([0.0, 0.0, 100.0])
        rigid_body.add_residual(params, nav, sums, leader=past, slope=slope, follower=arrival)
        variances.append(rigid_body.force_measurement(params, nav, sums)[2][0])
    assert variances[1] - variances[0] == pytest.approx((100.0 * 1e-3) ** 2)


def window_of(params, force, rate):
    w = zupt.Window.of(params)
    for f, r in zip(force, rate, strict=True):
        w.push(f, r)
    return w


@pytest.mark.parametrize("shoe", [False, True])
def test_detectors_tell_a_rack_from_hands(shoe):
    rng = np.random.default_rng(7)
    params = Params(zupt_shoe=shoe)
    n = params.zupt_window
    rack = np.array([0.0, 0.0, G]) + 0.008 * rng.standard_normal((n, 3))
    quiet = 5e-4 * rng.standard_normal((n, 3))
    assert zupt.window_is_still(params, window_of(params, rack, quiet), np.zeros(3))
    tremor = 0.12 * np.sin(2 * np.pi * 10.0 * np.arange(n) / 416.0)
    hands = rack + np.outer(tremor, [0.3, 0.3, 1.0])
    assert not zupt.window_is_still(params, window_of(params, hands, quiet), np.zeros(3))
    turning = quiet + np.array([0.05, 0.0, 0.0])
    assert not zupt.window_is_still(params, window_of(params, rack, turning), np.zeros(3))
    assert not zupt.window_is_still(params, window_of(params, rack[:-1], quiet[:-1]), np.zeros(3))


def test_one_sample_outside_ends_stillness():
    params = Params()
    n = params.zupt_window
    force, rate = np.tile([0.0, 0.0, G], (n, 1)), np.zeros((n, 3))
    force[-1, 2] += 0.05
    assert not zupt.window_is_still(params, window_of(params, force, rate), np.zeros(3))


def test_setting_out_sideways_ends_stillness():
    """|a| hardly changes: 0.1 m/s^2 across gravity are 0.5 mm/s^2 of it."""
    params = Params()
    n = params.zupt_window
    force, rate = np.tile([0.0, 0.0, G], (n, 1)), np.zeros((n, 3))
    force[-1, 1] += 0.1
    assert not zupt.window_is_still(params, window_of(params, force, rate), np.zeros(3))


def test_boundary_is_found_once_per_turn_and_never_at_rest():
    params, trip = Params(), round_trip.RoundTrip()
    dt, found = 1 / 416.0, []
    t = np.arange(0.0, 10.0, dt)
    height = 0.25 * np.cos(2 * np.pi * t / 2.5)
    speed = -0.25 * 2 * np.pi / 2.5 * np.sin(2 * np.pi * t / 2.5)
    for now, h, v in zip(t, height, speed, strict=True):
        if round_trip.boundary(params, Nav(), trip, now, h_m=h, v_mps=v):
            found.append((now, trip.t_cross_s, trip.h_cross_m))
    bottoms = [1.25, 3.75, 6.25, 8.75]
    np.testing.assert_allclose([f[1] for f in found], bottoms, atol=1e-3)
    np.testing.assert_allclose([f[2] for f in found], -0.25, atol=1e-4)
    assert max(f[0] - f[1] for f in found) < 0.15
    trip = round_trip.RoundTrip()
    for now in t:
        assert not round_trip.boundary(
            params, Nav(), trip, now, h_m=1.0, v_mps=0.001 * math.sin(40.0 * now)
        )


def test_in_doubt_a_steep_rise_is_a_turn():
    """A velocity that has drifted by more than a slow descent's own: no descent, no crossing."""
    params, dt = Params(), 1 / 416.0
    t = np.arange(0.0, 6.0, dt)
    rise = np.clip(t - 5.0, 0.0, 0.3) * 3.0
    speed = -0.1 + rise + 0.12
    height = np.cumsum(speed) * dt
    found = {}
    for sigma in (0.02, 0.2):
        nav, trip = Nav(), round_trip.RoundTrip(count=1)
        nav.P[PZ, PZ] = sigma**2
        steps = zip(t, height, speed, strict=True)
        found[sigma] = [
            trip.t_cross_s
            for now, h, v in steps
            if round_trip.boundary(params, nav, trip, now, h_m=h, v_mps=v)
        ]
    assert not found[0.02]
    assert found[0.2] == pytest.approx([5.0 + (0.15 - 0.02) / 3.0], abs=2 * dt)


def test_a_correction_is_no_descent():
    """The jump that a correction puts into height and velocity must not look like another turn."""
    params, nav, trip = Params(), Nav(), round_trip.RoundTrip()
    round_trip.boundary(params, nav, trip, 0.0, h_m=0.5, v_mps=0.2)
    trip.begin_descent()
    round_trip.boundary(params, nav, trip, 0.1, h_m=0.2, v_mps=-0.05)
    assert not trip.armed
    assert not round_trip.boundary(params, nav, trip, 0.2, h_m=0.2, v_mps=0.2)


def test_in_doubt_the_length_of_a_descent_is_as_uncertain_as_the_height():
    params, nav, trip = Params(), Nav(), round_trip.RoundTrip()
    trip.h_cross_m, trip.travel_m = 0.5, 0.5
    round_trip.add_anchor(params, nav, trip)
    trip.h_cross_m, trip.travel_m = 0.3, 0.1
    nav.P[PZ, PZ] = 0.2**2
    assert round_trip.associate(params, nav, trip) == 0
    nav.P[PZ, PZ] = 0.09**2
    assert round_trip.associate(params, nav, trip) == -1


def fed(params, speed):
    """Spans that are long enough, in a velocity trace: (end, mean of v)."""
    held, found = hold.Hold(), []
    for k, v in enumerate(speed):
        if held.steady(params, k * params.dt_s, v):
            found.append((k * params.dt_s, -float(hold.measurement(params, held)[1][0])))
            held.clear()
    return found


def test_a_steady_velocity_is_a_hold_and_a_changing_one_is_none():
    params = Params()
    t = np.arange(0.0, 2.0, params.dt_s)
    sway = 0.08 + 0.01 * np.sin(2 * np.pi * 1.0 * t)
    spans = fed(params, sway)
    assert len(spans) == int(2.0 / (params.hold_span_s + params.dt_s))
    assert all(mean == pytest.approx(0.08, abs=0.011) for _, mean in spans)
    assert not fed(params, 0.5 * np.sin(2 * np.pi * 0.5 * t))


def test_a_hold_corrects_a_drifted_velocity_and_leaves_a_known_one():
    params, held = Params(), hold.Hold()
    held.count, held.sum_mps = 100, 100 * 0.1
    H, y, R = hold.measurement(params, held)  # noqa: N806
    for sigma, passes in ((0.05, True), (0.005, False)):
        nav = Nav(v=np.array([0.0, 0.0, 0.1]), P=np.eye(15) * sigma**2)
        assert (nis(nav, H, y, R) <= params.hold_gate) == passes
    nav = Nav(v=np.array([0.0, 0.0, 0.1]), P=np.eye(15) * 0.05**2)
    correct(nav, H, y, R)
    assert 0.0 < nav.v[2] < 0.02


def test_round_trip_brings_height_and_velocity_back():
    """A constant velocity error is seen as height gained between two boundaries."""
    params, nav, trip = Params(), Nav(), round_trip.RoundTrip()
    nav.P = np.diag([0.0] * 3 + [0.02**2] * 3 + [1e-8] * 9)
    trip.h_cross_m, trip.travel_m = 0.5, 0.5
    nav.p[2] = 0.5
    round_trip.add_anchor(params, nav, trip)
    error = 0.02
    nav.v[2] = error
    for _ in range(1000):
        predict(
            params, nav, a_before=np.zeros(3), force=np.array([0.0, 0.0, G]), rate=np.zeros(3),
            dt=0.0025, extra=(0.0, 0.0, 0.0),
        )  # fmt: skip
    trip.h_cross_m, trip.t_cross_s = float(nav.p[2]), 2.5
    assert round_trip.associate(params, nav, trip) == 0
    correct(nav, *round_trip.measurement(params, nav, trip, 0, 2.5))
    assert abs(nav.v[2]) < 0.2 * error
    assert not trip.doubt
    assert math.sqrt(nav.P[PZ, PZ]) < 1.05 * params.height_sigma_m


def test_other_turns_are_not_mistaken_for_the_anchor():
    params, nav, trip = Params(), Nav(), round_trip.RoundTrip()
    trip.h_cross_m, trip.travel_m = 0.8, 0.31
    round_trip.add_anchor(params, nav, trip)
    trip.h_cross_m, trip.travel_m = 1.19, 0.16
    assert round_trip.associate(params, nav, trip) == -1
    trip.h_cross_m, trip.travel_m = 0.82, 1.0
    assert round_trip.associate(params, nav, trip) == -1
    trip.h_cross_m, trip.travel_m = 0.82, 0.3
    assert round_trip.associate(params, nav, trip) == 0


def test_madgwick_step_by_hand():
    """From level with force along x: gradient (0, 0, -2, 0) / 2, so q_y moves by -(-1) beta dt."""
    q = madgwick_step(
        np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.01, 0.1
    )
    # f = (-1, 0, 1): gradient = (0, 0, 2, 0), normalised (0, 0, 1, 0).
    expected = normalised(np.array([1.0, 0.0, -0.001, 0.0]))
    np.testing.assert_allclose(q, expected, atol=1e-15)


def test_madgwick_converges_to_gravity():
    q = exp(np.array([0.3, 0.2, 0.0]))
    for _ in range(4000):
        q = madgwick_step(q, np.array([0.0, 0.0, G]), np.zeros(3), 0.01, 0.05)
    assert tilt_between(q, np.array([1.0, 0.0, 0.0, 0.0])) < 2e-3
