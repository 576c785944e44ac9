# SPDX-License-Identifier: Apache-2.0
"""What CI shows: job summary, badge, JUnit, exit codes; a failing recording is red in each."""

from __future__ import annotations

import html
import io
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hil import checks, synthesis
from hil.errors import HilError
from hil.recording import load
from hil.report import Result, badge, build, junit, summary, terminal, words
from hil.report import html as page

Make = Callable[..., Any]
FAULTY = Path(__file__).parents[3] / "fixtures/recordings/faulty/recording.mcap"
CHECK, LIMIT, LINE = "sync.skew_error_ppb", "≤ 200 ppb", "T5"
"""What the scenario of the recording breaks, its limit in docs/error-budget.md, and the line."""


@pytest.fixture(scope="module")
def failing() -> dict[str, Any]:
    """The report of the faulty recording as if nobody had ordered the fault."""
    recording = load(FAULTY)
    scenario = {**recording.provenance.scenario, "expect_fail": []}
    unordered = replace(recording, provenance=replace(recording.provenance, scenario=scenario))
    return build([Result(unordered, checks.evaluate(recording), checks.series(recording))])


@pytest.fixture(scope="module")
def value(failing: dict[str, Any]) -> str:
    """The measured value, in ppb to four digits, worked out apart from the report's own words."""
    (found,) = [m for m in failing["recordings"][0]["measurements"] if m["name"] == CHECK]
    assert found["unit"] == "ppb"
    assert found["value"] > 10_000  # the sign of a skew of some 45 ppm is wrong: twice that
    digits = str(round(found["value"]))
    return f"{digits[:-3]}\u202f{digits[-3:]} ppb"


def test_the_summary_is_red_and_names_the_check(failing: dict[str, Any], value: str) -> None:
    text = html.unescape(summary.render(failing))
    assert text.splitlines()[0] == "## ❌ faulty fails."
    (row,) = [line for line in text.splitlines() if f"| {CHECK} |" in line]
    assert [c.strip() for c in row.split("|")[1:-1]] == ["❌", CHECK, "faulty", value, LIMIT, LINE]


def test_the_badge_is_red(failing: dict[str, Any]) -> None:
    assert badge.render(failing) == {
        "schemaVersion": 1,
        "label": "hil",
        "message": "faulty fails",
        "color": "red",
        "isError": True,
    }


def test_junit_fails_and_names_the_check(failing: dict[str, Any], value: str) -> None:
    (suite,) = ET.fromstring(junit.render(failing))
    case = suite.find(f"testcase[@name='{CHECK}']")
    assert case is not None
    failure = case.find("failure")
    assert failure is not None
    message = failure.get("message") or ""
    for part in (value, LIMIT, f"error budget {LINE}"):
        assert part in message
    properties = {p.get("name"): p.get("value") for p in case.iter("property")}
    assert properties["limit.high"] == "200.0"
    assert set(properties) >= {"value", "unit", "uncertainty", "verdict", "budget", "how"}
    run = {p.get("name"): p.get("value") for p in suite.findall("properties/property")}
    assert run["attachment.recording.sha256"] == failing["recordings"][0]["file"]["sha256"]
    assert set(run) >= {"rig.commit", "rig.state", "device_id.leader", "build_id.leader"}


def test_the_terminal_is_red_and_names_the_check(failing: dict[str, Any], value: str) -> None:
    console = Console(file=io.StringIO(), width=160, force_terminal=True, color_system="standard")
    terminal.render(failing, console)
    assert isinstance(console.file, io.StringIO)
    lines = console.file.getvalue().splitlines()
    assert lines[-1] == "\x1b[1;31m✗ faulty fails.\x1b[0m"
    (line,) = [one for one in lines if f"{CHECK}\x1b" in one and "error budget" in one]
    for part in (value, LIMIT, f"error budget {LINE}", "\x1b[1;31m✗"):
        assert part in line


def test_the_page_is_red_and_names_the_check(failing: dict[str, Any], value: str) -> None:
    text = page.render(failing)
    assert '<section class="hero v-fail"' in text
    top = text.partition('<section class="failures"')[2].partition("</section>")[0]
    (row,) = [one for one in top.split("<tr>") if "skew_<wbr>error_<wbr>ppb" in one]
    for part in (value, LIMIT, LINE):
        assert part in row


def test_an_ordered_failure_says_so_and_shows_it(value: str) -> None:
    recording = load(FAULTY)
    document = build([(recording, checks.evaluate(recording))])
    text = html.unescape(summary.render(document))
    assert text.startswith("## ❌ faulty fails, as it is made to.")
    assert f"{CHECK} (made to fail) | faulty | {value} | {LIMIT} | {LINE} |" in text
    assert badge.render(document)["color"] == "red"
    assert document["outcome"] == "pass"


@pytest.mark.parametrize("verdict", words.VERDICTS)
def test_every_verdict_has_a_colour_and_a_sign(verdict: str) -> None:
    assert badge.COLOURS[verdict]
    assert summary.SIGNS[verdict]
    assert (badge.COLOURS[verdict] == "red") is (verdict == "fail")


def test_hostile_text_stays_text_in_the_summary(hostile: Result) -> None:
    text = summary.render(build([hostile]))
    for mark in ("<", ">", "`", "[", "](", "**", "\\"):
        assert mark not in text
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in tables} == {6, 7}
    assert "<script>" in html.unescape(text)


def test_a_long_summary_fits_into_what_github_takes(recording: Make, measurements: Make) -> None:
    bad = [
        replace(m, name=f"{m.name}.{n}" + "x" * 500) for n in range(120) for m in measurements(9e9)
    ]
    text = summary.render(build([(recording(), bad)]))
    assert len(text.encode()) < 2**20
    assert "more are in report.json" in text


def test_a_summary_is_appended(four_runs: list[Result], tmp_path: Path) -> None:
    document = build(four_runs)
    path = tmp_path / "new" / "summary.md"
    summary.append(document, path)
    summary.append(document, path)
    assert path.read_text(encoding="utf-8") == summary.render(document) * 2
    with pytest.raises(HilError, match="job summary cannot be written"):
        summary.append(document, tmp_path)


def hil(*args: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "from hil.cli import main; main()", *map(str, args)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for name, faults in {"good": [], "swapped": ["swapped_pair"]}.items():
        (folder / name).mkdir()
        synthesis.save(synthesis.synthesise(faults=faults), folder / name / "recording.mcap")
    whole = (folder / "good" / "recording.mcap").read_bytes()
    (folder / "cut").mkdir()
    (folder / "cut" / "recording.mcap").write_bytes(whole[: len(whole) // 2])
    return folder


@pytest.mark.parametrize(
    ("names", "code"),
    [
        (["good"], 0),
        (["swapped"], 1),
        (["cut"], 10),
        (["good", "cut"], 10),
        (["cut", "swapped"], 1),
    ],
)
def test_exit_codes(recordings: Path, tmp_path: Path, names: list[str], code: int) -> None:
    paths = [recordings / name for name in names]
    assert hil("report", *paths, "-o", tmp_path / "out").returncode == code
    assert (tmp_path / "out" / "badge.json").is_file()
    assert hil("replay", *paths).returncode == code


def test_a_report_of_nothing_run_live_has_a_code_of_its_own() -> None:
    """The document's outcome decides; the code is what docs/report-format.md publishes."""
    from hil.report import EXIT_CODES, NotRun  # noqa: PLC0415

    assert EXIT_CODES[build([NotRun("idle", "sim", "no workspace")])["outcome"]] == 11
    failed = NotRun("port", "bench", "port lost", rig_failed=True)
    assert EXIT_CODES[build([failed])["outcome"]] == 10
    assert set(EXIT_CODES.values()) == {0, 1, 10, 11}


def test_the_command_writes_summary_badge_and_history(recordings: Path, tmp_path: Path) -> None:
    by_environment, by_option = tmp_path / "step.md", tmp_path / "option.md"
    out = ("-o", tmp_path / "out", "--history", tmp_path / "h.sqlite")
    done = hil("report", recordings / "good", *out, GITHUB_STEP_SUMMARY=str(by_environment))
    assert done.returncode == 0, done.stderr
    assert by_environment.read_text(encoding="utf-8").startswith("## ✅ ")
    assert json.loads((tmp_path / "out" / "badge.json").read_text())["color"] == "brightgreen"
    hil("report", recordings / "swapped", *out, "--summary", by_option)
    assert by_option.read_text(encoding="utf-8").startswith("## ❌ ")
    listed = hil("history", "--db", tmp_path / "h.sqlite").stdout
    assert "2 runs, 1 product failure." in listed
