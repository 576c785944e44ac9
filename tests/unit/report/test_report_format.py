# SPDX-License-Identifier: Apache-2.0
"""The published format: page and schema agree, and reports from anywhere are held against it."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hil.report import EXIT_CODES, Result, build, format_page, reading, rig, write

Make = Callable[..., Any]
ROOT = Path(__file__).parents[3]
SCHEMA = json.loads((files("hil.report") / "report.schema.json").read_text(encoding="utf-8"))


def test_the_page_is_what_the_schema_says() -> None:
    page = (ROOT / "docs" / "report-format.md").read_text(encoding="utf-8")
    assert page == format_page.render(SCHEMA)
    assert format_page.main(["--check"]) == 0


def test_every_property_of_the_schema_is_on_the_page() -> None:
    """Counted in the file's text, apart from the code that makes the page."""
    page = format_page.render(SCHEMA)
    for name, part in SCHEMA["$defs"].items():
        for key in part.get("properties", {}):
            assert f"| `{key}` |" in page, f"{name}.{key}"
    for key in ("rig.git.state", "recordings", "file.sha256", "limits.marginal", "tool.python"):
        assert f"| `{key}` |" in page, key
    for outcome, code in EXIT_CODES.items():
        assert f"| `{outcome}` | {code} |" in page
    assert "`urn:hil:report:1`" in page


def test_a_property_without_a_meaning_is_refused() -> None:
    with pytest.raises(KeyError, match="description"):
        list(format_page.rows({"properties": {"mute": {"type": "string"}}}))


def test_a_page_that_drifted_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = tmp_path / "report-format.md"
    old.write_text("what it was\n")
    monkeypatch.setattr(format_page, "PAGE", old)
    assert format_page.main(["--check"]) == 1
    assert format_page.main([]) == 0
    assert format_page.main(["--check"]) == 0


def test_the_report_names_the_rig_that_judged() -> None:
    """Against git itself, asked apart from the code under test."""

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", "-C", ROOT, *arguments], capture_output=True, text=True, check=True, timeout=20
        )
        return done.stdout.strip()

    said = build([])["rig"]
    assert said["git"]["commit"] == git("rev-parse", "HEAD")
    assert said["git"]["state"] in ("clean", "dirty")
    assert said["host"]["machine"]
    assert said["packages"]["numpy"].count(".") >= 1


def test_dirtiness_follows_the_files(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        who = ("-c", "user.name=n", "-c", "user.email=e@example.invalid")
        subprocess.run(["git", "-C", tmp_path, *who, *arguments], check=True, timeout=20)

    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    unknown = (("commit", ""), ("state", "unknown"))
    assert rig.git_state.__wrapped__(package) == unknown
    git("init", "--quiet")
    # In somebody's checkout, but no part of it.
    assert rig.git_state.__wrapped__(package) == unknown
    git("add", ".")
    git("commit", "--quiet", "-m", "one")
    clean = rig.git_state.__wrapped__(package)
    assert clean[1] == ("state", "clean")
    assert len(clean[0][1]) == 40
    (package / "__init__.py").write_text("x = 1")
    assert rig.git_state.__wrapped__(package) == (clean[0], ("state", "dirty"))


def test_attachments_have_path_size_and_hash(recording: Make, tmp_path: Path) -> None:
    folder = tmp_path / "clean-7ms5"
    folder.mkdir()
    (folder / "recording.mcap").write_bytes(b"bytes")
    (folder / "README.md").write_bytes(b"where from")
    document = build([(recording(path=folder / "recording.mcap"), [])])
    jsonschema.validate(document, SCHEMA)
    assert document["recordings"][0]["attachments"] == [
        {
            "kind": kind,
            "path": (folder / name).as_posix(),
            "size_bytes": len(content),
            "sha256": hashlib.sha256(content).hexdigest(),
        }
        for kind, name, content in (
            ("recording", "recording.mcap", b"bytes"),
            ("readme", "README.md", b"where from"),
        )
    ]


def test_a_report_is_read_back_without_its_series(four_runs: list[Result], tmp_path: Path) -> None:
    document = build(four_runs)
    write(document, tmp_path)
    for path in (tmp_path, tmp_path / "report.json"):
        assert reading.is_report(path)
        read = reading.load(path)
        assert [e.pop("series") for e in read["recordings"]] == [[]] * 4
        assert read["rig"] == document["rig"]
        assert read["recordings"][3] == {
            k: v for k, v in document["recordings"][3].items() if k != "series"
        }
    assert not reading.is_report(tmp_path / "recording.mcap")


def test_a_report_of_version_1_0_is_read(four_runs: list[Result]) -> None:
    old = json.loads(json.dumps(build(four_runs)))
    del old["rig"]
    for entry in old["recordings"]:
        del entry["attachments"]
    old["schema_version"] = "1.0"
    jsonschema.validate(old, SCHEMA)
    read = reading.checked(old, "old")
    assert read["rig"]["git"]["state"] == "unknown"
    assert read["recordings"][0]["attachments"] == []


def test_hostile_reports_are_refused_with_the_place(
    hostile: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = build([hostile])
    write(good, tmp_path)
    reading.load(tmp_path)
    file = tmp_path / "report.json"
    bad = json.loads(json.dumps(good))
    bad["recordings"][0]["measurements"][0]["verdict"] = "splendid"
    file.write_text(json.dumps(bad))
    with pytest.raises(
        reading.ReportError, match=r"recordings/0/measurements/0/verdict: 'splendid"
    ):
        reading.load(file)
    bad["recordings"][0]["measurements"][0]["verdict"] = "pass"
    bad["recordings"][0]["measurements"][0]["value"] = 10**30
    bad["recordings"][0]["name"] = "lone \ud800 surrogate"
    file.write_text(json.dumps(bad))
    read = reading.load(file)["recordings"][0]
    assert read["measurements"][0]["value"] == 1e30
    assert read["name"] == "lone \ufffd surrogate"
    with pytest.raises(reading.ReportError, match="cannot be read"):
        reading.load(tmp_path / "absent.json")
    monkeypatch.setattr(reading, "MAX_BYTES", 100)
    with pytest.raises(reading.ReportError, match="too many for a report"):
        reading.load(file)
