# SPDX-License-Identifier: Apache-2.0
"""A long run: what drifts or is lost is found, what only wobbles is not."""

from __future__ import annotations

import dataclasses
import resource
from functools import cache

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from hil.cli import app
from hil.errors import HilError
from hil.recording import Event, Recording
from hil.soak.figures import PARTS, STUDENT_T, Soak, Track, figures, trend
from hil.soak.memory import rss_kib
from hil.streams import frames
from hil.synthesis import Plan, save, synthesise
from hil.timesync import analyse

LONG_S = 1900.0
DICE = np.random.default_rng(5)


@cache
def sound() -> Recording:
    return synthesise(Plan(duration_s=LONG_S, conn_interval_us=200_000))


def with_memory(kib_at_end: int) -> Recording:
    events = tuple(
        Event(
            round(t * 1e9),
            "rig",
            "",
            {"rss_kib": round(70_000 + (kib_at_end - 70_000) * t / LONG_S)},
        )
        for t in np.linspace(0.0, LONG_S, 60)
    )
    return dataclasses.replace(sound(), events=events)


def row(found: Soak, name: str) -> bool | None:
    (one,) = (row for row in found.rows if row.track.name == name)
    return None if one.trend is None else one.trend.drifts


def test_a_sound_run_is_flat_and_loses_nothing() -> None:
    found = figures(with_memory(70_100))
    assert found.sound
    assert row(found, "memory of the rig") is False
    assert row(found, "sync error, rms") is False
    assert row(found, "stack left, leader") is False
    assert not any(found.losses.values())


def test_a_leak_of_the_rig_is_found() -> None:
    found = figures(with_memory(90_000))
    assert row(found, "memory of the rig") is True
    assert not found.sound


def planted(role: str, message: str, field: str, by: np.ndarray) -> Recording:
    """The sound run with ``by`` (from 0 to 1 of the run) added to a field."""
    recording = dataclasses.replace(sound())
    of = frames(recording, role, message)
    share = np.linspace(0.0, 1.0, of.size)
    changed = of.copy()
    changed[field] = of[field] + np.interp(share, np.linspace(0.0, 1.0, by.size), by).astype(int)
    decoded = recording.decoded(role)
    object.__setattr__(
        recording,
        "decoded",
        lambda r: (
            dataclasses.replace(decoded, messages={**decoded.messages, message: changed})
            if r == role
            else sound().decoded(r)
        ),
    )
    return recording


@pytest.mark.parametrize(
    ("role", "field", "by", "name"),
    [
        ("leader", "heap_used_b", np.array([0.0, 500.0]), "heap in use, leader"),
        ("follower", "stack_free_min_b", np.array([600.0, 0.0]), "stack left, follower"),
    ],
)
def test_a_leak_of_a_node_is_found(role: str, field: str, by: np.ndarray, name: str) -> None:
    found = figures(planted(role, "system", field, by))
    assert row(found, name) is True
    assert not found.sound


def test_memory_given_back_is_no_leak() -> None:
    found = figures(planted("leader", "system", "heap_used_b", np.array([500.0, 0.0])))
    assert row(found, "heap in use, leader") is False


def test_what_is_lost_counts_also_across_a_reset_of_the_counter() -> None:
    found = figures(
        planted("leader", "link_stats", "batches_lost", np.array([0.0, 0.0, 3.0, 3.0, 0.0, 2.0]))
    )
    assert found.losses["batches_lost, leader"] == 5
    assert not found.sound


def test_the_interval_is_that_of_a_line_through_the_parts() -> None:
    t_s = np.linspace(0.0, 7200.0, 24_000, endpoint=False)
    value = 100.0 + 3.0 * t_s / 7200.0 + DICE.normal(0.0, 20.0, t_s.size)
    found = trend(Track("x", "1", t_s, value, 1.0), 7200.0)
    assert found is not None
    means = value.reshape(PARTS, -1).mean(axis=1)
    line = stats.linregress((np.arange(PARTS) + 0.5) / PARTS, means)
    assert found.change == pytest.approx(line.slope)
    assert found.half_width == pytest.approx(stats.t.ppf(0.975, PARTS - 2) * line.stderr, rel=1e-3)
    assert pytest.approx(stats.t.ppf(0.975, PARTS - 2), abs=1e-3) == STUDENT_T
    assert found.drifts


def test_noise_alone_seldom_counts_as_a_drift() -> None:
    t_s = np.linspace(0.0, 7200.0, 2400, endpoint=False)
    found = [
        trend(Track("x", "1", t_s, DICE.normal(0.0, 1.0, t_s.size), 0.0), 7200.0)
        for _ in range(400)
    ]
    # 5 % by construction of the interval; 400 draws: within 2.5 and 7.5 % but once in 50.
    assert 10 <= sum(one is not None and one.drifts for one in found) <= 30


def test_a_growing_sync_error_is_found() -> None:
    t_s = np.linspace(0.0, LONG_S, 5000, endpoint=False)
    grows = DICE.normal(0.0, 1.0, t_s.size) * (30.0 + 10.0 * t_s / LONG_S)
    found = trend(Track("sync error, rms", "ns", t_s, grows, 3.5, rms=True), LONG_S)
    assert found is not None
    assert found.drifts


def test_a_gap_leaves_it_open() -> None:
    t_s = np.linspace(0.0, 600.0, 500)
    assert trend(Track("x", "1", t_s, t_s, 1.0), LONG_S) is None


def test_short_recordings_are_refused_with_the_mend() -> None:
    with pytest.raises(HilError, match="trends need 1800 s") as caught:
        figures(synthesise(Plan(duration_s=5)))
    assert "soak.toml" in caught.value.mend


def test_the_command_shows_hours_and_verdicts(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("soak") / "long.mcap"
    save(sound(), path)
    said = CliRunner().invoke(app, ["soak", str(path)])
    assert said.exit_code == 0, said.output
    assert "hour 1" in said.output
    assert "flat" in said.output
    assert "lost: nothing" in said.output


def test_the_memory_of_this_process_is_that_of_the_kernel() -> None:
    # The peak is at least what there is now.
    assert 1000 < rss_kib() <= resource.getrusage(resource.RUSAGE_SELF).ru_maxrss + 1024
    assert len(analyse(sound()).pairs) > 4000
