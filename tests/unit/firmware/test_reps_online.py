# SPDX-License-Identifier: Apache-2.0
"""The firmware's detector of repetitions: against the definition, and by hand where it is its own.

The definition, :mod:`hil.reps.find`, shares no code with it.
"""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.core import Estimator
from hil.core.reps import CLIPPED, FOLLOWER_LOST, KEPT, STILL, Detector
from hil.motion.lifts import seeded_set
from hil.parity import batch
from hil.recording import load
from hil.reference.params import Params
from hil.reference.study import simulate
from hil.reps import Trace, of_outputs, of_recording, repetitions
from hil.reps.online import agreement, detected, latest
from hil.reps.study import asked
from hil.wire.messages import REP_FLAGS, REP_KINDS, TICK_RATE_HZ
from tests.unit.strokes import DOWN, STAND, UP
from tests.unit.strokes import strokes as at_rate

RECORDINGS = sorted((Path(__file__).parents[3] / "fixtures" / "recordings").glob("*"))
RATE_HZ = 100.0
strokes = partial(at_rate, rate_hz=RATE_HZ)
TOLERANCE_MPS = 5e-5
"""Line K9 of the error budget."""


def said(frames: np.ndarray[Any, Any]) -> list[tuple[int, str, bool]]:
    """(number, kind, correction) of each frame."""
    names = {number: name for name, number in REP_KINDS.items()}
    return [
        (int(f["number"]), names[int(f["kind"])], bool(f["flags"] & REP_FLAGS["correction"]))
        for f in frames
    ]


def assert_agrees(traces: list[Trace]) -> int:
    """Last reports of each trace are the definition's, loss and tilt too. How many there are."""
    total = 0
    for trace in traces:
        frames = detected(trace).frames
        found = repetitions(trace)
        held = agreement(frames, [found])
        assert (held.only_said, held.only_found, held.differing) == ([], [], [])
        assert len(held.pairs) == len(found.repetitions)
        total += len(held.pairs)
        if not held.pairs:
            continue
        assert held.velocity_error_mps < TOLERANCE_MPS
        assert held.figure_error["range_m"] < 1e-5
        for name in ("time_to_peak_s", "eccentric_s", "pause_s"):
            assert not held.figure_error[name] > 1e-4
        for frame, r in held.pairs:
            assert math.degrees(frame["tilt_rad"]) == pytest.approx(r.figures.tilt_deg, abs=1e-4)
        full = latest(frames)
        full = full[full["kind"] == REP_KINDS["full"]]
        assert full["full_count"].tolist() == list(range(1, len(full) + 1))
        loss = 100.0 * float(full["velocity_loss"][-1])
        assert loss == pytest.approx(found.velocity_loss_percent, abs=0.01, nan_ok=True)
    return total


@pytest.mark.parametrize("folder", RECORDINGS, ids=lambda path: path.name)
def test_on_recordings_the_last_reports_are_the_definitions(folder: Path) -> None:
    assert_agrees(of_recording(load(folder / "recording.mcap")))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("rests", [False, True])
def test_on_seeded_sets_too_and_all_are_counted(seed: int, rests: bool) -> None:
    samples = batch(*simulate(seeded_set(seed, rests), seed))
    core = Estimator(Params(), np.float32)
    outputs = core.run(samples.leader, samples.follower, samples.arrival).outputs
    assert assert_agrees(of_outputs(outputs)) == asked(seed, rests)[1]


@pytest.mark.parametrize("seed", range(60))
def test_on_random_strokes_the_last_reports_are_the_definitions(seed: int) -> None:
    """Anything may follow anything: half ways, dips, racks, long and short stands."""
    rng = np.random.default_rng(seed)
    parts = [STAND]
    for _ in range(25):
        travel = float(rng.choice([-0.6, -0.5, -0.3, -0.15, -0.06, 0.0, 0.05, 0.12, 0.3, 0.5]))
        parts.append((travel * float(rng.uniform(0.9, 1.1)), float(rng.uniform(0.25, 1.2))))
    trace = strokes(*parts, STAND)
    trace = dataclasses.replace(trace, tilt_rad=rng.normal(0.0, 0.05, len(trace.t_s)))
    assert_agrees([trace])


def test_a_disagreement_is_seen() -> None:
    trace = strokes(STAND, DOWN, UP, DOWN, UP, DOWN, UP, STAND)
    frames = detected(trace).frames.copy()
    found = [repetitions(trace)]
    assert agreement(frames, found).wrong == 0
    assert agreement(frames[1:], found).wrong == 1
    frames["kind"][0] = REP_KINDS["partial"]
    assert agreement(frames, found).differing == ["102.01 s: kind 1, said 2"]
    frames["kind"][0] = REP_KINDS["full"]
    frames["mean_mps"][1] += 1e-3
    assert agreement(frames, found).velocity_error_mps == pytest.approx(1e-3, rel=1e-2)
    frames["t_start_ticks_leader"][2] += TICK_RATE_HZ
    late = agreement(frames, found)
    assert (len(late.only_said), len(late.only_found)) == (1, 1)
    # What ends in the last half second may not have been said yet.
    assert agreement(frames[:2], found, until_s=104.0).only_found == []


def test_a_repetition_is_reported_when_the_bar_goes_down_or_has_rested() -> None:
    trace = strokes(STAND, DOWN, UP, DOWN, UP, STAND)
    reports = detected(trace)
    assert said(reports.frames) == [(1, "full", False), (2, "full", False)]
    first, second = (float(trace.t_s[k]) for k in reports.sample)
    # The bar turns at 102.8 s and passes -0.05 m/s some 20 ms later; the other one rests from
    # 104.6 s on, having fallen through 0.05 m/s some 13 ms before.
    assert 102.8 < first < 102.85
    assert second == pytest.approx(104.587 + 0.3, abs=0.02)


def test_a_zero_velocity_update_ends_the_wait() -> None:
    trace = strokes(STAND, DOWN, UP, STAND)
    trace.zupt[trace.t_s > 102.9] = True
    reports = detected(trace)
    assert float(trace.t_s[reports.sample[0]]) == pytest.approx(102.91, abs=0.011)


def test_a_jerk_corrects_the_clean_before_it() -> None:
    trace = strokes(STAND, (0.8, 0.8), STAND, (-0.25, 0.4), (0.5, 0.8), STAND)
    frames = detected(trace).frames
    assert [one for one in said(frames) if one[0] != 1] == []
    assert said(frames)[0] == (1, "full", False)
    assert frames["phases"].tolist()[0] == 1
    assert (frames["phases"][-1], said(frames)[-1]) == (2, (1, "full", True))
    assert frames["range_m"][-1] == pytest.approx(1.05, abs=0.01)


def test_leaving_the_rack_is_taken_back_when_the_set_shows_its_range() -> None:
    trace = strokes(STAND, (0.2, 0.8), STAND, DOWN, UP, DOWN, UP, STAND)
    frames = detected(trace).frames
    assert said(frames)[0] == (1, "full", False)
    assert (1, "none", True) in said(frames)
    assert sorted({number for number, _, _ in said(frames)}) == [1, 2, 3]
    assert [int(f["number"]) for f in latest(frames)] == [2, 3]


def test_from_the_floor_the_way_down_comes_as_a_correction() -> None:
    frames = detected(strokes(STAND, UP, STAND, DOWN, STAND)).frames
    assert said(frames) == [(1, "full", False), (1, "full", True)]
    assert math.isnan(frames["eccentric_s"][0])
    # 1 s less 20.28 ms at each end, where it is slower than 0.05 m/s.
    assert frames["eccentric_s"][1] == pytest.approx(0.959, abs=0.021)


def test_loss_is_against_the_fastest_full_one_so_far() -> None:
    slow, slower = (0.5, 1.0), (0.5, 1.25)
    frames = detected(strokes(STAND, DOWN, slow, DOWN, UP, DOWN, slower, STAND)).frames
    mean = frames["mean_mps"]
    assert math.isnan(frames["velocity_loss"][0])
    assert frames["velocity_loss"][1] == 0.0
    assert frames["velocity_loss"][2] == pytest.approx(1.0 - mean[2] / mean[1], abs=1e-6)


def columns(trace: Trace) -> tuple[np.ndarray[Any, Any], ...]:
    t_ticks = np.rint(trace.t_s * TICK_RATE_HZ).astype(np.int64)
    return t_ticks, trace.velocity_z_mps, trace.height_m, trace.tilt_rad


def test_sample_by_sample_is_the_same_as_at_once() -> None:
    trace = strokes(STAND, DOWN, UP, DOWN, UP, STAND)
    detector = Detector()
    t, v, h, tilt = columns(trace)
    one_by_one = [
        detector.push(t[k : k + 1], v[k : k + 1], h[k : k + 1], tilt[k : k + 1]).frames
        for k in range(len(t))
    ]
    together = detected(trace).frames
    assert np.concatenate([*one_by_one, detector.end().frames]).tobytes() == together.tobytes()


def test_a_gap_begins_another_set_and_flags_are_those_of_the_lift() -> None:
    t, v, h, tilt = columns(strokes(STAND, DOWN, UP, DOWN, UP, STAND))
    flags = np.zeros(len(t), np.uint8)
    flags[(v > 0.3) & (t < 103 * TICK_RATE_HZ)] = FOLLOWER_LOST | CLIPPED
    flags[-1] = STILL
    detector = Detector()
    frames = [detector.push(t + k * 10 * TICK_RATE_HZ, v, h, tilt, flags).frames for k in (0, 1)]
    sent = np.concatenate([*frames, detector.end().frames])
    assert sent["set"].tolist() == [0, 0, 1, 1]
    assert sent["number"].tolist() == [1, 2, 1, 2]
    both = REP_FLAGS["follower_lost"] | REP_FLAGS["clipped"]
    assert [int(f) & both for f in sent["flags"]] == [both, 0, both, 0]


def test_what_is_not_finite_is_left_out() -> None:
    t, v, h, tilt = columns(strokes(STAND, DOWN, UP, STAND))
    wrong = v.copy()
    wrong[150] = np.nan
    keep = np.arange(len(t)) != 150
    a, b = Detector(), Detector()
    given = a.push(t, wrong, h, tilt).frames
    assert given.tobytes() == b.push(t[keep], v[keep], h[keep], tilt[keep]).frames.tobytes()
    assert len(given) == 1


def test_a_hundred_repetitions_take_no_more_memory_and_are_counted() -> None:
    frames = detected(strokes(STAND, *[DOWN, UP] * 100, STAND)).frames
    assert frames["full_count"].tolist() == list(range(1, 101))
    assert KEPT < 100


def test_columns_of_different_lengths_are_refused() -> None:
    t, v, h, tilt = columns(strokes(STAND))
    with pytest.raises(ValueError, match="one row per sample"):
        Detector().push(t, v[1:], h, tilt)
