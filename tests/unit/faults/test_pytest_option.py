# SPDX-License-Identifier: Apache-2.0
"""``pytest --inject``: the suite with a fault put into what it judges."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hil import synthesis

pytest_plugins = ["pytester"]

SUITE = """
from hil import checks

def test_link(recording, measure):
    measure(m for m in checks.suite(recording, "link") if m.name == "link.frame_crc_errors")
"""


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    synthesis.save(synthesis.synthesise(), folder / "recording.mcap")
    return folder


def run(pytester: pytest.Pytester, *arguments: str | Path) -> pytest.RunResult:
    pytester.makepyfile(SUITE)
    return pytester.runpytest_inprocess("-p", "no:cacheprovider", *arguments)


def test_the_fault_is_caught_and_told(pytester: pytest.Pytester, good: Path) -> None:
    run(pytester, "--recording", good).assert_outcomes(passed=1)
    fault = ("--inject", "corrupt:leader=1e-3")
    found = run(pytester, "--recording", good, *fault, "--hil-report", "out")
    found.assert_outcomes(failed=1)
    found.stdout.fnmatch_lines(["FAIL link.frame_crc_errors: *limit <= 0*error budget L2*"])
    (entry,) = json.loads((pytester.path / "out/report.json").read_text())["recordings"]
    assert entry["injected"] == (
        "faults were injected: a share of 0.001 of the bytes of the leader has a bit turned over"
    )


def test_a_fault_that_nothing_notices_is_no_success(pytester: pytest.Pytester, good: Path) -> None:
    # Of some 1e5 bytes none is hit.
    found = run(pytester, "--recording", good, "--inject", "corrupt=1e-15")
    found.assert_outcomes(passed=1)
    assert found.ret == 1
    found.stdout.fnmatch_lines(["*no check noticed the faults injected into*"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gremlins", "no fault is called 'gremlins'"),
        ("drop=2", "2 is not a share, 0 to 1"),
        ("storm=3@1..2", "cannot be injected into a recording made earlier"),
    ],
)
def test_what_is_no_fault_of_this_run_is_refused(
    pytester: pytest.Pytester, good: Path, text: str, said: str
) -> None:
    found = run(pytester, "--recording", good, "--inject", text)
    assert found.ret == pytest.ExitCode.USAGE_ERROR
    assert said in found.stderr.str()
    assert "Traceback" not in found.stderr.str()
