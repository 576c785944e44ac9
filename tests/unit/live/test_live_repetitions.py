# SPDX-License-Identifier: Apache-2.0
"""Counting while the trace grows gives what counting at the end gives, figure by figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.core import Estimator
from hil.live.repetitions import Counter
from hil.motion.lifts import seeded_set
from hil.parity import batch
from hil.recording import Recording, load
from hil.reference.params import Params
from hil.reference.study import simulate
from hil.reps import RepetitionSet, of_outputs, of_recording, repetitions
from hil.reps.study import asked
from hil.streams import frames
from tests.unit.live.conftest import RECORDINGS

STATE = np.dtype(
    [
        ("t_ticks_leader", "<u8"),
        ("quaternion", "<f4", 4),
        ("centre_velocity_mps", "<f4", 3),
        ("centre_height_m", "<f4"),
        ("flags", "<u2"),
    ]
)
RATE_HZ = 100


def states(velocity: Sequence[float], t_s: float = 1.0) -> NDArray[Any]:
    """EKF frames of a level bar, 100 a second, with this vertical velocity."""
    rows = np.zeros(len(velocity), STATE)
    rows["t_ticks_leader"] = np.round((t_s + np.arange(len(velocity)) / RATE_HZ) * 16e6)
    rows["quaternion"][:, 0] = 1.0
    rows["centre_velocity_mps"][:, 2] = velocity
    rows["centre_height_m"] = np.cumsum(velocity) / RATE_HZ
    return rows


def still(seconds: float) -> list[float]:
    return [0.0] * round(seconds * RATE_HZ)


def stroke(metres: float, seconds: float) -> list[float]:
    """Half a sine of velocity that goes so far, up or down."""
    n = round(seconds * RATE_HZ)
    shape = np.sin(np.pi * (np.arange(n) + 0.5) / n)
    return list(metres * RATE_HZ * shape / shape.sum())


def lift(metres: float, seconds: float = 1.0) -> list[float]:
    return [*stroke(-metres, 1.0), *stroke(metres, seconds), *still(0.5)]


def sets_of(counter: Counter) -> list[RepetitionSet]:
    current = [counter.current] if counter.current.repetitions else []
    return [*counter.finished, *current]


def as_outputs(sent: NDArray[Any]) -> NDArray[Any]:
    """EKF frames as the core would have given them, with the wire's precision."""
    rows = np.zeros(len(sent), [("t_ticks", "<u8"), ("q", "<f4", 4), *STATE.descr[2:]])
    for name in rows.dtype.names or ():
        rows[name] = sent[{"t_ticks": "t_ticks_leader", "q": "quaternion"}.get(name, name)]
    return rows


def batch_sets(recording: Recording) -> list[RepetitionSet]:
    found = [repetitions(trace) for trace in of_recording(recording)]
    return [one for one in found if one.repetitions]


def test_three_hand_made_repetitions() -> None:
    """0.5 m in 1 s is 0.5 m/s; on a trace of 0.5, 0.5 and 0.25 m the last is partial."""
    counter = Counter()
    counter.take(states([*still(1.0), *lift(0.5), *lift(0.5), *lift(0.25), *still(1.0)]))
    found = counter.current
    assert (len(found.full), len(found.partial)) == (2, 1)
    assert [r.figures.mean_mps for r in found.full] == pytest.approx([0.5, 0.5], abs=0.03)
    assert found.repetitions[-1].figures.range_m == pytest.approx(0.25, abs=0.01)


def test_a_pause_of_the_estimate_ends_a_set() -> None:
    counter = Counter()
    counter.take(states([*still(0.5), *lift(0.5), *lift(0.5)]))
    counter.take(states([*still(0.5), *lift(0.5)], t_s=30.0))
    assert [len(one.full) for one in counter.finished] == [2]
    assert len(counter.current.full) == 1


def test_a_partial_repetition_becomes_full_when_the_set_shows_it() -> None:
    """The range of a set is not known at its start: what is shown may change, as at the end."""
    counter = Counter()
    counter.take(states([*still(0.5), *lift(0.3)]))
    assert (len(counter.current.full), len(counter.current.partial)) == (1, 0)
    more = [*lift(0.6), *lift(0.6), *lift(0.6)]
    counter.take(states(more, t_s=1.0 + 0.5 + 2.5))
    assert (len(counter.current.full), len(counter.current.partial)) == (3, 1)


def test_frames_without_a_number_are_skipped() -> None:
    rows = states([*still(0.5), *lift(0.5), *still(0.5)])
    rows["centre_velocity_mps"][20, 2] = np.nan
    rows["centre_height_m"][30] = np.inf
    rows["quaternion"][40] = np.nan
    counter = Counter()
    counter.take(rows)
    assert len(counter.current.full) == 1


@pytest.mark.parametrize("name", sorted(p.parent.name for p in RECORDINGS.glob("*/*.mcap")))
def test_every_recording_is_counted_as_hil_reps_does(name: str) -> None:
    recording = load(RECORDINGS / name / "recording.mcap")
    sent = frames(recording, "leader", "ekf_state")
    counter = Counter()
    for part in np.array_split(sent, 37):
        counter.take(part)
        _ = counter.current
    # Texts of floats are exact, and a NaN is equal to itself there.
    assert repr(sets_of(counter)) == repr(batch_sets(recording))


def test_at_every_moment_it_is_what_the_trace_so_far_gives(clean: Recording) -> None:
    sent = frames(clean, "leader", "ekf_state")
    counter, seen = Counter(), set()
    for end in range(0, len(sent), 61):
        counter.take(sent[max(end - 61, 0) : end])
        if end < 200:
            continue
        (trace,) = of_outputs(as_outputs(sent[:end]))
        assert repr(counter.current) == repr(repetitions(trace))
        seen.add(len(counter.current.full))
    assert seen == set(range(9))


@pytest.mark.parametrize(("seed", "rests"), [(0, False), (3, True), (5, False), (8, True)])
def test_seeded_sets(seed: int, rests: bool) -> None:
    samples = batch(*simulate(seeded_set(seed, rests), seed))
    outputs = Estimator(Params()).run(samples.leader, samples.follower, samples.arrival).outputs
    rows = np.zeros(len(outputs), STATE)
    for name in STATE.names or ():
        own = {"t_ticks_leader": "t_ticks", "quaternion": "q"}.get(name, name)
        rows[name] = outputs[own].reshape(rows[name].shape)
    counter = Counter()
    for part in np.array_split(rows, 23):
        counter.take(part)
        _ = counter.current
    found = sets_of(counter)
    whole = [repetitions(trace) for trace in of_outputs(as_outputs(rows))]
    whole = [one for one in whole if one.repetitions]
    assert repr(found) == repr(whole)
    assert sum(len(one.full) for one in found) == asked(seed, rests)[1]


def test_memory_is_bounded() -> None:
    """Two minutes at rest cost what ten seconds of lifting do; a bar that shakes is cut."""
    counter = Counter(kept_max=1500)
    counter.take(states([*still(120.0), *lift(0.5), *still(0.5)]))
    assert counter._kept < 1500
    assert len(counter.current.full) == 1 or len(counter.finished) == 1
    shaking = np.tile([*stroke(0.02, 0.2), *stroke(-0.02, 0.2)], 100)
    counter.take(states(list(shaking), t_s=700.0))
    assert counter._kept <= 1500
