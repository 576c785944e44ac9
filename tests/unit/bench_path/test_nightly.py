# SPDX-License-Identifier: Apache-2.0
"""``ci/nightly``: what its exit status tells, and what it leaves behind."""

from __future__ import annotations

import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PROGRAM = """#!/bin/sh
echo "{name} $*" >> calls
mkdir -p build/runs/bench/clean && echo bytes > build/runs/bench/clean/recording.mcap
case "{name} $*" in
{answers}
esac
exit 0
"""


def nightly(folder: Path, answers: dict[str, int]) -> tuple[int, list[str]]:
    """Run a copy of the script with programs that end as told; its status and their calls."""
    (folder / "ci").mkdir()
    (folder / ".venv/bin").mkdir(parents=True)
    (folder / "boards").mkdir()
    (folder / "boards/bench.toml").write_text("format = 1\n")
    shutil.copy(ROOT / "ci/nightly", folder / "ci/nightly")
    for name in ("hil", "pytest"):
        chosen = [f'"{call}"*) exit {status};;' for call, status in answers.items()]
        program = folder / ".venv/bin" / name
        program.write_text(PROGRAM.format(name=name, answers="\n".join(chosen)))
        program.chmod(0o755)
    done = subprocess.run(
        ["bash", str(folder / "ci/nightly")], capture_output=True, timeout=60, check=False
    )
    return done.returncode, (folder / "calls").read_text().splitlines()


def test_a_sound_night_builds_flashes_and_runs_the_suite_live(tmp_path: Path) -> None:
    status, calls = nightly(tmp_path, {})
    assert status == 0
    assert calls == [
        "hil build --where",
        "hil build --target nrf52840dk",
        "hil bench flash --lock-wait 3600",
        "pytest tests/hil --board=bench --require-live --lock-wait 3600 "
        "--hil-report build/nightly/report --hil-history build/history.sqlite",
    ]
    assert not (tmp_path / "build/nightly/artefacts.tar.gz").exists()


@pytest.mark.parametrize(
    ("fails", "with_status", "status", "says", "calls"),
    [
        ("hil build --where", 2, 10, "no workspace", 1),
        ("hil build --target", 2, 1, "does not build", 2),
        ("hil bench flash", 2, 10, "could not be flashed", 3),
        ("pytest", 1, 1, "a check of the product failed", 4),
        ("pytest", 10, 10, "the rig failed", 4),
        ("pytest", 11, 11, "nothing ran live", 4),
        ("pytest", 4, 10, "pytest ended with 4", 4),
    ],
)
def test_each_failure_has_its_own_status_and_keeps_what_was_recorded(  # noqa: PLR0917
    tmp_path: Path, fails: str, with_status: int, status: int, says: str, calls: int
) -> None:
    ended, called = nightly(tmp_path, {fails: with_status})
    assert ended == status
    assert len(called) == calls
    assert says in (tmp_path / "build/nightly/verdict.txt").read_text()
    with tarfile.open(tmp_path / "build/nightly/artefacts.tar.gz") as archive:
        names = archive.getnames()
    assert "nightly/runs/clean/recording.mcap" in names
    assert "nightly/verdict.txt" in names
    assert "nightly/bench.toml" in names


def test_last_nights_recordings_are_not_taken_for_this_nights(tmp_path: Path) -> None:
    old = tmp_path / "build/runs/bench/old/recording.mcap"
    old.parent.mkdir(parents=True)
    old.touch()
    nightly(tmp_path, {"pytest": 1})
    assert not old.exists()
    assert (tmp_path / "build/nightly/runs/clean/recording.mcap").exists()


def test_the_workflow_names_each_status_of_the_script() -> None:
    script = (ROOT / "ci/nightly").read_text()
    workflow = (ROOT / "ci/nightly-workflow.yml").read_text()
    for number in ("1", "10", "11"):
        assert f"={number}" in script
        assert f"            {number}) echo" in workflow
