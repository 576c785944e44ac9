# SPDX-License-Identifier: Apache-2.0
"""The CSV lines between a node's frames -> tables of columns.

A line ``#<kind>,<column>,<column>…`` names the columns of the rows ``<kind>,<value>,<value>…``;
it is repeated, so that a stream can be entered anywhere. ``shadow`` is the log of filtered IMU
samples (``CONFIG_BV_SHADOW_LOG``), ``IMU`` and ``SYNC`` are the diagnostic lines
(``firmware/lib/diag/diag_csv.h``).

Rows before the first heading of their kind are read by it. Whatever does not fit is counted as a
bad row and left out: nothing that a stream holds raises an error here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.recording import Recording
from hil.streams import decoded
from hil.wire.text import TextLine

SHADOW: Final = "shadow"
SHADOW_COLUMNS: Final = (
    *("t_us_node", "ax_mps2", "ay_mps2", "az_mps2"),
    *("gx_radps", "gy_radps", "gz_radps", "flags"),
)
"""What the firmware's heading says today; the heading in the stream is what is followed."""

WORDS: Final = frozenset({"node", "state"})
"""Columns that hold words; all others hold decimal numbers."""
KINDS_MAX: Final = 16
COLUMNS_MAX: Final = 64
LINE_MAX: Final = 1024

_KIND: Final = r"[A-Za-z][A-Za-z0-9_]{0,31}"
_COLUMN: Final = r"[A-Za-z][A-Za-z0-9_]{0,63}"
_HEADING: Final = re.compile(rf"#({_KIND})((?:,{_COLUMN})+)")
_NUMBER: Final = re.compile(r"-?[0-9]{1,20}(\.[0-9]{1,20})?")
_WORD: Final = re.compile(r"[A-Za-z0-9_-]{1,32}")
_INT64: Final = 1 << 63


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of one kind, in the order of sending.

    Attributes:
        kind: ``shadow``, ``IMU``, …
        columns: name -> int64[n] where every value was written as a whole number, else
            float64[n]; of words, str[n]. Names carry units and clocks.
        t_ns_bench: int64[n], when the read that brought each row's first byte had returned.
        bad_rows: rows left out: without a heading, of another length, or not numbers.
        headings: how often the columns were named.
    """

    kind: str
    columns: Mapping[str, NDArray[Any]]
    t_ns_bench: NDArray[np.int64]
    bad_rows: int
    headings: int

    def __len__(self) -> int:
        return len(self.t_ns_bench)


@dataclass
class _Kind:
    names: tuple[str, ...] = ()
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    bad_rows: int = 0
    headings: int = 0


def tables(recording: Recording, role: str) -> dict[str, Table]:
    """Kind -> the rows that the node of ``role`` sent; empty where it sent none."""
    return tables_of_parts([recording], role)


def tables_of_parts(parts: Sequence[Recording], role: str) -> dict[str, Table]:
    """As :func:`tables`, of a log that was kept in several recordings, in their order."""
    kinds: dict[str, _Kind] = {}
    for recording in parts:
        if role not in recording.roles:
            continue
        lines = decoded(recording, role).text
        at = recording.serial[role].t_ns_bench([line.offset for line in lines])
        _gather(kinds, zip(at.tolist(), lines, strict=True))
    return {name: _table(name, kind) for name, kind in kinds.items() if kind.headings}


def is_row(line: str) -> bool:
    """Whether a line could be a heading or a row; the rest is for people to read."""
    return re.match(rf"#?{_KIND},", line) is not None


def _gather(kinds: dict[str, _Kind], lines: Iterable[tuple[int, TextLine]]) -> None:
    for t_ns, line in lines:
        text = line.text
        if len(text) > LINE_MAX or not is_row(text):
            continue
        name = text.lstrip("#").partition(",")[0]
        if name not in kinds:
            if len(kinds) >= KINDS_MAX:
                continue
            kinds[name] = _Kind()
        kind = kinds[name]
        if text.startswith("#"):
            _heading(kind, text)
        else:
            kind.rows.append((t_ns, text.split(",", COLUMNS_MAX + 1)[1:]))


def _heading(kind: _Kind, text: str) -> None:
    match = _HEADING.fullmatch(text)
    names = tuple(match[2][1:].split(",")) if match else ()
    if match is None or len(names) > COLUMNS_MAX or len(set(names)) < len(names):
        kind.bad_rows += 1
        return
    # One firmware has one heading: the first one that is whole is right for all its rows.
    kind.names = kind.names or names
    kind.headings += kind.names == names
    kind.bad_rows += kind.names != names


def _table(name: str, kind: _Kind) -> Table:
    words = [column in WORDS for column in kind.names]
    good = [(t_ns, row) for t_ns, row in kind.rows if _fits(row, words)]
    by_column = list(zip(*(row for _, row in good), strict=True)) or [()] * len(kind.names)
    return Table(
        name,
        {
            column: np.array(values, np.str_) if is_word else _numbers(values)
            for column, is_word, values in zip(kind.names, words, by_column, strict=True)
        },
        np.array([t_ns for t_ns, _ in good], np.int64),
        kind.bad_rows + len(kind.rows) - len(good),
        kind.headings,
    )


def _fits(row: Sequence[str], words: Sequence[bool]) -> bool:
    if len(row) != len(words):
        return False
    for cell, is_word in zip(row, words, strict=True):
        if is_word:
            if _WORD.fullmatch(cell) is None:
                return False
            continue
        number = _NUMBER.fullmatch(cell)
        if number is None or (number[1] is None and not -_INT64 <= int(cell) < _INT64):
            return False
    return True


def _numbers(cells: Sequence[str]) -> NDArray[Any]:
    # float() is right to the last bit, and int64 keeps a clock of microseconds exact.
    if any("." in cell for cell in cells):
        return np.array([float(cell) for cell in cells], np.float64)
    return np.array([int(cell) for cell in cells], np.int64)
