# SPDX-License-Identifier: Apache-2.0
"""Each fault is caught by the checks that the table names, and no check is without a fault."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hil import checks
from hil.faults import KINDS, parse_all
from hil.faults import page as fault_page
from hil.faults.apply import inject
from hil.faults.table import OTHERWISE, ROWS, Row
from hil.measure import Measurement
from hil.recording import Recording
from hil.synthesis.caught_by import CAUGHT_BY

ROOT = Path(__file__).parents[3]


def suite_of(name: str) -> str:
    first = name.split(".", 1)[0]
    return "link" if first == "node" else first


@pytest.fixture(scope="module")
def without(sound: Recording) -> dict[str, Measurement]:
    """Every measurement of the recording as it is."""
    return {m.name: m for m in checks.evaluate(sound)}


def test_without_a_fault_every_check_passes(without: dict[str, Measurement]) -> None:
    assert [name for name, m in without.items() if not m.verdict.ok] == []


@pytest.mark.parametrize("row", [r for r in ROWS if not r.live], ids=lambda row: row.inject)
def test_the_fault_is_caught(row: Row, sound: Recording, without: dict[str, Measurement]) -> None:
    faulty = inject(sound, parse_all(row.inject.split()))
    found = {
        m.name: m
        for name in {suite_of(name) for name in row.caught_by}
        for m in checks.suite(faulty, name)
    }
    for name in row.caught_by:
        assert not found[name].verdict.ok, name
        assert without[name].verdict.ok, name


def test_every_kind_is_in_the_table() -> None:
    assert {one.kind for row in ROWS for one in parse_all(row.inject.split())} == set(KINDS)
    for row in ROWS:
        assert row.caught_by, row.inject


def test_no_check_is_without_a_fault(without: dict[str, Measurement]) -> None:
    """Of all names of checks in the fixtures and in the source, each has something it catches."""
    proven = {name for row in ROWS for name in row.caught_by}.union(*CAUGHT_BY.values())
    unproven = {name for name in without if name not in proven}
    unproven |= {name for name in written_in_source() if name not in proven}
    missing = sorted(n for n in unproven if not any(re.fullmatch(p, n) for p in OTHERWISE))
    assert missing == []


def written_in_source() -> set[str]:
    """Names of measurements that appear whole in the packages of the checks."""
    folders = ("timesync", "imu", "calibration", "fusion", "reps")
    files = [
        ROOT / "hil" / "link.py",
        *(f for d in folders for f in (ROOT / "hil" / d).glob("*.py")),
    ]
    found: set[str] = set()
    for file in files:
        text = file.read_text(encoding="utf-8")
        found |= set(re.findall(r'judged\(\s*"([a-z]+\.[a-z0-9_.]+)"', text))
    assert len(found) > 20
    return found


@pytest.mark.parametrize("pattern", OTHERWISE)
def test_what_proves_the_rest_exists(pattern: str) -> None:
    file, _, name = OTHERWISE[pattern].partition("::")
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^def {name}\(", text, re.M)


def test_the_page_is_what_the_tables_say(capsys: pytest.CaptureFixture[str]) -> None:
    assert fault_page.main(["--check"]) == 0, capsys.readouterr().out
    page = fault_page.render()
    for row in ROWS:
        assert f"`{row.inject}`" in page
    for kind in KINDS:
        assert f"`{kind}" in page
