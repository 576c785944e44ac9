# SPDX-License-Identifier: Apache-2.0
"""The three published trackers against steps worked out apart from them, and their behaviour."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.spatial.transform import Rotation

from hil.motion.imu_model import sample
from hil.motion.sprint import ATHLETES, ROLE, sprint
from hil.reference.attitude import from_matrix, matrix
from hil.reference.estimator import Sample
from hil.reference.sprint import P_, T_, V_, SprintParams, SprintTracker, cayley, transition
from hil.reference.tracker import Slower
from hil.reference.vertical_plane import PlaneTracker, euler, from_euler
from hil.reference.zero_velocity import (
    Calibration,
    LeastSquares,
    ZeroVelocityParams,
    ZeroVelocityTracker,
    ahrs_step,
)

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])


def short_move(rate_hz: float, moves: int, span_s: float = 0.4, distance_m: float = 0.3):
    """A level sensor: still for 2 s, then carried along x and left lying, again and again.

    Yields samples; the acceleration is that of the minimum-jerk polynomial over ``span_s``.
    """
    rng = np.random.default_rng(1)
    for k in range(int((2.0 + 2.0 * moves) * rate_hz)):
        t = k / rate_hz
        s = ((t - 2.0) % 2.0 - 0.2) / span_s
        inside = t >= 2.0 and 0.0 < s < 1.0
        a = distance_m / span_s**2 * (60 * s - 180 * s**2 + 120 * s**3) if inside else 0.0
        force = np.array([a, 0.0, G]) + 0.02 * rng.standard_normal(3)
        yield Sample(t, force, 1e-3 * rng.standard_normal(3))


# Rotations -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_quaternion_of_a_matrix(seed):
    turn = Rotation.random(random_state=seed)
    q = from_matrix(turn.as_matrix())
    np.testing.assert_allclose(q, np.roll(turn.as_quat(canonical=True), 1), atol=1e-14)


@pytest.mark.parametrize("axis", np.eye(3))
def test_quaternion_of_a_half_turn(axis):
    """Where w is zero and a division by it would fail."""
    q = from_matrix(Rotation.from_rotvec(math.pi * axis).as_matrix())
    np.testing.assert_allclose(np.abs(q), [0.0, *axis], atol=1e-14)


# Sprint --------------------------------------------------------------------------------------


def test_cayley_turns_by_twice_the_arctangent_of_half():
    turn = np.array([0.1, -0.25, 0.2])
    angle = float(np.linalg.norm(turn))
    exact = Rotation.from_rotvec(turn / angle * 2.0 * math.atan(angle / 2.0)).as_matrix()
    np.testing.assert_allclose(cayley(turn), exact, atol=1e-15)


def test_cayley_is_the_gyroscopes_turn_to_third_order():
    turn = np.array([2e-3, -1e-3, 2e-3])
    skewed = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    np.testing.assert_allclose(cayley(turn), expm(skewed), atol=np.linalg.norm(turn) ** 3 / 10.0)


def test_a_level_push_is_integrated_as_by_hand():
    """1 m/s^2 forwards for 0.1 s from 2 m/s: 2.1 m/s and 0.2 + 0.005 m."""
    tracker = SprintTracker()
    tracker.v = np.array([2.0, 0.0, 0.0])
    tracker.predict(np.array([1.0, 0.0, G]), np.zeros(3), 0.1)
    np.testing.assert_allclose(tracker.v, [2.1, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(tracker.p, [0.205, 0.0, 0.0], atol=1e-15)


def test_acceleration_is_by_the_mean_of_both_attitudes():
    """Pitched down by 2 atan(0.01): half of C before plus C after, on f = (0, 0, g)."""
    tracker = SprintTracker()
    tracker.predict(np.array([0.0, 0.0, G]), np.array([0.0, 0.2, 0.0]), 0.1)
    angle = 2.0 * math.atan(0.01)
    forwards, upwards = G * math.sin(angle) / 2.0, G * (1.0 + math.cos(angle)) / 2.0 - G
    np.testing.assert_allclose(tracker.v, [0.1 * forwards, 0.0, 0.1 * upwards], atol=1e-15)


def test_transition_is_the_jacobian_of_the_step():
    rng = np.random.default_rng(3)
    C = Rotation.random(random_state=4).as_matrix()  # noqa: N806
    accel, gyro, dt, h = np.array([3.0, -2.0, 11.0]), np.array([0.2, -0.1, 0.3]), 1e-3, 1e-6

    def after(error):
        one = SprintTracker()
        one.C = Rotation.from_rotvec(error[T_]).as_matrix() @ C
        one.p, one.v = error[P_].copy(), error[V_].copy()
        one.predict(accel, gyro, dt)
        return one

    base = after(np.zeros(9))
    columns = []
    for direction in np.eye(9):
        moved = after(h * direction)
        turn = Rotation.from_matrix(moved.C @ base.C.T).as_rotvec()
        columns.append(np.concatenate([turn, moved.p - base.p, moved.v - base.v]) / h)
    force = 0.5 * (C + base.C) @ accel
    d = rng.standard_normal(9)
    np.testing.assert_allclose(transition(force, dt) @ d, np.array(columns).T @ d, atol=3e-5)
    assert np.abs(transition(force, dt)[V_, T_]).max() > 5e-3


def test_yaw_as_sure_as_its_measurement_is_halved():
    params = SprintParams(yaw_sigma_rad=0.1)
    tracker = SprintTracker(params)
    tracker.C = Rotation.from_euler("z", 0.02).as_matrix()
    tracker.P = np.diag([0.0, 0.0, 0.01, 0, 0, 0, 0, 0, 0])
    tracker.correct_yaw()
    yaw = math.atan2(tracker.C[1, 0], tracker.C[0, 0])
    assert yaw == pytest.approx(0.01, abs=1e-6)  # the Cayley form, once more
    assert tracker.P[2, 2] == pytest.approx(0.005, rel=1e-12)


def test_joseph_form_is_the_information_form():
    rng = np.random.default_rng(5)
    root = rng.standard_normal((9, 9))
    tracker = SprintTracker()
    tracker.P = root @ root.T + np.eye(9)
    before = tracker.P.copy()
    tracker.correct_yaw()
    h = np.eye(9)[2]
    information = np.linalg.inv(before) + np.outer(h, h) / SprintParams().yaw_sigma_rad ** 2
    np.testing.assert_allclose(tracker.P, np.linalg.inv(information), rtol=1e-8, atol=1e-10)


def test_a_standing_runner_keeps_his_yaw_where_riccati_says():
    """A biased gyroscope would turn by 2.3 deg in 20 s; the filter settles at bias dt / K."""
    rate, bias = 100.0, 2e-3
    params = SprintParams(
        gyro_noise_radps_rthz=1e-2, yaw_sigma_rad=0.035, remove_gyro_mean=False, align_s=0.1
    )
    tracker = SprintTracker(params)
    for k in range(2000):
        estimate = tracker.step(Sample(k / rate, G * UP, np.array([0.0, 0.0, bias])))
    q, r = params.gyro_noise_radps_rthz**2 / rate, params.yaw_sigma_rad**2
    ((p,),) = solve_discrete_are([[1.0]], [[1.0]], [[q]], [[r]])
    yaw = euler(estimate.q)[2]
    # Just after the correction: what a step's turn adds, less its share.
    assert yaw == pytest.approx(bias / rate / (p / (p + r)) * (1.0 - p / (p + r)), rel=0.02)
    assert max(map(abs, euler(estimate.q)[:2])) < 1e-4


@pytest.fixture(scope="module", params=sorted(ATHLETES))
def ran(request):
    """(run, tracker after it) for each of the three runners."""
    run = sprint(request.param, 2)
    return run, follow(run, SprintTracker())


def follow(run, tracker):
    stream = sample(run.run.trajectory, run.bar, ROLE, 2)
    rows = zip(stream.t_true_s, stream.accel_mps2, stream.gyro_radps, strict=True)
    for row in rows:
        tracker.step(Sample(*row))
    return tracker


def test_greatest_velocity_of_a_sprint_within_two_percent(ran):
    run, tracker = ran
    assert tracker.v_max_mps == pytest.approx(run.peak_mps, rel=0.02)
    assert tracker.t_max_s == pytest.approx(run.t_peak_s, abs=0.05)


def test_without_the_gyroscopes_mean_it_would_not_be():
    run = sprint("sprint_8.12", 2)
    tracker = follow(run, SprintTracker(SprintParams(remove_gyro_mean=False)))
    assert abs(tracker.v_max_mps / run.peak_mps - 1.0) > 0.02


# Vertical plane ------------------------------------------------------------------------------


def test_euler_angles_there_and_back():
    turn = Rotation.from_euler("ZYX", [0.4, -0.3, 1.1])
    q = np.roll(turn.as_quat(), 1)
    np.testing.assert_allclose(euler(q), (1.1, -0.3, 0.4), atol=1e-14)
    np.testing.assert_allclose(from_euler(1.1, -0.3, 0.4), turn.as_matrix(), atol=1e-14)


def test_bias_comes_off_the_acceleration():
    """1 m/s^2 less a bias of 0.2 for 0.1 s from 0.5 m/s: 0.58 m/s, 0.054 m."""
    tracker = PlaneTracker()
    tracker.x[:] = [0, 0, 0, 0, 0, 0.5, 0, 0, 0.2]
    tracker.predict(UP, 0.1)
    assert tracker.x[5] == pytest.approx(0.58)
    assert tracker.x[2] == pytest.approx(0.054)


def test_covariance_of_one_step_by_hand():
    """Velocity 1e-4, bias 1e-2, 0.1 s: 1e-4 + 0.01 * 1e-2 + 5e-4 * 0.1 = 2.5e-4."""
    tracker = PlaneTracker()
    tracker.predict(np.zeros(3), 0.1)
    assert tracker.P[5, 5] == pytest.approx(2.5e-4)
    assert tracker.P[8, 8] == pytest.approx(1e-2 + 1e-7)
    assert tracker.P[5, 8] == pytest.approx(-1e-3)


def test_zero_velocity_as_sure_as_the_filter_halves_it_and_teaches_the_bias():
    """P_vv = R = 1e-4: gain 1/2. P_bv = -5e-5: gain -1/4, so 0.1 m/s teaches 0.025 m/s^2."""
    tracker = PlaneTracker()
    tracker.x[5] = 0.1
    tracker.P[5, 8] = tracker.P[8, 5] = -5e-5
    tracker.update(slice(3, 6), np.full(3, 1e-4))
    assert tracker.x[5] == pytest.approx(0.05)
    assert tracker.x[8] == pytest.approx(0.025)
    assert tracker.P[5, 5] == pytest.approx(5e-5)
    assert tracker.P[8, 8] == pytest.approx(1e-2 - 2.5e-9 / 2e-4)


def test_the_plane_pulls_its_own_axis_only():
    tracker = PlaneTracker()
    tracker.P = np.diag([2e-3] * 9)
    tracker.x[:3] = 0.1
    tracker.update(slice(1, 2), np.array([2e-3]))
    np.testing.assert_allclose(tracker.x[:3], [0.1, 0.05, 0.1], atol=1e-15)


def test_still_takes_200_ms_and_one_loud_sample_ends_it():
    tracker, dt = PlaneTracker(), 0.01
    quiet = np.array([0.499, 0.0, 0.0]), np.array([0.0, 0.399, 0.0])
    answers = [tracker.is_still(*quiet, dt) for _ in range(25)]
    assert answers.index(True) in (19, 20)
    assert all(answers[20:])
    assert not tracker.is_still(0.501 * UP, np.zeros(3), dt)
    assert not tracker.is_still(*quiet, dt)
    assert not tracker.is_still(np.zeros(3), 0.401 * UP, dt)


@pytest.fixture(scope="module")
def plane_moves():
    tracker = PlaneTracker()
    rows = [tracker.step(one) for one in short_move(200.0, 5)]
    return [row for row in rows if row is not None]


def test_plane_tracker_holds_at_rest_and_repeats_short_moves(plane_moves):
    at_rest = [row for row in plane_moves if row.t_s < 2.0]
    assert max(float(np.linalg.norm(row.v)) for row in at_rest) < 0.01
    ends = [next(r.p[0] for r in plane_moves if r.t_s >= 4.0 + 2.0 * k - 0.02) for k in range(5)]
    lengths = np.diff([0.0, *ends])
    np.testing.assert_allclose(lengths, 0.3, atol=0.02)
    assert plane_moves[-1].still


def test_plane_tracker_learns_gravity_while_still():
    """Warmed up by 0.1 m/s^2 at rest: gravity follows with its 0.5 s."""
    tracker = PlaneTracker()
    for k in range(1000):
        warm = 0.1 if k > 200 else 0.0
        row = tracker.step(Sample(k / 200.0, (G + warm) * UP, np.zeros(3)))
    assert tracker.gravity[2] == pytest.approx(G + 0.1, abs=1e-3)
    assert abs(row.v[2]) < 2e-3


# Zero velocity -------------------------------------------------------------------------------


def test_calibration_by_hand():
    """Counts (1000, 0, 2100), x leaning 1 % into z, z off by 100, 0.5 mg a count."""
    S = np.eye(3)  # noqa: N806
    S[2, 0] = 0.01
    calibrate = Calibration(S, np.array([0.0, 0.0, 100.0]), np.full(3, 5e-4), G)
    np.testing.assert_allclose(calibrate(np.array([1000.0, 0.0, 2100.0])), [0.5 * G, 0, 1.005 * G])


def test_gravity_error_turns_towards_gravity():
    """Tilted by 0.2 rad about x and told so by nothing but gravity: decays with the gain."""
    q = np.roll(Rotation.from_rotvec([0.2, 0.0, 0.0]).as_quat(), 1)
    for _ in range(1000):
        q = ahrs_step(q, G * UP, np.zeros(3), 0.01, 0.5)
    roll = Rotation.from_quat(np.roll(q, -1)).as_rotvec()[0]
    # d(roll)/dt = -k sin(roll): tan(roll / 2) falls by exp(-k t).
    assert roll == pytest.approx(2.0 * math.atan(math.tan(0.1) * math.exp(-5.0)), rel=0.02)


def test_gyroscope_alone_turns_by_its_angle():
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(1000):
        q = ahrs_step(q, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1e-3, 0.5)
    np.testing.assert_allclose(matrix(q), Rotation.from_euler("z", 1.0).as_matrix(), atol=1e-6)


def test_recursive_least_squares_is_least_squares():
    rng = np.random.default_rng(6)
    phi, y = rng.standard_normal(50), rng.standard_normal(50)
    one = LeastSquares(0.0, P=1e9)
    for a, b in zip(phi, y, strict=True):
        one.update(a, b)
    assert one.theta == pytest.approx(float(phi @ y / (phi @ phi)), rel=1e-6)


def test_forgetting_weighs_the_past_less():
    """y = 1 then y = 3 with forgetting 0.5: (0.5 * 1 + 3) / 1.5."""
    one = LeastSquares(0.0, P=1e12, forget=0.5)
    one.update(1.0, 1.0)
    assert one.update(1.0, 3.0) == pytest.approx(3.5 / 1.5)


def test_three_quiet_samples_zero_one_axis_and_trapezoids_move_the_others():
    """From rest, 1 m/s^2 along x and 0.7 along y and z at 0.1 s: by hand."""
    tracker = ZeroVelocityTracker()
    a = np.array([1.0, 0.49, 0.7])
    for _ in range(2):
        tracker.integrate(a, 0.1)
    # The first trapezoid begins at rest: 0.05, then 0.15.
    np.testing.assert_allclose(tracker.v, 0.15 * a, atol=1e-15)
    np.testing.assert_allclose(tracker.p, (0.0025 + 0.01) * a, atol=1e-15)
    tracker.integrate(a, 0.1)
    np.testing.assert_allclose(tracker.v, [0.25, 0.0, 0.0], atol=1e-15)
    tracker.integrate(np.array([1.0, 0.6, 0.9]), 0.1)
    assert tracker.v[1] > 0.0
    assert tracker.v[2] > 0.0


def run_zero_velocity(moves: int, span_s: float = 0.4, **chosen):
    tracker = ZeroVelocityTracker(ZeroVelocityParams(**chosen))
    rows = [tracker.step(one) for one in short_move(100.0, moves, span_s)]
    return [row for row in rows if row is not None]


def test_zero_velocity_holds_at_rest_and_repeats_a_short_move_within_2_cm():
    rows = run_zero_velocity(6)
    assert all(np.all(row.v == 0.0) for row in rows if 0.6 < row.t_s < 2.0)
    ends = np.array([row.p[0] for row in rows])[
        np.searchsorted([row.t_s for row in rows], [3.9 + 2.0 * k for k in range(6)])
    ]
    lengths = np.diff([0.0, *ends])
    assert np.ptp(lengths) < 0.02
    # What begins and ends below the threshold is not counted: short by a centimetre.
    assert 0.28 < lengths.mean() < 0.3


@pytest.mark.parametrize("worse", [{"counter": 1}, {"span_s": 0.6}])
def test_a_move_is_cut_in_two_where_its_acceleration_passes_through_zero(worse):
    """With a counter of 1, and, its weakness, for any move that is not brisk: nothing is left."""
    assert run_zero_velocity(2)[-1].p[0] == pytest.approx(0.6, abs=0.03)
    assert abs(run_zero_velocity(2, **worse)[-1].p[0]) < 0.1


def test_rest_teaches_bias_or_gain():
    """2 % too long an accelerometer: as a bias of 0.196 m/s^2 upwards, or as a gain of 1 / 1.02."""
    for refine, expected in (("bias", 0.02 * G), ("gain", 1.0 / 1.02)):
        tracker = ZeroVelocityTracker(ZeroVelocityParams(refine=refine))
        for k in range(1000):
            tracker.step(Sample(k / 100.0, 1.02 * G * UP, np.zeros(3)))
        learnt = tracker.bias[2].theta if refine == "bias" else tracker.gain.theta
        assert learnt == pytest.approx(expected, rel=0.01), refine


def test_block_means_for_a_tracker_that_counts():
    class Seen:
        def __init__(self):
            self.rows = []

        def step(self, sample, others=()):
            self.rows.append(sample)

    seen = Seen()
    slower = Slower(seen, 4)
    for k in range(10):
        slower.step(Sample(float(k), k * UP, -k * UP, k == 5))
    assert [row.t_s for row in seen.rows] == [1.5, 5.5]
    np.testing.assert_allclose(seen.rows[1].accel_mps2, [0, 0, 5.5])
    np.testing.assert_allclose(seen.rows[0].gyro_radps, [0, 0, -1.5])
    assert [row.clipped for row in seen.rows] == [False, True]
