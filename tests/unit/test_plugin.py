# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin, driven through a pytest of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack, suppress
from fnmatch import fnmatch
from pathlib import Path

import pytest

from hil import synthesis
from hil.plugin import EXIT_NOT_RUN_LIVE, EXIT_RIG_FAILURE
from hil.process import turn

pytest_plugins = ["pytester"]

SUITE = """
from hil import checks

def test_pairs(recording, measure):
    measure(m for m in checks.evaluate(recording) if m.name == "sync.pairs_wrong")

def test_streams(leader, follower, images):
    assert leader.messages["hello"].size and follower.messages["hello"].size
    assert set(images) == {"leader", "follower"}
"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for name, faults in {"good": [], "swapped": ["swapped_pair"]}.items():
        (folder / name).mkdir()
        synthesis.save(synthesis.synthesise(faults=faults), folder / name / "recording.mcap")
    return folder


def run(pytester: pytest.Pytester, *args: str | Path) -> pytest.RunResult:
    return pytester.runpytest_inprocess("-p", "no:cacheprovider", *args)


def test_inert_in_a_project_that_asks_for_nothing(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_one(): pass")
    result = run(pytester)
    result.assert_outcomes(passed=1)
    result.stdout.no_fnmatch_line("*hil:*")


def test_a_project_keeps_its_own_fixture_of_the_same_name(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        "import pytest\n@pytest.fixture\ndef recording(): return 7\n"
        "def test_one(recording): assert recording == 7"
    )
    run(pytester).assert_outcomes(passed=1)


def test_replays_the_recordings_named(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile(SUITE)
    result = run(pytester, "--recording", recordings / "good", "-v")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*test_pairs?replay:good? PASSED*"])


def test_a_failed_check_is_named_with_value_limit_and_budget(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    pytester.makepyfile(SUITE)
    result = run(pytester, "--recording", recordings / "swapped")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["FAIL sync.pairs_wrong: *limit <= 0*error budget P1*"])


def test_replays_the_folder_by_default(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile(SUITE)
    pytester.makeini(f"[pytest]\nhil_recordings = {recordings}")
    run(pytester).assert_outcomes(passed=3, failed=1)


def test_environment_stands_in_for_the_option(
    pytester: pytest.Pytester, recordings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytester.makepyfile(SUITE)
    monkeypatch.setenv("HIL_RECORDING", str(recordings / "good"))
    run(pytester).assert_outcomes(passed=2)


def test_report_is_written(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile(SUITE)
    run(pytester, "--recording", recordings / "good", "--hil-report", "out")
    assert {p.name for p in (pytester.path / "out").iterdir()} >= {
        "report.json",
        "junit.xml",
        "index.html",
    }


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["--board=sims"], "*--board=sims: no such source; use --board=sim or --board=bench*"),
        (["--board"], "*--board=bench needs*boards/bench.toml, which does not exist*"),
        (["--board=sim", "--recording", "x"], "*give one of them*"),
        (["--record", "x"], "*--record keeps a live run: add --board=sim*"),
        (["--recording", "absent"], "*no recording at absent*"),
        ([], "*nothing to judge: no recording in*"),
        (["--board=sim"], "*no scenario in*"),
    ],
)
def test_wrong_use_is_an_error_that_says_what_to_do(
    pytester: pytest.Pytester, args: list[str], says: str
) -> None:
    pytester.makepyfile(SUITE)
    result = run(pytester, *args)
    assert result.ret != 0
    assert " passed" not in result.stdout.str()
    assert any(fnmatch(line, says) for line in [*result.stdout.lines, *result.stderr.lines])


def test_a_test_path_taken_for_the_board_is_explained(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=SUITE)
    result = run(pytester, "--board", "test_it.py")
    result.stderr.fnmatch_lines(["*did you mean: --board=bench test_it.py*"])


def test_require_live_refuses_a_replay(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile(SUITE)
    result = run(pytester, "--recording", recordings / "good", "--require-live")
    assert result.ret == EXIT_NOT_RUN_LIVE
    result.stdout.fnmatch_lines(["*not run live*"])


def test_a_rig_failure_is_an_error_with_its_own_exit_code(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    pytester.makepyfile(SUITE)
    broken = pytester.path / "broken.mcap"
    broken.write_bytes(b"not a recording")
    result = run(pytester, "--recording", broken)
    assert result.ret == EXIT_RIG_FAILURE
    result.assert_outcomes(errors=2)
    result.stdout.fnmatch_lines(["*rig failure: replay:*"])


def test_source_marker_chooses_and_is_validated(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    pytester.makepyfile(
        "import pytest\n@pytest.mark.hil_source('sim')\ndef test_one(recording): pass"
    )
    result = run(pytester, "--recording", recordings / "good", "-rs")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*for sim, this is replay*"])
    pytester.makepyfile(
        "import pytest\n@pytest.mark.hil_source('moon')\ndef test_one(recording): pass"
    )
    result = run(pytester, "--recording", recordings / "good")
    result.stderr.fnmatch_lines(["*name one or more of replay, sim, bench*"])


def test_judging_nothing_fails(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile("def test_none(measure): measure([])")
    run(pytester, "--recording", recordings / "good").assert_outcomes(failed=1)


def test_what_cannot_be_measured_is_skipped_with_the_reason(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    pytester.makepyfile(
        """
        from hil.measure import Limits, Measurement
        def test_unset(measure):
            measure(Measurement("a.b", None, "ns", Limits(), "T1", "needs the true clocks"))
        """
    )
    result = run(pytester, "--recording", recordings / "good", "-rs")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*needs the true clocks*"])


SIMULATED = """
import hil.run
from hil.recording import load

def live(*, output, progress, **options):
    assert not output.exists()
    progress(0.5, "half of it")
    return load({recording!r})

hil.run.live = live
"""
"""Stands in for a simulation, in a pytest of its own process."""


@pytest.mark.timeout(60)
def test_two_simulations_of_one_scenario_take_turns(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    """None is deleted while it is written; on a terminal the waiting and the progress are seen."""
    recording = str(recordings / "good" / "recording.mcap")
    pytester.makeconftest(SIMULATED.format(recording=recording))
    test = pytester.makepyfile(SUITE)
    (pytester.path / "clean.toml").write_text('name = "clean"\nduration_s = 10\n')
    pytester.makeini(f"[pytest]\nhil_scenarios = {pytester.path}")
    folder = pytester.path / "build" / "runs" / "sim" / "clean"
    folder.mkdir(parents=True)
    being_written = folder / "recording.mcap"
    being_written.write_bytes(b"of the other one")
    seen, untouched = b"", False
    terminal, of_child = os.openpty()
    with ExitStack() as other, os.fdopen(terminal, "rb", buffering=0) as screen:
        other.enter_context(turn(folder, pytest.fail))
        child = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--board=sim", test],
            stdout=of_child,
            env=os.environ | {"COLUMNS": "250"},
        )
        os.close(of_child)
        with child, suppress(OSError):  # EIO: the child's end of the terminal is closed.
            try:
                while piece := screen.read(4096):
                    seen += piece
                    if not untouched and b"waiting for another pytest" in seen:
                        untouched = being_written.exists()
                        other.close()
            finally:
                other.close()
    assert child.returncode == 0, seen.decode()
    assert untouched
    assert f"waiting for another pytest that is writing {folder}" in seen.decode()
    assert b" 50% half of it" in seen
    assert b"2 passed" in seen
