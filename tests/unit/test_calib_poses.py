# SPDX-License-Identifier: Apache-2.0
"""Each reason for which a pose is not taken, and live feedback on stillness."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.calibration.poses import (
    ACCEL_STD_LIMIT_MG,
    FACES,
    GYRO_STD_LIMIT_DPS,
    Block,
    Face,
    Limits,
    Pose,
    PoseCollector,
    Reason,
    Rejection,
    Stillness,
    joined,
    judge,
    moving,
    nearest_face,
)

G = 9.80665
MG = G * 1e-3
DPS = math.pi / 180.0


def block(up=(0.0, 0.0, 1.0), *, n=500, accel_mg=1.6, gyro_dps=0.06, seed=0, temperature_degc=25.0):
    """Noise as at 417 Hz and 16 g, about a direction in g."""
    rng = np.random.default_rng(seed)
    return Block(
        G * np.asarray(up) + accel_mg * MG * rng.standard_normal((n, 3)),
        0.5 * DPS + gyro_dps * DPS * rng.standard_normal((n, 3)),
        np.zeros(n, np.bool_),
        temperature_degc,
    )


def leaning(angle_deg, up=(0.0, 0.0, 1.0), towards=(1.0, 0.0, 0.0)):
    a = math.radians(angle_deg)
    return math.cos(a) * np.asarray(up) + math.sin(a) * np.asarray(towards)


def rejected(found, reason, *words):
    assert isinstance(found, Rejection), found
    assert found.reason is reason, found
    for word in words:
        assert word in found.sentence, found.sentence
    return True


def test_a_good_pose_is_the_means_of_its_block():
    b = block()
    pose = judge(b, Face.PLUS_Z)
    assert isinstance(pose, Pose)
    np.testing.assert_allclose(pose.mean, b.accel_mps2.sum(axis=0) / 500, rtol=1e-12)
    np.testing.assert_allclose(pose.std_mps2, 1.6 * MG, rtol=0.1)
    np.testing.assert_allclose(pose.gyro_mean_radps, 0.5 * DPS, rtol=0.02)
    assert (pose.n, pose.face, pose.temperature_degc) == (500, Face.PLUS_Z, 25.0)


@pytest.mark.parametrize("face", FACES)
def test_faces_are_named_by_what_they_read(face):
    sign = 1.0 if face.value[0] == "+" else -1.0
    assert face.direction["xyz".index(face.value[1])] == sign
    assert np.abs(face.direction).sum() == 1.0
    assert nearest_face(G * face.direction + [0.3, -0.2, 0.1]) is face
    assert isinstance(judge(block(face.direction), face), Pose)


def test_the_datasheets_noise_at_833_hz_is_still():
    """110 ug/rtHz and 3.8 mdps/rtHz over 833 Hz."""
    widest = {"accel_mg": 110e-3 * math.sqrt(833.0), "gyro_dps": 3.8e-3 * math.sqrt(833.0)}
    for seed in range(50):
        assert isinstance(judge(block(seed=seed, **widest), Face.PLUS_Z), Pose)


def test_wrong_side_up():
    assert rejected(
        judge(block((-1, 0, 0)), Face.PLUS_X),
        Reason.WRONG_FACE,
        "this is -x up, +x was asked: turn it over",
    )


def test_wrong_axis_up():
    assert rejected(
        judge(block((0, 1, 0)), Face.PLUS_X), Reason.WRONG_FACE, "+y up", "until +x points up"
    )


def test_tilt_is_said_in_degrees_and_has_its_limit():
    assert rejected(judge(block(leaning(14)), Face.PLUS_Z), Reason.TILTED, "14 deg", "at most 8")
    assert isinstance(judge(block(leaning(7)), Face.PLUS_Z), Pose)
    assert isinstance(judge(block(leaning(14)), Face.PLUS_Z, limits=Limits(tilt_deg=15)), Pose)


def test_free_poses_may_lean_as_they_like():
    assert isinstance(judge(block(leaning(45))), Pose)


def test_too_few_samples():
    assert rejected(judge(block(n=499), Face.PLUS_Z), Reason.TOO_FEW, "499", "500")
    assert rejected(judge(block(n=0), Face.PLUS_Z), Reason.TOO_FEW)


def test_clipped_samples():
    b = block()
    b.clipped[7:10] = True
    assert rejected(judge(b, Face.PLUS_Z), Reason.CLIPPED, "3 samples")


def test_samples_that_are_no_numbers():
    b = block()
    b.gyro_radps[3, 0] = np.nan
    assert rejected(judge(b, Face.PLUS_Z), Reason.NOT_FINITE)


def test_a_scale_that_is_out_by_two():
    assert rejected(judge(block((0, 0, 2.0)), Face.PLUS_Z), Reason.NO_GRAVITY, "2.00 g")


def test_shaking_shows_in_the_gyroscope():
    t = np.arange(500) / 417.0
    b = block()
    b.gyro_radps[:, 1] += 2.0 * DPS * np.sin(2 * np.pi * 8.0 * t)
    assert rejected(judge(b, Face.PLUS_Z), Reason.MOVING, "rate of turn varies", "let go")


def test_vibration_shows_in_the_accelerometer():
    t = np.arange(500) / 417.0
    b = block()
    b.accel_mps2[:, 0] += 20 * MG * np.sin(2 * np.pi * 30.0 * t)
    assert rejected(judge(b, Face.PLUS_Z), Reason.MOVING, "acceleration varies")


def test_a_knock_of_ten_samples_is_seen():
    """It lifts the deviation over all 500 samples to 0.28 dps only."""
    b = block()
    b.gyro_radps[200:210, 0] += 2.0 * DPS
    assert np.degrees(b.gyro_radps.std(axis=0).max()) < GYRO_STD_LIMIT_DPS
    assert rejected(judge(b, Face.PLUS_Z), Reason.MOVING)


def test_the_samples_after_the_last_whole_window_count_too():
    b = block(n=520)
    b.gyro_radps[510:, 0] += 3.0 * DPS
    assert "rate of turn varies" in moving(b)


def test_a_slow_turn_shows_in_the_drift():
    b = block()
    b.accel_mps2[:, 0] += np.linspace(0.0, 10 * MG, 500)
    assert rejected(judge(b, Face.PLUS_Z), Reason.MOVING, "turned meanwhile, by 4.9 mg")
    assert b.accel_mps2[:50].std(axis=0).max() < ACCEL_STD_LIMIT_MG * MG


def test_a_rate_that_drifts():
    b = block()
    b.gyro_radps[:, 2] += np.linspace(0.0, 0.5 * DPS, 500)
    assert rejected(judge(b, Face.PLUS_Z), Reason.MOVING, "drifted by 0.25 dps")


def test_the_same_face_is_taken_once():
    collector = PoseCollector()
    assert isinstance(collector.offer(block(), Face.PLUS_Z), Pose)
    assert rejected(
        collector.offer(block(seed=1), Face.PLUS_Z), Reason.GIVEN_TWICE, "+z up", "already"
    )
    assert collector.missing == tuple(f for f in FACES if f is not Face.PLUS_Z)
    assert len(collector.poses) == 1


def test_free_poses_must_differ_from_each_other_and_from_faces():
    collector = PoseCollector()
    collector.offer(block(), Face.PLUS_Z)
    assert rejected(
        collector.offer(block(leaning(15))), Reason.GIVEN_TWICE, "15 deg from pose 1", "20"
    )
    assert isinstance(collector.offer(block(leaning(30))), Pose)
    assert rejected(collector.offer(block(leaning(40))), Reason.GIVEN_TWICE, "10 deg from pose 2")
    # The opposite direction is no repetition.
    assert isinstance(collector.offer(block(-leaning(30))), Pose)


def test_blocks_check_their_shapes():
    with pytest.raises(ValueError, match=r"give \(n, 3\)"):
        Block(np.zeros((5, 3)), np.zeros((4, 3)))
    with pytest.raises(ValueError, match="clipped"):
        Block(np.zeros((5, 3)), np.zeros((5, 3)), np.zeros(4, np.bool_))


def test_joined_blocks_weigh_temperature_by_samples():
    parts = [block(n=100, temperature_degc=20.0), block(n=300, temperature_degc=24.0)]
    whole = joined(parts)
    assert (len(whole), whole.temperature_degc) == (400, 23.0)
    np.testing.assert_array_equal(whole.accel_mps2[100:], parts[1].accel_mps2)
    assert math.isnan(joined([block(n=5, temperature_degc=math.nan)]).temperature_degc)


def chunks(b, size):
    return [b[i : i + size] for i in range(0, len(b), size)]


@pytest.mark.parametrize("size", [1, 7, 16, 50, 333, 1000])
def test_progress_reaches_one_and_the_block_is_what_was_fed(size):
    source, stillness = block(n=500), Stillness()
    readings = [stillness.feed(chunk) for chunk in chunks(source, size)]
    progress = [r.progress for r in readings]
    assert progress == sorted(progress)
    assert all(r.state == "still" for r in readings)
    assert progress[-1] == 1.0
    if size == 50:
        np.testing.assert_allclose(progress, np.arange(1, 11) / 10)
    np.testing.assert_array_equal(stillness.block.accel_mps2, source.accel_mps2)
    assert isinstance(judge(stillness.block, Face.PLUS_Z), Pose)


def test_a_disturbance_restarts_the_count():
    source, stillness = block(n=1000), Stillness()
    source.gyro_radps[420:430, 0] += 5.0 * DPS
    readings = [stillness.feed(chunk) for chunk in chunks(source, 10)]
    assert readings[39].progress == 0.8
    assert (readings[44].state, readings[44].progress) == ("moving", 0.0)
    assert "rate of turn" in readings[44].why
    assert (readings[49].state, readings[49].progress) == ("still", 0.1)
    assert readings[93].progress < 1.0
    assert readings[94].progress == 1.0
    np.testing.assert_array_equal(stillness.block.accel_mps2, source.accel_mps2[500:])


def test_turning_it_slowly_restarts_the_count():
    source, stillness = block(n=2000), Stillness()
    source.accel_mps2[400:1200, 0] += np.linspace(0.0, 80 * MG, 800)
    source.accel_mps2[1200:, 0] += 80 * MG
    readings = [stillness.feed(chunk) for chunk in chunks(source, 50)]
    assert "turned" in " ".join(r.why for r in readings)
    assert all(r.progress < 0.9 for r in readings[10:24])
    assert readings[-1].progress == 1.0


def test_reading_has_the_newest_means():
    stillness = Stillness()
    chunk = block((0, 1, 0), n=20)
    reading = stillness.feed(chunk)
    np.testing.assert_allclose(reading.accel_mps2, chunk.accel_mps2.mean(axis=0))
    assert stillness.feed(chunk[:0]).accel_mps2 is reading.accel_mps2


def test_memory_is_bounded_and_the_newest_samples_are_kept():
    stillness = Stillness(wanted=200)
    for i in range(400):
        stillness.feed(block(n=50, seed=i))
    assert len(stillness._still) == 4
    np.testing.assert_array_equal(
        stillness.block.accel_mps2[-50:], block(n=50, seed=399).accel_mps2
    )


def test_restart_forgets():
    stillness = Stillness()
    stillness.feed(block())
    assert stillness.block is not None
    stillness.restart()
    assert stillness.block is None
    assert stillness.feed(block(n=50)).progress == 0.1
    with pytest.raises(ValueError, match="ask for 100 or more"):
        Stillness(wanted=99)
