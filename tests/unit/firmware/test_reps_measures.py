# SPDX-License-Identifier: Apache-2.0
"""The REP frames' measurements: unset without them, passed by right ones, failed by wrong ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hil.measure import Measurement, Verdict
from hil.recording import load
from hil.reps import measures, of_recording
from hil.reps.online import detected
from hil.streams import conditions, frames
from hil.wire.messages import BY_NAME

CLEAN = Path(__file__).parents[3] / "fixtures/recordings/clean-7ms5/recording.mcap"


def measured(monkeypatch: pytest.MonkeyPatch, sent: Any, table: Any) -> dict[str, Measurement]:
    """Of a sound recording, as if its leader had the table and had sent these frames."""
    recording = load(CLEAN)
    monkeypatch.setattr(measures, "table", lambda *_: table)
    monkeypatch.setattr(
        measures, "frames", lambda r, role, name: sent if name == "rep" else frames(r, role, name)
    )
    return {m.name: m for m in measures.measure(recording, conditions(recording))}


def test_without_rep_in_the_table_it_is_unset(monkeypatch: pytest.MonkeyPatch) -> None:
    old = {name: message for name, message in BY_NAME.items() if name != "rep"}
    found = measured(monkeypatch, None, old)
    assert [m.verdict for m in found.values()] == [Verdict.UNSET]
    assert "record anew" in found["ekf.rep_frames_wrong"].how


def test_right_frames_pass_and_wrong_ones_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    (trace,) = of_recording(load(CLEAN))
    right = detected(trace).frames
    found = measured(monkeypatch, right, BY_NAME)
    assert [m.verdict for m in found.values()] == [Verdict.PASS, Verdict.PASS]
    # Eight benches; one of them not said.
    found = measured(monkeypatch, right[1:], BY_NAME)
    assert found["ekf.rep_frames_wrong"].value == 1.0
    assert found["ekf.rep_frames_wrong"].verdict is Verdict.FAIL
    off = right.copy()
    off["peak_mps"][3] += 1e-4
    found = measured(monkeypatch, off, BY_NAME)
    assert found["ekf.rep_velocity_error_mmps"].verdict is Verdict.FAIL


def test_no_frame_at_all_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    (trace,) = of_recording(load(CLEAN))
    found = measured(monkeypatch, detected(trace).frames[:0], BY_NAME)
    assert found["ekf.rep_frames_wrong"].value == 8.0
