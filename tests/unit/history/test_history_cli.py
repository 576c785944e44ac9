# SPDX-License-Identifier: Apache-2.0
"""``hil history`` and ``pytest --hil-history`` as a person calls them."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil import synthesis
from hil.history import queries
from hil.history.store import open_history
from hil.plugin import EXIT_RIG_FAILURE

pytest_plugins = ["pytester"]

Make = Callable[..., dict[str, Any]]
NAME = "sync.error_p99_ns"


def hil(folder: Path, *args: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "from hil.cli import main; main()", *map(str, args)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=folder,
    )


@pytest.fixture
def folder(tmp_path: Path, entry: Make, document: Make) -> Path:
    """A folder with the reports of 24 runs; run 12 brought a step; run 20 repeats 19 and fails."""
    values = [60.0 + n % 3 for n in range(12)] + [90.0 + n % 3 for n in range(12)]
    values[20] = 400.0
    runs = [entry(n, v, build=f"{n:04x}") for n, v in enumerate(values)]
    runs[20] = entry(20, 400.0, build="0013")
    for n, run in enumerate(runs):
        report = tmp_path / "build" / f"report-{n:02d}" / "report.json"
        report.parent.mkdir(parents=True)
        report.write_text(json.dumps(document(run)), encoding="utf-8")
    return tmp_path


def test_add_list_show_flaky_export(folder: Path) -> None:
    reports = sorted((folder / "build").glob("*/report.json"))
    first = hil(folder, "history", "add", *reports)
    assert (first.returncode, first.stderr) == (0, "")
    assert "24 new, 0 judged anew, 0 known already" in first.stdout
    again = hil(folder, "history", "add", *(r.parent for r in reports[:5]))
    assert "0 new, 0 judged anew, 5 known already" in again.stdout

    listed = hil(folder, "history", "--last", "5")
    lines = listed.stdout.splitlines()
    assert "24 runs" not in lines[0]
    assert [line.split()[3] for line in lines if " UTC " in line][:2] == ["run-23", "run-22"]
    assert "Product failure" in next(line for line in lines if "run-20" in line)
    assert "19 older runs" in listed.stdout

    shown = hil(folder, "history", "show", NAME, "--scenario", "clean").stdout
    assert "▶ Step at 2026-01-13 08:30 UTC: 61 to 91 ns, build 000c" in shown
    assert "≤ 150 ns" in shown
    assert "✗ Fail" in shown
    assert shown.count("●") == 24

    flaky = hil(folder, "history", "flaky").stdout
    assert "sync.error_p99_ns  100%" in flaky
    assert "1 fail" in flaky
    assert "1 pass" in flaky
    assert "1 of 1 check" in flaky

    exported = hil(folder, "history", "export").stdout
    table = list(csv.DictReader(io.StringIO(exported)))
    assert [float(row["value"]) for row in table][18:22] == [90.0, 91.0, 400.0, 90.0]
    assert table[20]["verdict"] == "fail"
    target = folder / "out" / "all.json"
    assert hil(folder, "history", "export", "--format", "json", "-o", target).returncode == 0
    assert [row["value"] for row in json.loads(target.read_text())][20] == 400.0


def test_errors_are_one_clear_message(folder: Path, tmp_path: Path) -> None:
    absent = hil(folder, "history")
    assert absent.returncode == 2
    assert "there is no history at build/history.sqlite" in absent.stderr
    hil(folder, "history", "add", "build/report-00")
    typo = hil(folder, "history", "show", "sync.eror_p99")
    assert typo.returncode == 2
    assert "hil history show sync.error_p99_ns" in typo.stderr
    for content, says in {
        "{": "is not JSON",
        "[]": "is not a report",
        '{"$schema": "urn:hil:report:1"}': "'schema_version' is a required property",
        '{"$schema": "urn:hil:report:1", "x": NaN}': "NaN is no JSON number",
        '{"$schema": "urn:hil:report:1", "x": 1e999}': "no number that a double can hold",
        "[" * 200_000: "is not JSON",
    }.items():
        (tmp_path / "bad.json").write_text(content)
        bad = hil(folder, "history", "add", tmp_path / "bad.json")
        assert bad.returncode == 2, content[:40]
        assert says in bad.stderr
        assert "Things to try" in bad.stderr
        assert "Traceback" not in bad.stderr


@pytest.mark.parametrize("command", ["", "add", "show", "flaky", "export"])
def test_help_shows_an_example(tmp_path: Path, command: str) -> None:
    result = hil(tmp_path, "history", *([command] if command else []), "--help")
    assert result.returncode == 0
    assert f"Example: hil history {command}".strip() in result.stdout


SUITE = """
from hil import checks

def test_pairs(recording, measure):
    measure(m for m in checks.evaluate(recording) if m.name == "sync.pairs_wrong")
"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for name, faults in {"good": [], "swapped": ["swapped_pair"]}.items():
        (folder / name).mkdir()
        synthesis.save(synthesis.synthesise(faults=faults), folder / name / "recording.mcap")
    return folder


def test_pytest_keeps_its_runs(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile(SUITE)
    ini = pytester.makeini("[pytest]\nhil_history = kept/history.sqlite")
    for name in ("good", "swapped", "good"):
        pytester.runpytest_inprocess(
            "-p", "no:cacheprovider", "-c", ini, "--recording", recordings / name
        )
    with open_history(pytester.path / "kept" / "history.sqlite") as history:
        assert sorted(run.outcome for run in queries.runs(history)) == ["pass", "product_failure"]
        (trend,) = queries.trends(history, "sync.pairs_wrong")
        assert sorted(p.verdict.value for p in trend.points) == ["fail", "pass"]


def test_pytest_names_the_default_file(pytester: pytest.Pytester, recordings: Path) -> None:
    pytester.makepyfile(SUITE)
    pytester.runpytest_inprocess(
        "-p", "no:cacheprovider", "--recording", recordings / "good", "--hil-history"
    ).assert_outcomes(passed=1)
    with open_history(pytester.path / "build" / "history.sqlite") as history:
        assert len(queries.runs(history)) == 1


def test_a_history_that_cannot_be_kept_is_the_rigs_failure(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    pytester.makepyfile(SUITE)
    (pytester.path / "bad.sqlite").write_bytes(b"no database" * 500)
    result = pytester.runpytest_inprocess(
        "-p", "no:cacheprovider", "--recording", recordings / "good", "--hil-history=bad.sqlite"
    )
    result.assert_outcomes(passed=1)
    assert result.ret == EXIT_RIG_FAILURE
    result.stdout.fnmatch_lines(["*rig failure: *bad.sqlite is damaged*"])


def test_a_check_repeated_in_a_session_never_hides_its_failure(
    pytester: pytest.Pytester, recordings: Path
) -> None:
    pytester.makepyfile(
        """
        from hil.measure import Limits, Measurement
        def judge(measure, value):
            measure(Measurement("a.b", value, "ns", Limits(high=1.0), "T1", "how"))
        def test_first(measure): judge(measure, 2.0)
        def test_again(measure): judge(measure, 0.5)
        """
    )
    result = pytester.runpytest_inprocess(
        *("-p", "no:cacheprovider", "--recording", recordings / "good"),
        *("--hil-history=h.sqlite", "--hil-report=out"),
    )
    result.assert_outcomes(passed=1, failed=1)
    report = json.loads((pytester.path / "out" / "report.json").read_text())
    assert report["recordings"][0]["outcome"] == "product_failure"
    with open_history(pytester.path / "h.sqlite") as history:
        (run,) = queries.runs(history)
    assert run.outcome == "product_failure"


def test_a_live_run_that_the_rig_failed_is_in_the_report(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hil import run  # noqa: PLC0415 (as the plugin finds it)
    from hil.errors import RigError  # noqa: PLC0415

    def broken(**_: object) -> None:
        raise RigError("the leader died", "look at it")

    monkeypatch.setattr(run, "live", broken)
    pytester.makepyfile(SUITE)
    pytester.path.joinpath("one.toml").write_text("")
    result = pytester.runpytest_inprocess(
        *("-p", "no:cacheprovider", "--board=sim", "--scenario=one.toml", "--hil-report=out"),
        "--hil-history=h.sqlite",
    )
    assert result.ret == EXIT_RIG_FAILURE
    report = json.loads((pytester.path / "out" / "report.json").read_text())
    (entry,) = report["recordings"]
    assert (entry["outcome"], entry["outcome_reason"]) == ("rig_failure", "the leader died")
    assert (entry["name"], entry["source"]) == ("one", "sim")
    with open_history(pytester.path / "h.sqlite") as history:
        assert [r.outcome for r in queries.runs(history)] == ["rig_failure"]
