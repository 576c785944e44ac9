# SPDX-License-Identifier: Apache-2.0
"""The command line as a person calls it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hil import synthesis


def hil(*args: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "from hil.cli import main; main()", *map(str, args)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for name, faults in {"good": [], "swapped": ["swapped_pair"]}.items():
        (folder / name).mkdir()
        synthesis.save(synthesis.synthesise(faults=faults), folder / name / "recording.mcap")
    return folder


def test_replay_prints_every_measurement(recordings: Path) -> None:
    result = hil("replay", recordings / "good")
    assert result.returncode == 0, result.stderr
    assert "sync.error_p99_ns" in result.stdout


def test_replay_of_a_faulty_run_exits_1_and_names_the_check(recordings: Path) -> None:
    result = hil("replay", recordings / "swapped")
    assert result.returncode == 1
    assert "sync.pairs_wrong" in result.stdout


def test_report_writes_three_views(recordings: Path, tmp_path: Path) -> None:
    result = hil("report", recordings / "good", "-o", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    document = json.loads((tmp_path / "out/report.json").read_text(encoding="utf-8"))
    assert [r["verdict"] for r in document["recordings"]] == ["pass"]
    assert (tmp_path / "out/index.html").stat().st_size > 10_000
    assert (tmp_path / "out/junit.xml").is_file()


def test_report_of_a_faulty_run_exits_1(recordings: Path, tmp_path: Path) -> None:
    result = hil("report", recordings / "swapped", "-o", tmp_path / "out")
    assert result.returncode == 1


def test_a_missing_recording_is_one_clear_message(tmp_path: Path) -> None:
    result = hil("replay", tmp_path / "absent")
    assert result.returncode == 2
    assert "no recording at" in result.stderr
    assert "Things to try" in result.stderr
    assert "Traceback" not in result.stderr


def test_record_refuses_a_name_that_is_taken(recordings: Path) -> None:
    result = hil("record", "any.toml", "-o", recordings / "good")
    assert result.returncode == 2
    assert "there is a recording at" in result.stderr


def test_record_leaves_nothing_behind_when_it_cannot_run(tmp_path: Path) -> None:
    result = hil("record", tmp_path / "absent.toml", "-o", tmp_path / "new")
    assert result.returncode == 2
    assert "cannot be read" in result.stderr
    assert not (tmp_path / "new").exists()


def test_help_of_the_whole_shows_an_example() -> None:
    result = hil("--help")
    assert result.returncode == 0
    assert "Example: hil replay" in result.stdout


@pytest.mark.parametrize("command", ["build", "record", "replay", "report"])
def test_help_shows_an_example(command: str) -> None:
    result = hil(command, "--help")
    assert result.returncode == 0
    assert f"hil {command}" in result.stdout
    assert "Example" in result.stdout
