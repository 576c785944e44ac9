# SPDX-License-Identifier: Apache-2.0
"""Laws that any rigid motion obeys, held against every lift: derivatives, integrals, rigidity."""

from __future__ import annotations

import numpy as np
import pytest

from hil.motion import motion_file
from hil.motion.bar import GRAVITY_MPS2, Bar, at_point
from hil.motion.curves import Fourier, Key, Product, Spline, window
from hil.motion.imu_model import UNCALIBRATED, draw_errors
from hil.motion.lifts import LIFTS, bench, drop, named, seeded_set, touch_and_go_ten
from hil.motion.repetitions import truth

every_lift = pytest.mark.parametrize("name", sorted(LIFTS))


def off_contacts(lift, t):
    """Mask of times away from impacts, where finite differences have no meaning."""
    clear = np.ones_like(t, dtype=bool)
    for contact in lift.contacts_s:
        clear &= np.abs(t - contact) > 0.2
    return clear


@every_lift
def test_rates_are_the_derivatives_of_positions(name):
    lift = LIFTS[name](7)
    t = np.linspace(0.05, lift.duration_s - 0.05, 1500)
    h = 1e-5
    before, now, after = (lift.trajectory(t + s) for s in (-h, 0.0, h))
    clear = off_contacts(lift, t)
    velocity = (after.position_m - before.position_m) / (2 * h)
    acceleration = (after.velocity_mps - before.velocity_mps) / (2 * h)
    angular = (after.rate_radps - before.rate_radps) / (2 * h)
    np.testing.assert_allclose(velocity[clear], now.velocity_mps[clear], atol=2e-6)
    np.testing.assert_allclose(acceleration[clear], now.acceleration_mps2[clear], atol=2e-5)
    np.testing.assert_allclose(angular[clear], now.angular_accel_radps2[clear], atol=2e-4)


@every_lift
def test_orientation_turns_at_the_angular_rate(name):
    lift = LIFTS[name](8)
    t = np.linspace(0.05, lift.duration_s - 0.05, 800)
    h = 1e-5
    before, now, after = (lift.trajectory(t + s) for s in (-h, 0.0, h))
    turn = np.swapaxes(now.rotation, 1, 2) @ (after.rotation - before.rotation) / (2 * h)
    rate = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
    np.testing.assert_allclose(rate, now.rate_radps, atol=1e-6)
    identity = now.rotation @ np.swapaxes(now.rotation, 1, 2)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-12)


@pytest.mark.parametrize("role", ["leader", "follower"])
@pytest.mark.parametrize("name", ["bench", "snatch", "deadlift", "spinning"])
def test_integrating_the_specific_force_returns_the_trajectory(name, role):
    """Strapdown integration of what the ideal sensor feels, by Simpson's rule at 2 kHz."""
    lift = LIFTS[name](2)
    dt = 5e-4
    t = np.arange(0.0, lift.duration_s, dt / 2)
    point = at_point(lift.trajectory(t), Bar().mounts[role])
    force = np.einsum("nij,nj->ni", point.rotation, point.specific_force_mps2)
    a = force - np.array([0.0, 0.0, GRAVITY_MPS2])
    step = dt / 6.0 * (a[:-2:2] + 4.0 * a[1:-1:2] + a[2::2])
    velocity = point.velocity_mps[0] + np.cumsum(step, axis=0)
    np.testing.assert_allclose(velocity, point.velocity_mps[2::2], atol=2e-4)


@every_lift
def test_both_ends_agree_with_one_rigid_motion(name):
    """Distance between the ends is constant, and one end's force predicts the other's."""
    lift = LIFTS[name](5)
    t = np.linspace(0.0, lift.duration_s, 700)
    bar, motion = Bar(), lift.trajectory(t)
    mounts = bar.mounts
    leader, follower = (at_point(motion, mounts[r]) for r in ("leader", "follower"))
    distance = np.linalg.norm(leader.position_m - follower.position_m, axis=1)
    np.testing.assert_allclose(distance, 2.1, atol=1e-12)
    r = mounts["follower"].position_m - mounts["leader"].position_m
    w, alpha = motion.rate_radps, motion.angular_accel_radps2
    in_bar = [
        np.einsum("ij,nj->ni", mounts[n].rotation, p.specific_force_mps2)
        for n, p in (("leader", leader), ("follower", follower))
    ]
    predicted = in_bar[0] + np.cross(alpha, r) + np.cross(w, np.cross(w, r))
    np.testing.assert_allclose(predicted, in_bar[1], atol=1e-9)


@every_lift
def test_a_lift_is_reproducible_and_its_seeds_differ(name):
    t = np.linspace(0.0, 10.0, 50)
    one, again, other = (LIFTS[name](s).trajectory(t).position_m for s in (3, 3, 4))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 1e-3


@every_lift
def test_nothing_moves_where_the_lift_says_still(name):
    lift = LIFTS[name](11)
    for begin, end in lift.still_spans_s:
        motion = lift.trajectory(np.linspace(begin + 1e-6, end - 1e-6, 40))
        assert np.abs(motion.velocity_mps).max() < 1e-9
        assert np.abs(motion.rate_radps).max() < 1e-9


def test_bench_has_the_statistics_of_the_corpus():
    """490 mm, 1,050 mm/s; between repetitions 14 deg/s and 33 mm/s (medians over 40 sets)."""
    rate, speed, peak, travel = [], [], [], []
    for seed in range(40):
        lift = bench(seed)
        boundary = lift.trajectory(np.array(lift.turns_s[1:-1:2]))
        rate.extend(np.degrees(np.linalg.norm(boundary.rate_radps, axis=1)))
        speed.extend(np.linalg.norm(boundary.velocity_mps, axis=1))
        for rep in truth(lift.trajectory):
            peak.append(rep.peak_mps)
            travel.append(rep.travel_m)
    assert np.median(rate) == pytest.approx(14.0, abs=2.0)
    assert np.median(speed) == pytest.approx(0.033, abs=0.005)
    assert np.median(peak) == pytest.approx(1.05, abs=0.05)
    assert np.median(travel) == pytest.approx(0.49, abs=0.02)


def test_touch_and_go_has_no_still_moment_and_ten_repetitions():
    lift = touch_and_go_ten(1)
    assert len(truth(lift.trajectory)) == 10
    t = np.arange(lift.still_spans_s[0][1] + 0.3, lift.still_spans_s[-1][0] - 0.3, 1e-3)
    motion = lift.trajectory(t)
    moving = np.linalg.norm(motion.velocity_mps, axis=1) + np.linalg.norm(motion.rate_radps, axis=1)
    assert moving.min() > 1e-3


def test_a_drop_falls_freely_and_saturates():
    lift = drop(1)
    first = lift.contacts_s[0]
    falling = lift.trajectory(np.linspace(first - 0.3, first - 0.001, 100))
    np.testing.assert_allclose(falling.acceleration_mps2[:, 2], -GRAVITY_MPS2, atol=1e-6)
    hit = lift.trajectory(np.linspace(first, first + 0.02, 200))
    assert hit.acceleration_mps2[:, 2].max() > 16 * GRAVITY_MPS2


def test_all_seeded_sets_can_be_built():
    for seed in range(60):
        for rests in (True, False):
            assert seeded_set(seed, rests).duration_s > 5.0


def test_two_knots_on_a_parabola_give_that_parabola():
    curve = Spline([Key(0.0, 1.0, 2.0, -9.8), Key(0.4, 1.0 + 0.8 - 4.9 * 0.16, 2.0 - 3.92, -9.8)])
    t = np.linspace(0.0, 0.4, 9)
    np.testing.assert_allclose(curve(t)[0], 1.0 + 2.0 * t - 4.9 * t**2, atol=1e-12)


def test_product_follows_leibniz():
    both = Product(window([(0.0, 2.0)], 0.4), Fourier((0.3,), (1.7,), (0.2,)))
    t, h = np.linspace(0.1, 1.9, 50), 1e-5
    numeric = (both(t + h)[1] - both(t - h)[1]) / (2 * h)
    np.testing.assert_allclose(both(t)[2], numeric, atol=1e-6)


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: Spline([]), "at least one key"),
        (lambda: Spline([Key(1.0, 0.0), Key(1.0, 1.0)]), "must increase"),
        (lambda: window([(0.0, 0.3)], 0.2), "shorter than two ramps"),
    ],
)
def test_impossible_curves_are_refused(build, says):
    with pytest.raises(ValueError, match=says):
        build()


def test_motion_file_round_trip(tmp_path):
    lift, bar = bench(1, reps=1), Bar()
    path = tmp_path / "leader.motion"
    rows = motion_file.write(path, lift.trajectory, bar, "leader", start_s=2.0, rate_hz=500.0)
    table = motion_file.read(path)
    assert table.shape == (rows, 7)
    assert table[0, 0] == 2.0
    ideal = at_point(lift.trajectory(table[:, 0] - 2.0), bar.mounts["leader"])
    np.testing.assert_allclose(table[:, 1:4], ideal.specific_force_mps2, atol=1e-9)
    np.testing.assert_allclose(table[:, 4:7], ideal.rate_radps, atol=1e-9)


def test_motion_file_holds_the_errors_of_its_chip(tmp_path):
    lift, bar, path = bench(1, reps=1), Bar(), tmp_path / "leader.motion"
    errors = draw_errors(np.random.default_rng(5), UNCALIBRATED)
    motion_file.write(path, lift.trajectory, bar, "leader", errors=errors)
    table = motion_file.read(path)
    still = at_point(lift.trajectory(table[:1, 0]), bar.mounts["leader"])
    bias = table[0, 1:4] - errors.accel_matrix @ still.specific_force_mps2[0]
    np.testing.assert_allclose(bias, errors.accel_bias_mps2, atol=1e-12)


def raw(version=1, claimed=1, rows=((0.0,) * 7,)):
    table = np.array(rows, dtype="<f8")
    return motion_file.HEADER.pack(motion_file.MAGIC, version, claimed) + table.tobytes()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"t,x\n0,0\n", "not a motion file"),
        (raw(version=2), "version 2"),
        (raw(claimed=3), "do not hold the 3 rows"),
        (raw()[:-1], "do not hold the 1 rows"),
        (raw(claimed=2, rows=((0.0,) * 7,) * 2), "do not increase at row 1"),
    ],
)
def test_bad_motion_files_are_refused(tmp_path, data, says):
    path = tmp_path / "bad.motion"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=says):
        motion_file.read(path)


def test_unknown_mount_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no IMU 'middle'"):
        motion_file.write(tmp_path / "x.motion", bench(1, reps=1).trajectory, Bar(), "middle")


def test_no_lift_at_all_is_ten_seconds_of_rest():
    lift = named("still", 5)
    assert lift.duration_s == 10.0
    motion = lift.trajectory(np.linspace(0.0, 10.0, 101))
    assert np.ptp(motion.position_m, axis=0).max() == 0.0
    assert np.abs(motion.rate_radps).max() == 0.0
    assert lift.still_spans_s == ((0.0, 10.0),)


FORCES = pytest.mark.parametrize(
    "force", [(0.0, 0.0, GRAVITY_MPS2), (1.0, -2.0, -9.5), (GRAVITY_MPS2, 0.0, 0.0)]
)


@FORCES
def test_a_handled_bar_rocks_and_then_lies_as_it_lay(force):
    t, force = np.arange(0.0, 6.0, 1e-4), np.array(force)
    felt, rate = motion_file.handled(t, force, 5.0)
    np.testing.assert_allclose(np.linalg.norm(felt, axis=1), np.linalg.norm(force), rtol=1e-12)
    over = t >= 5.0
    np.testing.assert_allclose(felt[over], np.tile(force, (over.sum(), 1)), atol=1e-12)
    assert np.abs(rate[t > 5.001]).max() == 0.0
    # Three degrees at 1.3 Hz: 0.43 rad/s at most.
    tilt = np.degrees(np.arccos(np.clip(felt @ force / (force @ force), -1.0, 1.0)))
    assert tilt.max() == pytest.approx(3.0, abs=1e-3)
    largest = np.radians(3.0) * 2.0 * np.pi * 1.3
    assert np.linalg.norm(rate, axis=1).max() == pytest.approx(largest, rel=0.01)
    # No second in it is still enough for a boot check: 0.3 dps.
    for begin in np.arange(0.0, 4.0, 0.25):
        window = rate[(t >= begin) & (t < begin + 1.0)]
        assert np.degrees(window.std(axis=0).max()) > 3.0


@FORCES
def test_the_rate_of_a_handled_bar_is_that_of_gravity(force):
    """d up/dt = -w x up."""
    t = np.arange(0.0, 6.0, 1e-4)
    felt, rate = motion_file.handled(t, np.array(force), 5.0)
    slope = np.gradient(felt, 1e-4, axis=0)
    np.testing.assert_allclose(slope[1:-1], -np.cross(rate, felt)[1:-1], atol=2e-3)


def test_a_handled_bar_comes_before_the_set_and_joins_it(tmp_path):
    lift, bar, path = named("still", 5), Bar(), tmp_path / "motion.bin"
    motion_file.write(path, lift.trajectory, bar, "leader", start_s=3.0, handled_s=2.0)
    table = motion_file.read(path)
    assert table[0, 0] == 0.0
    rocking = np.abs(table[:, 4:]).max(axis=1) > 1e-6
    assert 1.9 < table[rocking, 0].max() <= 2.0
    lying = table[table[:, 0] >= 2.0, 1:]
    # 2e-5 rad/s of its last half of a millisecond are 1 mdps.
    np.testing.assert_allclose(lying, np.tile(lying[-1], (len(lying), 1)), atol=2e-5)
    with pytest.raises(ValueError, match="the set starts at"):
        motion_file.write(path, lift.trajectory, bar, "leader", start_s=2.0, handled_s=2.0)
