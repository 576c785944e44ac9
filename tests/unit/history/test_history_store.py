# SPDX-License-Identifier: Apache-2.0
"""The history's database: nothing twice, nothing lost, nothing erased, whatever the file holds."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil.history import queries, tables
from hil.history.store import Added, HistoryError, open_history
from hil.report.reading import checked

Make = Callable[..., dict[str, Any]]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "folder" / "history.sqlite"


def keep(file: Path, *documents: dict[str, Any]) -> Added:
    total = Added()
    with open_history(file, create=True) as history:
        for document in documents:
            total += history.add(document)
    return total


def rows(file: Path, table: str) -> int:
    connection = sqlite3.connect(file)
    try:
        (n,) = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
        return int(n)
    finally:
        connection.close()


def test_the_documents_of_these_tests_are_reports(entry: Make, document: Make) -> None:
    checked(document(entry(1), entry(2, None)), "test")


def test_the_same_run_added_twice_is_one(file: Path, entry: Make, document: Make) -> None:
    assert keep(file, document(entry(1), entry(2))) == Added(new=2)
    again = document(entry(2), entry(3), when="2026-11-23T00:00:00+00:00")
    assert keep(file, again) == Added(new=1, known=1)
    assert [rows(file, t) for t in ("run", "judgement", "measurement")] == [3, 3, 3]


def test_a_retry_is_a_run_of_its_own_and_the_failure_stays(
    file: Path, entry: Make, document: Make
) -> None:
    keep(file, document(entry(1, 999.0)), document(entry(2, 92.4)))
    with open_history(file) as history:
        assert [r.outcome for r in queries.runs(history)] == ["pass", "product_failure"]


def test_a_run_judged_anew_keeps_its_first_judgement(
    file: Path, entry: Make, document: Make
) -> None:
    """A recording that failed, judged again under a wider limit, with the same identity."""
    first = document(entry(1, 200.0), when="2026-11-22T00:00:00+00:00")
    second = document(entry(1, 200.0, high=300.0), when="2026-11-23T00:00:00+00:00")
    assert keep(file, first) == Added(new=1)
    assert keep(file, second) == Added(judged_anew=1)
    # The older judgement, added later, must not count as the last one.
    assert keep(file, first) == Added(known=1)
    with open_history(file) as history:
        (run,) = queries.runs(history)
        assert (run.outcome, run.outcomes) == ("pass", ("product_failure", "pass"))
        (point,) = queries.points(history, "sync.error_p99_ns")
        assert (point.high, point.verdict) == (300.0, "pass")


def test_the_latest_judgement_counts_in_whichever_order_they_came(
    file: Path, entry: Make, document: Make
) -> None:
    late = document(entry(1, 200.0, high=300.0), when="2026-11-23T00:00:00+00:00")
    early = document(entry(1, 200.0), when="2026-11-22T23:59:59+00:00")
    keep(file, late, early)
    with open_history(file) as history:
        (point,) = queries.points(history, "sync.error_p99_ns")
    assert point.high == 300.0


def test_identity_is_the_recordings_bytes_and_its_time(
    file: Path, entry: Make, document: Make
) -> None:
    other_time = entry(1)
    other_time["provenance"] = {**other_time["provenance"], "created_utc": "2026-01-01T00:00:00Z"}
    other_name = {**entry(1), "name": "renamed", "id": "renamed"}
    assert keep(file, document(entry(1), other_time, other_name)) == Added(new=2, known=1)


def test_runs_without_a_recording_are_kept(file: Path, entry: Make, document: Make) -> None:
    none = dict.fromkeys(("file", "provenance", "contents", "integrity"))
    dead = {**entry(1), **none, "measurements": [], "outcome": "rig_failure", "verdict": "unset"}
    there = document({**dead, "outcome_reason": "leader died"})
    later = document(dead, when="2026-11-23T08:30:00+00:00")
    assert keep(file, there, there, later) == Added(new=2, known=1)
    unfiled = {**entry(2), "file": None}
    assert keep(file, document(unfiled), document(unfiled)) == Added(new=1, known=1)


def test_numbers_that_are_none(file: Path, entry: Make, document: Make) -> None:
    nan = entry(1, float("nan"))
    inf = entry(2, float("inf"))
    keep(file, document(nan, inf, entry(3, None)))
    with open_history(file) as history:
        found = queries.points(history, "sync.error_p99_ns")
    assert [(p.value, p.verdict.value) for p in found] == [
        (None, "fail"),
        (float("inf"), "fail"),
        (None, "unset"),
    ]


def test_a_failure_half_way_leaves_nothing(file: Path, entry: Make, document: Make) -> None:
    broken = document(entry(1), {**entry(2), "measurements": [{"id": "a"}]})
    with pytest.raises(KeyError):
        keep(file, broken)
    assert rows(file, "run") == 0


WRITER = """
import json, sys
from pathlib import Path
from hil.history.store import open_history
documents = json.loads(Path(sys.argv[2]).read_text())
for document in documents:
    with open_history(Path(sys.argv[1]), create=True) as history:
        history.add(document)
"""


def test_writers_at_once_lose_nothing(
    file: Path, entry: Make, document: Make, tmp_path: Path
) -> None:
    """Four programs, from a file that is not there, 25 reports each, a fifth of them the same."""
    children = []
    for writer in range(4):
        numbers = [n if n < 5 else 100 * (writer + 1) + n for n in range(25)]
        text = json.dumps([document(entry(n)) for n in numbers])
        (tmp_path / f"{writer}.json").write_text(text)
        children.append(
            subprocess.Popen(
                [sys.executable, "-c", WRITER, file, tmp_path / f"{writer}.json"],
                stderr=subprocess.PIPE,
                text=True,
            )
        )
    for child in children:
        _, error = child.communicate(timeout=120)
        assert child.returncode == 0, error
    assert rows(file, "run") == 5 + 4 * 20
    assert rows(file, "measurement") == 5 + 4 * 20
    connection = sqlite3.connect(file)
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()


def test_a_new_history_waits_for_whoever_has_its_file(
    file: Path, entry: Make, document: Make
) -> None:
    """SQLite itself does not wait for this lock when the journal's mode is set."""
    file.parent.mkdir()
    other = sqlite3.connect(file, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    other.execute("CREATE TABLE passing (id INTEGER)")
    release = threading.Timer(0.3, lambda: (other.execute("ROLLBACK"), other.close()))
    release.start()
    assert keep(file, document(entry(1))) == Added(new=1)
    release.join()


def test_a_writer_that_waits_in_vain_says_for_whom(
    file: Path, entry: Make, document: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(file, document(entry(1)))
    monkeypatch.setattr("hil.history.store.WAIT_S", 0.1)
    other = sqlite3.connect(file, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(HistoryError, match="another program has been writing") as caught:
        keep(file, document(entry(2)))
    assert "fuser" in caught.value.mend
    other.execute("ROLLBACK")
    other.close()
    assert keep(file, document(entry(2))) == Added(new=1)


def test_a_version_more_is_reached_without_loss(
    file: Path, entry: Make, document: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(file, document(entry(1)))
    steps = [*tables.STEPS, ("ALTER TABLE run ADD COLUMN bench TEXT NOT NULL DEFAULT ''",)]
    monkeypatch.setattr(tables, "STEPS", steps)
    assert keep(file, document(entry(1), entry(2))) == Added(new=1, known=1)
    connection = sqlite3.connect(file)
    assert connection.execute("PRAGMA user_version").fetchone() == (2,)
    assert connection.execute("SELECT bench FROM run").fetchall() == [("",), ("",)]
    connection.close()
    monkeypatch.undo()
    with pytest.raises(HistoryError, match="written by a newer hil: version 2") as caught:
        open_history(file)
    assert "update hil" in caught.value.mend


def test_a_step_that_fails_leaves_the_old_version(
    file: Path, entry: Make, document: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(file, document(entry(1)))
    steps = [*tables.STEPS, ("CREATE TABLE extra (id INTEGER) STRICT", "NONSENSE")]
    monkeypatch.setattr(tables, "STEPS", steps)
    with pytest.raises(HistoryError, match="NONSENSE"):
        open_history(file)
    monkeypatch.undo()
    with open_history(file) as history:
        assert len(queries.runs(history)) == 1


def test_no_history_is_said_with_how_to_begin(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="there is no history at") as caught:
        open_history(tmp_path / "absent.sqlite")
    assert "hil history add" in caught.value.mend
    assert not (tmp_path / "absent.sqlite").exists()


def sabotage(file: Path, *statements: str) -> None:
    connection = sqlite3.connect(file)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def test_files_that_are_no_history(file: Path, entry: Make, document: Make, tmp_path: Path) -> None:
    text = tmp_path / "text.sqlite"
    text.write_bytes(b"not a database at all, but long enough to be read as one" * 20)
    with pytest.raises(HistoryError, match="is damaged"):
        keep(text, document(entry(1)))
    foreign = tmp_path / "foreign.sqlite"
    sabotage(foreign, "CREATE TABLE precious (id INTEGER)")
    with pytest.raises(HistoryError, match="not a history of hil"):
        keep(foreign, document(entry(1)))
    with pytest.raises(HistoryError, match="cannot be used as a history"):
        keep(tmp_path / "text.sqlite" / "below.sqlite", document(entry(1)))
    with pytest.raises(HistoryError, match="cannot be used as a history"):
        keep(tmp_path, document(entry(1)))


def test_a_trigger_smuggled_in_is_refused(file: Path, entry: Make, document: Make) -> None:
    keep(file, document(entry(1)))
    sabotage(file, "CREATE TRIGGER erase AFTER INSERT ON run BEGIN DELETE FROM measurement; END")
    with pytest.raises(HistoryError, match="its tables are not those that hil makes"):
        keep(file, document(entry(2)))
    assert rows(file, "measurement") == 1


def test_a_verdict_that_there_is_not_is_damage(file: Path, entry: Make, document: Make) -> None:
    keep(file, document(entry(1)))
    sabotage(file, "UPDATE measurement SET verdict = 'splendid'")
    with open_history(file) as history, pytest.raises(HistoryError, match="is damaged"):
        queries.points(history)


def test_damaged_pages_are_said_with_what_to_do(file: Path, entry: Make, document: Make) -> None:
    keep(file, document(*(entry(n) for n in range(200))))
    sabotage(file, "PRAGMA wal_checkpoint(TRUNCATE)")
    damaged = bytearray(file.read_bytes())
    for page in range(2, len(damaged) // 4096):
        damaged[page * 4096 : page * 4096 + 64] = b"\xa5" * 64
    file.write_bytes(damaged)
    with pytest.raises(HistoryError, match="is damaged") as caught, open_history(file) as history:
        queries.points(history)
    assert ".recover" in caught.value.mend
    assert "hil history add" in caught.value.mend


def test_a_text_that_is_too_long_is_refused(file: Path, entry: Make, document: Make) -> None:
    long = entry(1)
    long["measurements"][0]["how"] = "x" * 2_000_000
    with pytest.raises(HistoryError, match="does not fit"):
        keep(file, document(long))
