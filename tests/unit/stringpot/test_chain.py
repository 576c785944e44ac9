# SPDX-License-Identifier: Apache-2.0
"""From the ESP32's serial line to `hil truth`: every command, on a bar whose motion is known."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from esp32 import MM_PER_COUNT, OFFSET_MM, Sending, counts, lines
from typer.testing import CliRunner

from hil import timesync
from hil.cli import app
from hil.fusion.truth import lift_of
from hil.log import capture
from hil.motion.repetitions import truth
from hil.recording import load
from hil.reps import of_recording
from hil.stringpot import samples as readings
from hil.truth.reference import read
from hil.truth.score import compare
from tests.unit.fake_line import Board

CLEAN = Path(__file__).parents[3] / "fixtures/recordings/clean-7ms5/recording.mcap"
POT_BEGAN_S = 2.5
"""True time at which the ESP32's clock said 0."""


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    made = Board(tmp_path / "tty")
    yield made
    os.close(made.master)


def run(*arguments: str | Path) -> str:
    result = CliRunner().invoke(app, ["stringpot", *map(str, arguments)])
    assert result.exit_code == 0, (result.output, result.exception)
    return result.output


def bar_counts(seconds: float) -> np.ndarray:
    """What a string on the recorded bar would have said from ``POT_BEGAN_S`` on, each ms."""
    found = lift_of(load(CLEAN))
    assert found is not None
    lift, start_s, _ = found
    t_lift = POT_BEGAN_S - start_s + np.arange(round(seconds * 1000)) * 1e-3
    z = lift.trajectory.z(np.clip(t_lift, 0.0, lift.duration_s))[0]
    return counts(1000.0 * (z - z[0]) + 700.0)


def once_open(opened: Any, sending: Sending) -> Any:
    """Opens ports, and has the sender begin then: what came before is thrown away on opening."""

    @contextmanager
    def wrapped(sources: Any) -> Iterator[Any]:
        with opened(sources) as ports:
            sending.begin.set()
            yield ports

    return wrapped


def test_calibrate_log_convert_and_truth_recovers_the_offset(
    board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = load(CLEAN)
    raw = bar_counts(30.0)
    missing = frozenset(range(7000, 7004)) | {12_345}
    log, toml, out = tmp_path / "pot.mcap", tmp_path / "pot.toml", tmp_path / "pot.csv"
    # Ten times as fast as an ESP32: the reader does not look at the host's clock. The clock wraps.
    first_us = (1 << 32) - 9_000_000

    def converter(k: int) -> int | None:
        return int(raw[k]) if k < len(raw) else None

    sending = Sending(board.master, converter, first_us=first_us, speed=10.0, skip=missing)
    monkeypatch.setattr(capture, "opened", once_open(capture.opened, sending))
    with sending:
        said = run("log", "--port", board.link, "-o", log, "--duration", "4", "--csv",
                   tmp_path / "raw.csv")  # fmt: skip
    assert "0 bad lines, 5 samples lost" in said
    got = readings.of_recording(load(log))
    assert len(got) == 29_995
    assert got.lost == 5
    copy = readings.of_csv(tmp_path / "raw.csv")
    assert (copy.t_us.tolist(), copy.raw.tolist()) == (got.t_us.tolist(), got.raw.tolist())

    points = [f"{(mm - OFFSET_MM) / MM_PER_COUNT}={mm}" for mm in (0.0, 400.0, 800.0, 1200.0)]
    run("calibrate", *(f"--point={p}" for p in points), "-o", toml)
    said = run("convert", log, "--calibration", toml, "-o", out)
    assert "read 29995 samples: 5 lost" in said
    assert out.read_text().splitlines()[0] == "time_s,position_mm,velocity_mps"

    # The velocity, in m/s, is what hil truth takes of it without being told.
    reference = read(out)
    assert reference.quantity == "velocity"
    assert reference.read_as == "'time_s' in s, 'velocity_mps' in m/s"
    found = compare(of_recording(recording), reference)
    clock = timesync.analysis.analyse(recording).truth.clocks["leader"]
    a = found.alignment
    # The leader's time at that true time, by its exact clock the other way round.
    near_s = a.leader_s(np.array([a.t_mid_s]))[0] + np.array([-1.0, 1.0])
    true_s = clock.true_ns(near_s * 16e6) / 1e9
    true_leader_s = float(np.interp(POT_BEGAN_S + a.t_mid_s, true_s, near_s))
    assert a.leader_s(np.array([a.t_mid_s]))[0] == pytest.approx(true_leader_s, abs=0.002)
    assert a.sign == 1
    assert a.gain == pytest.approx(1.0, abs=0.01)
    lift, start_s, _ = lift_of(recording)
    whole = [p for p in truth(lift.trajectory) if p.t_end_s + start_s < POT_BEGAN_S + 30.0]
    assert len(found.pairs) == len([p for p in whole if p.travel_m > 0.3]) == 6
    assert not found.missed
    assert not found.invented

    result = CliRunner().invoke(app, ["truth", str(CLEAN), str(out)])
    assert result.exit_code == 0, result.output
    offset = re.search(r"leader = reference ([+-]\d+\.\d+) s", result.output)
    assert offset is not None
    assert float(offset[1]) == pytest.approx(true_leader_s - a.t_mid_s, abs=0.002)


def test_a_calibration_over_the_line(
    board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The person is played: each Enter pulls the string; the third time it slips."""
    lengths, asked = [0.0, 500.0, 1000.0], []
    state = {"mm": 0.0, "moving": 0.0}
    noise = counts(np.zeros(100_000), seed=5) - round(-OFFSET_MM / MM_PER_COUNT)

    def converter(k: int) -> int:
        state["mm"] += state["moving"]
        return int(noise[k] + (state["mm"] - OFFSET_MM) / MM_PER_COUNT)

    def enter(text: str, **_: object) -> str:
        asked.append(text)
        match = re.search(r"to (\d+) mm", text)
        assert match
        slips = len(asked) == 3
        state.update(mm=float(match[1]) - 100.0 * slips, moving=0.1 * slips)
        time.sleep(0.02)
        return ""

    monkeypatch.setattr(typer, "prompt", enter)
    toml = tmp_path / "pot.toml"
    sending = Sending(board.master, converter)
    sending.begin.set()
    with sending:
        said = run("calibrate", "--port", board.link, "--lengths", "0,500,1000", "-o", toml)
    assert len(asked) == 4
    assert "the string moved by" in said
    assert "warning" not in said
    from hil.stringpot.calibration import load as load_calibration  # noqa: PLC0415

    found = load_calibration(toml)
    assert [p.length_mm for p in found.points] == lengths
    assert found.mm_per_count == pytest.approx(MM_PER_COUNT, rel=1e-3)
    assert found.offset_mm == pytest.approx(OFFSET_MM, abs=0.5)
    assert all(600 < p.samples < 1200 for p in found.points)


def test_a_terminals_log_does_as_well_and_outside_lengths_are_said(tmp_path: Path) -> None:
    raw = bar_counts(12.0)
    path, toml, out = tmp_path / "raw.csv", tmp_path / "pot.toml", tmp_path / "out.csv"
    path.write_bytes(b"".join(lines(1000 * np.arange(len(raw)), raw)))
    run("calibrate", "--point", "2600=110", "--point", "3600=210", "-o", toml)
    said = run("convert", path, "--calibration", toml, "-o", out, "--every", "5", "--cutoff", "10")
    assert "outside of the lengths that were calibrated" in said
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert np.median(np.diff(rows[:, 0])) == pytest.approx(0.005)
    # The velocity is the slope of the position: 1 mm over 5 ms is 0.2 m/s.
    slope = np.gradient(rows[:, 1], rows[:, 0]) * 1e-3
    assert slope[5:-5] == pytest.approx(rows[5:-5, 2], abs=0.03)


@pytest.mark.parametrize(
    "arguments",
    [
        ["calibrate"],
        ["calibrate", "--point", "1=2"],
        ["calibrate", "--point", "x=2", "--point", "1=2"],
        ["calibrate", "--point", "5", "--point", "1=2"],
        ["calibrate", "--port", "/dev/ttyACM99", "--lengths", "0,1"],
        ["log", "--port", "/dev/ttyACM99"],
        ["convert", "nothing.csv"],
    ],
)
def test_what_makes_no_sense_is_an_error_in_one_sentence(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["stringpot", *arguments])
    assert result.exit_code != 0
    assert not list(tmp_path.iterdir())


def test_a_recording_without_a_string_pot_says_what_it_has(tmp_path: Path) -> None:
    with pytest.raises(readings.StringPotError, match="only leader, follower"):
        readings.of_recording(load(CLEAN))
