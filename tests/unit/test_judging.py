# SPDX-License-Identifier: Apache-2.0
"""Judging side by side gives what judging one after the other gives, in the same order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil import checks
from hil.errors import RecordingError
from hil.judging import judge_files
from hil.recording import load
from hil.synthesis import Plan, save, synthesise


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A longer one first, so that the shorter is ready before it."""
    folder = tmp_path_factory.mktemp("recordings")
    plan = Plan(duration_s=12.0)
    found = []
    for name, one, faults in (
        ("sound", plan, []),
        ("broken", replace(plan, duration_s=6.0), ["swapped_pair"]),
    ):
        save(synthesise(one, faults), folder / f"{name}.mcap")
        found.append(folder / f"{name}.mcap")
    return found


def test_two_processes_find_what_one_finds(files: list[Path]) -> None:
    judged = list(judge_files(files, jobs=2))
    for file, (measurements, series) in zip(files, judged, strict=True):
        recording = load(file)
        assert [m.to_json() for m in measurements] == [
            m.to_json() for m in checks.evaluate(recording)
        ]
        direct = checks.series(recording)
        assert [s.name for s in series] == [s.name for s in direct]
        assert all(
            np.array_equal(a.y, b.y, equal_nan=True) for a, b in zip(series, direct, strict=True)
        )
    failing = [{m.name for m in found if m.verdict == "fail"} for found, _ in judged]
    assert failing[0] == set()
    assert "sync.pairs_wrong" in failing[1]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_recording_that_cannot_be_read_says_so(files: list[Path], jobs: int) -> None:
    text = files[0].parent / "text.mcap"
    text.write_text("no recording")
    with pytest.raises(RecordingError) as caught:
        list(judge_files([files[1], text], jobs=jobs))
    assert "text.mcap" in str(caught.value)
    with pytest.raises(RecordingError) as direct:
        load(text)
    assert (caught.value.message, caught.value.mend) == (direct.value.message, direct.value.mend)


def test_nothing_is_nothing() -> None:
    assert list(judge_files([])) == []
