# SPDX-License-Identifier: Apache-2.0
"""The tables of a history database, and the steps that lead from one version to the next.

``PRAGMA user_version`` counts the steps taken, ``PRAGMA application_id`` says whose file it is.
Steps are only ever added at the end. Nothing is ever deleted or changed: a run is kept once, each
different judgement of it beside the others.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from typing import Final

APPLICATION_ID: Final = 0x68696C31
"""``hil1`` in ASCII."""

STEPS: Sequence[Sequence[str]] = (
    (
        """
        CREATE TABLE run (
            id INTEGER PRIMARY KEY,
            identity TEXT NOT NULL UNIQUE,
            name TEXT NOT NULL,
            source TEXT NOT NULL,
            scenario TEXT NOT NULL,
            created_utc TEXT NOT NULL,
            build TEXT NOT NULL,
            recording_sha256 TEXT NOT NULL,
            repeats TEXT NOT NULL
        ) STRICT
        """,
        """
        CREATE TABLE judgement (
            id INTEGER PRIMARY KEY,
            run INTEGER NOT NULL REFERENCES run (id),
            content TEXT NOT NULL,
            judged_utc TEXT NOT NULL,
            judged TEXT NOT NULL,
            rig_version TEXT NOT NULL,
            rig_commit TEXT NOT NULL,
            rig_state TEXT NOT NULL,
            verdict TEXT NOT NULL,
            outcome TEXT NOT NULL,
            reason TEXT NOT NULL,
            UNIQUE (run, content)
        ) STRICT
        """,
        """
        CREATE TABLE measurement (
            judgement INTEGER NOT NULL REFERENCES judgement (id),
            id TEXT NOT NULL,
            name TEXT NOT NULL,
            value REAL,
            uncertainty REAL,
            low REAL,
            high REAL,
            marginal REAL,
            unit TEXT NOT NULL,
            verdict TEXT NOT NULL,
            expected_fail INTEGER NOT NULL,
            budget TEXT NOT NULL,
            how TEXT NOT NULL,
            PRIMARY KEY (judgement, id)
        ) STRICT, WITHOUT ROWID
        """,
        "CREATE INDEX judgement_of_run ON judgement (run)",
        "CREATE INDEX measurement_by_name ON measurement (name, judgement)",
    ),
)


def migrate(connection: sqlite3.Connection, version: int) -> None:
    """Take the steps after ``version``, inside the caller's transaction."""
    for step in STEPS[version:]:
        for statement in step:
            connection.execute(statement)
    connection.execute(f"PRAGMA user_version = {len(STEPS)}")
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")


def described(connection: sqlite3.Connection) -> set[tuple[str, str, str]]:
    """(type, name, SQL) of everything in the database: tables, and what could do harm."""
    rows = connection.execute("SELECT type, name, sql FROM sqlite_schema WHERE sql IS NOT NULL")
    return {(str(kind), str(name), " ".join(str(sql).split())) for kind, name, sql in rows}


def expected(version: int) -> set[tuple[str, str, str]]:
    """What :func:`described` finds in a sound database of ``version``."""
    connection = sqlite3.connect(":memory:")
    try:
        for step in STEPS[:version]:
            for statement in step:
                connection.execute(statement)
        return described(connection)
    finally:
        connection.close()
