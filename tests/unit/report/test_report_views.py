# SPDX-License-Identifier: Apache-2.0
"""JUnit, terminal and page say what the document says, whatever text it holds."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hil import atomic
from hil.errors import HilError
from hil.measure import Limits, Measurement
from hil.recording import Integrity
from hil.report import NotRun, Result, build, html, junit, terminal, words, write

Make = Callable[..., Any]


class Page(HTMLParser):
    """Elements, ids and text of a page, as a browser's parser would find them."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.words = ""
        self._raw: list[str] | None = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._raw = {"script": self.scripts, "style": self.styles}.get(tag)
        if self._raw is not None:
            self._raw.append("")

    def handle_endtag(self, tag: str) -> None:
        self._raw = None

    def handle_data(self, data: str) -> None:
        if self._raw is None:
            self.words += data
        else:
            self._raw[-1] += data

    @property
    def ids(self) -> list[str]:
        return [attrs["id"] or "" for _, attrs in self.elements if "id" in attrs]

    @property
    def policy(self) -> str:
        (found,) = [
            attrs["content"]
            for tag, attrs in self.elements
            if tag == "meta" and attrs.get("http-equiv") == "Content-Security-Policy"
        ]
        assert found is not None
        return found


def text_of(document: Any, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    terminal.render(document, console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


# ---- page ------------------------------------------------------------------------------------


def test_hostile_text_stays_text(hostile: Result) -> None:
    document = build([hostile])
    page = Page(html.render(document))
    assert len(page.scripts) == 3
    assert len(page.styles) == 1
    assert not [tag for tag, _ in page.elements if tag == "img"]
    handlers = [a for _, attrs in page.elements for a in attrs if a.startswith("on")]
    assert handlers == []
    for text in ("</script><script>window.hacked=1</script>", "{{ 7*7 }}", '"><img src=x'):
        assert text in page.words
    links = [attrs["href"] or "" for tag, attrs in page.elements if tag == "a"]
    assert all(link.startswith("#") for link in links)


def test_chart_data_survive_the_island(hostile: Result) -> None:
    page = Page(html.render(build([hostile])))
    (island,) = [s for s in page.scripts if s.startswith("{")]
    labels = {line["label"] for chart in json.loads(island).values() for line in chart["limits"]}
    assert "</script><script>window.hacked=1</script>" in labels
    assert "<" not in island


def test_the_policy_admits_the_pages_own_scripts_and_nothing_else(four_runs: list[Result]) -> None:
    page = Page(html.render(build(four_runs)))
    policy = page.policy
    assert policy.startswith("default-src 'none';")
    assert "unsafe" not in policy
    assert "http" not in policy

    def digest(text: str) -> str:
        return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()

    for own in [s for s in page.scripts if not s.startswith("{")] + page.styles:
        assert f"'sha256-{digest(own)}'" in policy
    assert not [attrs for _, attrs in page.elements if "style" in attrs]


def test_the_page_loads_nothing(four_runs: list[Result]) -> None:
    page = Page(html.render(build(four_runs)))
    assert not [tag for tag, _ in page.elements if tag in ("link", "img", "iframe", "object")]
    assert not [attrs for _, attrs in page.elements if "src" in attrs]
    assert "@import" not in page.styles[0]
    assert "url(" not in page.styles[0]


def test_every_link_has_its_target_and_every_id_is_unique(four_runs: list[Result]) -> None:
    document = build([*four_runs, NotRun("idle", "sim", "no workspace")])
    page = Page(html.render(document))
    assert len(page.ids) == len(set(page.ids))
    for tag, attrs in page.elements:
        if tag == "a":
            assert (attrs["href"] or "").removeprefix("#") in page.ids
        for key in ("aria-labelledby", "aria-describedby"):
            for target in (attrs.get(key) or "").split():
                assert target in page.ids
    for entry in document["recordings"]:
        for m in entry["measurements"]:
            assert f"{entry['id']}/{m['id']}" in page.ids


def test_a_failing_run_names_check_value_limit_and_budget_line(four_runs: list[Result]) -> None:
    page = Page(html.render(build(four_runs)))
    top = page.words.partition("Runs in this report")[0]
    for part in ("sync.error_p99_ns", "41\u202f234 ± 2.1 ns", "≤ 150 ns", "T1", "made to fail"):
        assert part in top, part


def test_simulation_is_called_simulation(four_runs: list[Result]) -> None:
    words_on_page = Page(html.render(build(four_runs))).words
    assert words_on_page.lower().count("simulated radio, real firmware") >= 2 * len(four_runs)
    assert "says nothing about silicon" in words_on_page
    assert "RC oscillator" in words_on_page


def test_a_page_of_nothing_says_so() -> None:
    assert "There is no run in this report" in Page(html.render(build([]))).words


def test_traces_that_share_a_chart_must_fit(recording: Make, series: Make) -> None:
    good = [s for s in series() if s.plot == "sync.skew"]
    object.__setattr__(good[1], "y_unit", "V")
    with pytest.raises(ValueError, match="differ in y_unit"):
        html.render(build([(recording(), [], good)]))


def test_an_hour_stays_small(recording: Make, measurements: Make, series: Make) -> None:
    run = Result(recording(duration_s=3600.0), measurements(), series(duration_s=3600.0))
    document = build([run])
    assert len(html.render(document)) < 1_500_000
    assert len(json.dumps(document)) < 2_000_000


@pytest.mark.parametrize(
    ("items", "colour", "part"),
    [
        ("good", "pass", "clean-7ms5 passes."),
        ("good good", "pass", "All 2 runs pass."),
        ("good bad", "fail", "1 of 2 runs fails; 1 run passes."),
        ("good ordered", "pass", "1 run passes; 1 run fails, as it is made to."),
        ("ordered", "fail", "clean-7ms5 fails, as it is made to."),
        ("good missed", "fail", "1 run made to fail did not fail as named; 1 run passes."),
        ("good cut", "inconclusive", "The rig failed in 1 run; 1 run passes."),
        ("good unclear", "inconclusive", "1 run is inconclusive; 1 run passes."),
        ("good idle", "pass", "1 run passes; 1 run was not run live."),
        ("idle", "unset", "idle was not run live."),
        ("", "unset", "Nothing was judged."),
    ],
)
def test_headline(recording: Make, measurements: Make, items: str, colour: str, part: str) -> None:
    def limit(value: float, unsure: float = 0.0) -> list[Measurement]:
        return [Measurement("a", value, "s", Limits(high=1.0), "", "", uncertainty=unsure)]

    cut = Integrity(False, ("cut",))
    made: dict[str, Any] = {
        "good": lambda: (recording(), limit(0.5)),
        "bad": lambda: (recording(), limit(2.0)),
        "unclear": lambda: (recording(), limit(0.99, 0.1)),
        "ordered": lambda: (recording(expect_fail=("a",)), limit(2.0)),
        "missed": lambda: (recording(expect_fail=("a",)), limit(0.5)),
        "cut": lambda: (recording(integrity=cut), limit(0.5)),
        "idle": lambda: NotRun("idle", "sim", "no workspace"),
    }
    assert words.headline(build([made[i]() for i in items.split()])) == (colour, part)


# ---- JUnit -----------------------------------------------------------------------------------


def junit_of(*results: Any) -> ET.Element:
    return ET.fromstring(junit.render(build(results)))


def test_junit_of_good_and_ordered_failures(four_runs: list[Result]) -> None:
    root = junit_of(*four_runs)
    assert [s.get("name") for s in root] == [
        "clean-7ms5",
        "wander-30ms",
        "lossy-7ms5",
        "faulty-skew-sign",
    ]
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == ("48", "0", "0")
    case = root[3].find("testcase[@name='sync.error_p99_ns']")
    assert case is not None
    skipped = case.find("skipped")
    assert skipped is not None
    assert "made to" in (skipped.get("message") or "")
    properties = {p.get("name"): p.get("value") for p in case.iter("property")}
    assert properties["value"] == "41234.0"
    assert properties["unit"] == "ns"
    assert properties["limit.high"] == "150.0"
    assert properties["budget"] == "T1"
    assert properties["verdict"] == "fail"


@pytest.mark.parametrize(
    ("value", "unsure", "expect_fail", "result"),
    [
        (2.0, 0.0, (), ("failure", "fail")),
        (0.99, 0.1, (), ("failure", "inconclusive")),
        (None, 0.0, (), ("skipped", "unset")),
        (0.5, 0.0, (), None),
        (2.0, 0.0, ("a",), ("skipped", "expected")),
        (0.5, 0.0, ("a",), ("failure", "missed")),
        (None, 0.0, ("a",), ("failure", "missed")),
    ],
)
def test_junit_verdicts(
    recording: Make,
    value: float | None,
    unsure: float,
    expect_fail: tuple[str, ...],
    result: tuple[str, str] | None,
) -> None:
    m = Measurement("a", value, "s", Limits(high=1.0), "T6", "how", uncertainty=unsure)
    (suite,) = junit_of((recording(expect_fail=expect_fail), [m]))
    (case,) = suite.findall("testcase")
    found = [(e.tag, e.get("type")) for e in case if e.tag != "properties"]
    assert found == ([result] if result else [])


def test_junit_names_a_check_that_should_have_failed_and_was_not_there(recording: Make) -> None:
    (suite,) = junit_of((recording(expect_fail=("gone",)), []))
    assert suite.get("failures") == "1"
    assert suite.find("testcase[@name='gone']/failure") is not None


def test_junit_of_a_broken_rig_and_a_run_that_did_not_run(recording: Make) -> None:
    broken, idle = junit_of(
        Result(recording(), [], rig_failure="leader died"), NotRun("idle", "sim", "no workspace")
    )
    assert (broken.get("errors"), idle.get("skipped")) == ("1", "1")
    error = broken.find("testcase/error")
    assert error is not None
    assert error.get("message") == "leader died"


def test_junit_is_xml_whatever_the_text(hostile: Result) -> None:
    (suite,) = junit_of(hostile)
    assert len(suite.findall("testcase")) == len(hostile.measurements) + 1


# ---- terminal --------------------------------------------------------------------------------


def test_terminal_says_every_verdict_without_colour(four_runs: list[Result]) -> None:
    text = text_of(build(four_runs))
    for expected in ("✓ Pass", "▲ Marginal", "✗ Fail", "– Not measured", "made to fail"):
        assert expected in text
    assert "simulated radio, real firmware" in text
    last_lines = text.strip().splitlines()[-3:]
    assert "faulty-skew-sign: sync.error_p99_ns is 41\u202f234 ± 2.1 ns" in last_lines[0]
    assert "limit ≤ 150 ns, error budget T1" in last_lines[0]
    assert last_lines[2] == "✓ 3 runs pass; 1 run fails, as it is made to."


@pytest.mark.parametrize("width", [40, 80, 200])
def test_terminal_shows_text_as_text_at_any_width(hostile: Result, width: int) -> None:
    text = text_of(build([hostile]), width)
    assert "[red]not" in text
    assert "\x1b" not in text
    assert max(len(line) for line in text.splitlines()) <= width


def test_terminal_shows_a_manifest() -> None:
    console = Console(file=io.StringIO(), width=100, color_system=None)
    manifest = {"role": "leader", "files": {"hex": {"sha256": "ab" * 32}}, "dirty": None}
    terminal.render_manifest(manifest, console)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert re.search(r"role\s+leader", text)
    assert "ab" * 32 in text


# ---- files -----------------------------------------------------------------------------------


def test_the_files_of_a_report(four_runs: list[Result], tmp_path: Path) -> None:
    document = build(four_runs)
    folder = tmp_path / "a" / "b"
    write(document, folder)
    assert sorted(p.name for p in folder.iterdir()) == [
        "badge.json",
        "index.html",
        "junit.xml",
        "report.json",
    ]
    assert json.loads((folder / "report.json").read_text(encoding="utf-8")) == document
    ET.parse(folder / "junit.xml")
    assert (folder / "index.html").read_text(encoding="utf-8") == html.render(document)
    assert (folder / "index.html").stat().st_mode & 0o444 == 0o444


def test_hostile_text_can_be_written(hostile: Result, tmp_path: Path) -> None:
    write(build([hostile]), tmp_path)


def test_a_failure_leaves_the_earlier_report(
    four_runs: list[Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(build(four_runs[:1]), tmp_path)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def broken(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "replace", broken)
    with pytest.raises(HilError, match="No space left on device"):
        write(build(four_runs), tmp_path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_place_that_cannot_be_written_is_named(four_runs: list[Result], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(HilError, match="file: the report cannot be written") as caught:
        write(build(four_runs[:1]), tmp_path / "file")
    assert caught.value.mend
