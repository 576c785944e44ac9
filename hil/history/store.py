# SPDX-License-Identifier: Apache-2.0
"""Every run ever judged, in one SQLite file.

Several writers may add at once: the journal is a write-ahead log, each report is one transaction,
and a writer waits for another. Nothing is ever deleted.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from hil.errors import HilError
from hil.history import records, tables

WAIT_S: Final = 60.0
"""How long a writer waits for the others; one report takes some milliseconds."""
MAX_VALUE_BYTES: Final = 2**20

T = TypeVar("T")


class HistoryError(HilError):
    """A history that cannot be opened, read or written."""


@dataclass(frozen=True)
class Added:
    """What came of adding a report: runs seen for the first time, judged anew, known already."""

    new: int = 0
    judged_anew: int = 0
    known: int = 0

    def __add__(self, other: Added) -> Added:
        return Added(
            self.new + other.new,
            self.judged_anew + other.judged_anew,
            self.known + other.known,
        )


class History:
    """An open history; leave it with ``with``."""

    def __init__(self, connection: sqlite3.Connection, file: Path) -> None:
        self._connection = connection
        self.file = file

    def __enter__(self) -> History:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def add(self, document: Mapping[str, Any]) -> Added:
        """Keep every run of a report; one that is there already is not kept twice.

        Raises:
            HistoryError: the database cannot be written.
        """
        with _explained(self.file), _transaction(self._connection):
            added = Added()
            for entry in document["recordings"]:
                added += self._add_run(document, entry)
            return added

    def _add_run(self, document: Mapping[str, Any], entry: Mapping[str, Any]) -> Added:
        row = records.run(document, entry)
        known = self._insert("run", row) is None
        (run,) = self._connection.execute(
            "SELECT id FROM run WHERE identity = ?", (row["identity"],)
        ).fetchone()
        judgement = self._insert("judgement", {"run": run, **records.judgement(document, entry)})
        if judgement is None:
            return Added(known=1)
        for m in entry["measurements"]:
            self._insert("measurement", {"judgement": judgement, **records.measurement(m)})
        return Added(judged_anew=1) if known else Added(new=1)

    def _insert(self, table: str, row: Mapping[str, Any]) -> int | None:
        """Row id of the new row; None when there is such a row already."""
        names = ", ".join(row)
        places = ", ".join(f":{name}" for name in row)
        found = self._connection.execute(
            f"INSERT INTO {table} ({names}) VALUES ({places}) ON CONFLICT DO NOTHING",  # noqa: S608
            row,
        )
        return found.lastrowid if found.rowcount else None

    def rows(self, query: str, make: Callable[..., T], *values: str) -> list[T]:
        """Each row of ``query`` as ``make`` makes it of the columns, by name.

        Raises:
            HistoryError: the database is damaged, or holds what ``hil`` would not write.
        """
        with _explained(self.file):
            cursor = self._connection.execute(query, values)
            names = [column[0] for column in cursor.description]
            try:
                return [make(**dict(zip(names, row, strict=True))) for row in cursor]
            except (ValueError, TypeError) as error:
                raise _damaged(self.file, str(error)) from error


def open_history(file: Path, *, create: bool = False) -> History:
    """Open a history.

    Args:
        file: the database.
        create: make it, and its folder, when it is not there.

    Raises:
        HistoryError: it is not there, not a history, damaged, or of a newer ``hil``.
    """
    if not create and not file.is_file():
        raise HistoryError(
            f"there is no history at {file}",
            "begin one: hil history add build/report/report.json\n"
            "or while testing: pytest tests/hil --hil-history",
        )
    with _explained(file):
        if create:
            file.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(file, timeout=WAIT_S, isolation_level=None)
        try:
            _prepare(connection, file)
        except BaseException:
            connection.close()
            raise
        return History(connection, file)


def _prepare(connection: sqlite3.Connection, file: Path) -> None:
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {pragma}")
    if _version(connection, file) < len(tables.STEPS):
        _write_ahead(connection)
        with _transaction(connection):
            # Another writer may have taken the steps while this one waited.
            tables.migrate(connection, _version(connection, file))
    if tables.described(connection) != tables.expected(len(tables.STEPS)):
        raise _damaged(file, "its tables are not those that hil makes")


def _version(connection: sqlite3.Connection, file: Path) -> int:
    (owner,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if owner != tables.APPLICATION_ID and (owner or version or tables.described(connection)):
        raise HistoryError(
            f"{file} is a database, but not a history of hil",
            "name another file: --db build/history.sqlite",
        )
    if version > len(tables.STEPS):
        raise HistoryError(
            f"{file} was written by a newer hil: version {version}, "
            f"this one knows {len(tables.STEPS)}",
            "update hil: git pull, then python -m pip install -e .",
        )
    return int(version)


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Set the write-ahead log. SQLite does not wait for the lock that this takes: ask again."""
    end_s = time.monotonic() + WAIT_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > end_s:
                raise
            time.sleep(0.02)


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
    except BaseException:
        connection.execute("ROLLBACK")
        raise
    connection.execute("COMMIT")


@contextmanager
def _explained(file: Path) -> Iterator[None]:
    """SQLite's errors, and the file system's, as one of ours."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            raise HistoryError(
                f"{file}: another program has been writing for more than {WAIT_S:g} s",
                f"see who has it open: fuser {file}\nthen try again; nothing was lost",
            ) from error
        raise HistoryError(
            f"{file} cannot be used as a history: {error}",
            "name a file that you may write to: --db build/history.sqlite",
        ) from error
    except sqlite3.DataError as error:
        raise HistoryError(
            f"the report does not fit into {file}: {error}",
            f"no text of a report has more than {MAX_VALUE_BYTES} bytes: make it anew",
        ) from error
    except sqlite3.DatabaseError as error:
        raise _damaged(file, str(error)) from error
    except OSError as error:
        raise HistoryError(
            f"{file} cannot be used as a history: {error.strerror or error}",
            "name a file that you may write to: --db build/history.sqlite",
        ) from error


def _damaged(file: Path, what: str) -> HistoryError:
    return HistoryError(
        f"{file} is damaged: {what}",
        f"save what can be saved: sqlite3 {file} .recover | sqlite3 saved.sqlite\n"
        f"or put it aside and begin anew from the reports: mv {file} {file}.damaged; "
        "hil history add build/*/report.json",
    )
