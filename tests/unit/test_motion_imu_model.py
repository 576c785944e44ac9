# SPDX-License-Identifier: Apache-2.0
"""The IMU model: noise density, range, quantisation, rate, clock and seeds."""

from __future__ import annotations

import numpy as np
import pytest

from hil.motion.bar import GRAVITY_MPS2, Bar
from hil.motion.imu_model import (
    IDEAL,
    UNCALIBRATED,
    ErrorSpread,
    ImuConfig,
    draw_errors,
    measure,
    sample,
)
from hil.motion.lifts import bench, drop
from hil.motion.repetitions import Concentric, concentrics, match, truth
from hil.recording import ClockModel

NOISE_ONLY = ErrorSpread(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def still(config: ImuConfig, spread: ErrorSpread, n: int = 40_000):
    rng = np.random.default_rng(5)
    force = np.tile([0.0, 0.0, GRAVITY_MPS2], (n, 1))
    t = np.arange(n) / config.rate_hz
    return measure(
        force,
        np.zeros((n, 3)),
        t,
        config=config,
        errors=draw_errors(rng, spread),
        rng=rng,
    )


@pytest.mark.parametrize(
    ("full_scale", "density_ug"), [(2, 70.0), (4, 75.0), (8, 80.0), (16, 110.0)]
)
def test_accelerometer_noise_density(full_scale, density_ug):
    config = ImuConfig(accel_fs_g=full_scale)
    stream = still(config, NOISE_ONLY)
    quantisation2 = config.accel_lsb_mps2**2 / 12.0
    noise2 = stream.accel_mps2.var(axis=0).mean() - quantisation2
    density = np.sqrt(noise2 / (config.rate_hz / 2.0)) / GRAVITY_MPS2 * 1e6
    assert density == pytest.approx(density_ug, rel=0.02)


def test_gyroscope_noise_density():
    config = ImuConfig(gyro_fs_dps=125)
    stream = still(config, NOISE_ONLY)
    density = np.degrees(stream.gyro_radps.std(axis=0).mean()) / np.sqrt(config.rate_hz / 2.0)
    assert density * 1e3 == pytest.approx(3.8, rel=0.02)


def test_ideal_chip_only_quantises():
    config = ImuConfig()
    stream = still(config, IDEAL, 100)
    assert np.abs(stream.accel_mps2 - [0.0, 0.0, GRAVITY_MPS2]).max() <= config.accel_lsb_mps2 / 2
    np.testing.assert_array_equal(stream.gyro_lsb, 0)
    np.testing.assert_allclose(stream.accel_mps2, stream.accel_lsb * config.accel_lsb_mps2)


def test_bias_walk_grows_with_the_square_root_of_time():
    spread = ErrorSpread(accel_walk_mps2_rts=1e-2, gyro_walk_radps_rts=1e-3)
    finals = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = 416 * 4
        stream = measure(
            np.zeros((n, 3)),
            np.zeros((n, 3)),
            np.arange(n) / 416.0,
            config=ImuConfig(),
            errors=draw_errors(rng, spread),
            rng=rng,
        )
        finals.append(stream.accel_bias_mps2[-1] - stream.accel_bias_mps2[0])
    assert np.std(finals) == pytest.approx(2e-2, rel=0.2)


def test_a_drop_clips_at_full_scale_and_says_so():
    lift = drop(1, reps=1)
    stream = sample(lift.trajectory, Bar(), "leader", 1)
    assert stream.accel_lsb.max() == 32767
    hits = stream.t_true_s[stream.clipped]
    assert len(hits) > 0
    assert np.abs(hits[:, None] - np.array(lift.contacts_s)).min(axis=1).max() < 0.1


def test_odr_error_and_clock_set_the_times():
    lift = bench(1, reps=1)
    clock = ClockModel(drift=50e-6, start_offset_us=2_000_000.0)
    stream = sample(
        lift.trajectory, Bar(), "leader", 1, config=ImuConfig(odr_error=-0.068), clock=clock
    )
    assert 1.0 / np.diff(stream.t_true_s).mean() == pytest.approx(416.0 * 0.932)
    node = stream.t_node_s
    assert node[0] == pytest.approx(-2.0)
    assert (node[-1] - node[0]) / (stream.t_true_s[-1]) == pytest.approx(1.0 + 50e-6, abs=1e-9)


def test_chips_differ_by_role_and_seed():
    lift = bench(1, reps=1)
    streams = [
        sample(lift.trajectory, Bar(), role, seed, spread=UNCALIBRATED)
        for role, seed in (("leader", 1), ("follower", 1), ("leader", 2), ("leader", 1))
    ]
    first = [s.gyro_bias_radps[0] for s in streams]
    assert np.abs(first[0] - first[1]).max() > 1e-4
    assert np.abs(first[0] - first[2]).max() > 1e-4
    np.testing.assert_array_equal(streams[0].accel_lsb, streams[3].accel_lsb)


@pytest.mark.parametrize(
    ("options", "says"),
    [({"accel_fs_g": 3}, "no full scale of 3 g"), ({"gyro_fs_dps": 9}, "9 dps")],
)
def test_impossible_full_scales_are_refused(options, says):
    with pytest.raises(ValueError, match=says):
        ImuConfig(**options)


def test_unknown_role_is_refused():
    with pytest.raises(ValueError, match="mounts are leader, follower"):
        sample(bench(1, reps=1).trajectory, Bar(), "third", 1)


def test_concentric_of_a_half_sine():
    """v = sin(pi t) over one second: travel 2/pi, peak 1, less what lies below 0.05 m/s."""
    t = np.arange(-0.5, 1.5, 1e-3)
    v = np.where((t > 0) & (t < 1), np.sin(np.pi * t), 0.0)
    (rep,) = concentrics(t, v)
    begin = np.arcsin(0.05) / np.pi
    assert rep.t_start_s == pytest.approx(begin, abs=1e-6)
    assert rep.t_end_s == pytest.approx(1.0 - begin, abs=1e-6)
    assert rep.peak_mps == pytest.approx(1.0, abs=1e-6)
    assert rep.t_peak_s == pytest.approx(0.5, abs=1e-4)
    travel = 2.0 / np.pi * np.cos(np.pi * begin)
    assert rep.travel_m == pytest.approx(travel, abs=1e-6)
    assert rep.mean_mps == pytest.approx(travel / (1.0 - 2.0 * begin), abs=1e-6)


def test_sway_and_cut_off_phases_are_no_repetitions():
    t = np.arange(0.0, 4.0, 1e-3)
    assert concentrics(t, 0.2 * np.sin(2 * np.pi * t)) == []
    assert concentrics(t, np.full_like(t, 0.6)) == []


def test_truth_has_the_travel_of_the_trajectory():
    lift = bench(3)
    for rep in truth(lift.trajectory):
        z = lift.trajectory.z(np.array([rep.t_start_s, rep.t_end_s]))[0]
        assert rep.travel_m == pytest.approx(z[1] - z[0], abs=1e-5)


def test_matching_pairs_by_overlap():
    def rep(a: float, b: float) -> Concentric:
        return Concentric(a, b, 0.5, 1.0, 0.5 * (a + b), 0.5)

    pairs, missed, invented = match([rep(0, 1), rep(3, 4)], [rep(0.1, 1.1), rep(6, 7)])
    assert pairs == [(rep(0, 1), rep(0.1, 1.1))]
    assert missed == [rep(3, 4)]
    assert invented == [rep(6, 7)]
