# SPDX-License-Identifier: Apache-2.0
"""Faults of the nodes themselves, on the simulated radio: the rows of the table that are live."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from hil import checks, scenario
from hil.backends.sim import SimBackend
from hil.build import Manifest
from hil.errors import ScenarioError
from hil.faults import parse_all
from hil.faults.table import ROWS
from hil.measure import Measurement
from hil.recording import Recording

CALIBRATED = {"gyro_offset_dps": [0.1, -0.1, 0.05]}


def run(
    images: Mapping[str, Manifest], folder: Path, duration_s: float, *faults: str
) -> tuple[Recording, dict[str, Measurement]]:
    """Two nodes on a bar that lies still, the leader with a calibration in its flash."""
    nodes: dict[str, Any] = {
        "leader": {
            "drift_ppm": 13.7,
            "start_offset_us": 30303,
            "imu": {"odr_error": -0.068, "errors": "uncalibrated"},
            "calibration": CALIBRATED,
        },
        "follower": {
            "drift_ppm": -31.1,
            "start_offset_us": 70707,
            "imu": {"odr_error": 0.031},
        },
    }
    plan = scenario.from_mapping(
        {
            **{"name": "faults", "duration_s": duration_s, "seed": 23, "nodes": nodes},
            "motion": {"lift": "still"},
            "inject": [one.to_mapping() for one in parse_all(faults)],
        },
        "test",
    )
    recording = SimBackend(images=images).run(plan, folder / "run.mcap", lambda *_: None)
    return recording, {m.name: m for m in checks.evaluate(recording)}


def caught_by(kind: str) -> tuple[str, tuple[str, ...]]:
    """The fault of a live row, and the checks that must catch it."""
    (row,) = (r for r in ROWS if r.live and parse_all([r.inject])[0].kind == kind)
    return row.inject, row.caught_by


def test_without_a_fault_these_checks_pass(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    _, found = run(images, tmp_path, 8.0)
    for row in ROWS:
        if row.live:
            assert all(found[name].verdict.ok for name in row.caught_by), row.inject


def test_a_storm_and_turned_bits_are_caught(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    """Both in one run: neither hides the other."""
    storm, broken = caught_by("storm")
    flash, refused = caught_by("flash")
    recording, found = run(images, tmp_path, 12.0, storm, flash)
    for name in (*broken, *refused):
        assert not found[name].verdict.ok, name
    assert recording.provenance.injected == ("storm", "flash")
    assert [e.kind for e in recording.events].count("disconnect") == 0


def test_an_absent_follower_is_caught(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    absent, names = caught_by("absent")
    recording, found = run(images, tmp_path, 8.0, absent)
    assert recording.serial["follower"].data.size == 0
    assert recording.serial["leader"].data.size > 100_000
    for name in names:
        assert not found[name].verdict.ok, name


def test_bits_of_nothing_cannot_be_turned(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="no calibration in the follower's flash"):
        run(images, tmp_path, 8.0, "flash:follower=1")
