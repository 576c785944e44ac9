# SPDX-License-Identifier: Apache-2.0
"""A reference from a CSV file: times and heights or vertical velocities, in SI units.

Columns are found by name, units by what the names say, by the options, or by sizes that leave no
doubt: samples come 0.5 ms to 0.2 s apart, and a bar travels 0.05 to 3 m. Anything else is asked
for. Empty cells are gaps.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError, printable

Float = NDArray[np.float64]
Quantity = Literal["position", "velocity"]

BYTES_MAX: Final = 1 << 27
ROWS_MAX: Final = 4_000_000
LINE_MAX: Final = 4096
NAME_MAX: Final = 200
NUMBER_MAX: Final = 1e30
"""Nothing is measured in more; differences and units stay finite."""
COLUMNS_MAX: Final = 64
ROWS_MIN: Final = 20

TIME_UNITS: Final[Mapping[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
POSITION_UNITS: Final[Mapping[str, float]] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
VELOCITY_UNITS: Final[Mapping[str, float]] = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3}
SPELT: Final[Mapping[str, str]] = {
    **{"sec": "s", "seconds": "s", "µs": "us", "μs": "us", "mps": "m/s", "cmps": "cm/s"},
    **{"mmps": "mm/s", "m_s": "m/s", "mm_s": "mm/s", "cm_s": "cm/s"},
}
TIME_NAMES: Final = ("time", "timestamp", "t")
POSITION_NAMES: Final = ("position", "height", "displacement", "distance", "pos", "z", "y", "x")
VELOCITY_NAMES: Final = ("velocity", "speed", "vel", "vz", "vy", "v")
STEP_S: Final = (0.0005, 0.2)
TRAVEL_M: Final = (0.05, 3.0)


class ReferenceError(HilError):
    """A reference that cannot be read or aligned; the message names file and line."""

    def __init__(self, message: str, mend: str = "") -> None:
        # Headings and cells are quoted as they came.
        super().__init__(printable(message), mend)


@dataclass(frozen=True, eq=False)
class Reference:
    """n samples of the reference.

    Attributes:
        t_s: float64[n], increasing, on the reference's clock.
        value: float64[n], height in m or vertical velocity in m/s.
        gaps: rows without a value.
        read_as: columns and units, for the reader to check.
    """

    t_s: Float
    value: Float
    quantity: Quantity
    gaps: int
    read_as: str


@dataclass(frozen=True)
class Columns:
    """What the user says of the file; None: found out.

    Attributes:
        time, value: names of columns, or their numbers from 1.
        time_unit, unit: keys of the tables of units; a unit of the value tells the quantity too.
    """

    time: str | None = None
    value: str | None = None
    time_unit: str | None = None
    unit: str | None = None


@dataclass(frozen=True)
class _Column:
    index: int
    name: str
    unit: str | None


def read(path: Path, columns: Columns | None = None) -> Reference:
    """The reference in a CSV file; fields parted by comma, semicolon or tab.

    Raises:
        ReferenceError: no such file, too large, not text, a column or unit that cannot be told,
            or a line that is wrong: it is named.
    """
    said = columns or Columns()
    rows = csv_rows(path)
    number, first = next(rows, (0, []))
    if not first:
        raise ReferenceError(f"{path}: the file is empty", "give a CSV file with times and values")
    named = any(number_of(cell) is None and cell for cell in first)
    names = first if named else [f"column {k + 1}" for k in range(len(first))]
    time = _pick(
        path,
        names,
        said=said.time,
        known=TIME_NAMES,
        only=0 if not named else None,
        what="time",
    )
    value_names: tuple[str, ...] = (*VELOCITY_NAMES, *POSITION_NAMES)
    if said.unit:
        value_names = VELOCITY_NAMES if said.unit in VELOCITY_UNITS else POSITION_NAMES
    only = None
    if len(names) == 2 and (not named or said.unit):
        only = 1 - time.index
    value = _pick(path, names, said=said.value, known=value_names, only=only, what="value")
    t, x, lines, gaps = _numbers(path, rows, first if not named else None, number, (time, value))
    if len(t) < ROWS_MIN:
        raise ReferenceError(
            f"{path}: {len(t)} rows with a value: too few to align", f"give {ROWS_MIN} or more"
        )
    t_unit = _known(path, said.time_unit or time.unit, TIME_UNITS, "time") or _time_unit(path, t)
    all_units = {**POSITION_UNITS, **VELOCITY_UNITS}
    unit = _known(path, said.unit or value.unit, all_units, "value")
    unit = unit or _value_unit(path, value, x)
    t_s = t * TIME_UNITS[t_unit]
    back = np.flatnonzero(np.diff(t_s) <= 0.0)
    if back.size:
        raise ReferenceError(
            f"{path}, line {lines[int(back[0]) + 1]}: the time does not increase",
            "sort the rows by time, and give each time once",
        )
    return Reference(
        t_s,
        x * all_units[unit],
        "velocity" if unit in VELOCITY_UNITS else "position",
        gaps,
        f"'{time.name}' in {t_unit}, '{value.name}' in {unit}",
    )


def csv_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number and stripped cells of each line that is not blank; bounded in every direction.

    Raises:
        ReferenceError: no such file, too large, or not text; the message names the line.
    """
    try:
        if path.stat().st_size > BYTES_MAX:
            raise ReferenceError(
                f"{path}: larger than {BYTES_MAX >> 20} MiB", "cut it to the set in question"
            )
        with path.open(encoding="utf-8-sig", newline="") as stream:
            delimiter = None
            number = 0
            while line := stream.readline(LINE_MAX + 1):
                number += 1
                if len(line) > LINE_MAX:
                    raise ReferenceError(
                        f"{path}, line {number}: longer than {LINE_MAX} characters", "is it CSV?"
                    )
                if number > ROWS_MAX:
                    raise ReferenceError(f"{path}: more than {ROWS_MAX} lines", "cut it to the set")
                if "\0" in line:
                    raise ReferenceError(f"{path}, line {number}: a null byte", "is it CSV?")
                if not line.strip():
                    continue
                if delimiter is None:
                    delimiter = next((d for d in ";\t" if d in line), ",")
                cells = [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
                if len(cells) > COLUMNS_MAX:
                    raise ReferenceError(
                        f"{path}, line {number}: more than {COLUMNS_MAX} columns", "is it CSV?"
                    )
                yield number, [c.replace(",", ".") for c in cells] if delimiter == ";" else cells
    except OSError as error:
        raise ReferenceError(f"{path}: {error.strerror}", "name a CSV file") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ReferenceError(
            f"{path}: not a CSV file in UTF-8: {error}", "save it as CSV"
        ) from error


def number_of(cell: str) -> float | None:
    """The number in a cell of a table; None where there is none."""
    # float() also takes 1_000, which no instrument writes.
    if "_" in cell:
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _pick(
    path: Path,
    names: Sequence[str],
    *,
    said: str | None,
    known: Sequence[str],
    only: int | None,
    what: str,
) -> _Column:
    """The column that the user named, the one that is known by name, or the ``only`` one."""
    split = [_split(name) for name in names]
    index = only
    if said is not None:
        index = next(
            (k for k, name in enumerate(names) if said.lower() in (name.lower(), split[k][0])),
            int(said) - 1 if said.isdecimal() and 0 < int(said[:6]) <= len(names) else None,
        )
    else:
        for wanted in known:
            matching = [k for k, (word, _) in enumerate(split) if word == wanted]
            if matching:
                index = matching[0]
                break
    if index is None:
        have = ", ".join(name[:30] for name in names[:10])
        raise ReferenceError(
            f"{path}, line 1: no {what} column"
            + (f" '{said[:30]}'" if said else "")
            + f" in {have}",
            f"name it: --{what}-column NAME, or its number from 1",
        )
    return _Column(index, names[index], split[index][1])


def _split(name: str) -> tuple[str, str | None]:
    """Word and unit of a heading: 'Height (mm)', 'height [mm]', 'height_mm', 'height mm'."""
    # Short, and spaces single: the patterns below may try every pair of places in it.
    name = " ".join(name[:NAME_MAX].split())
    match = re.fullmatch(r"\s*(.+?)\s*[(\[]\s*(.+?)\s*[)\]]\s*", name.lower())
    if match is None:
        units = "|".join((*TIME_UNITS, *POSITION_UNITS, *VELOCITY_UNITS, *SPELT))
        match = re.fullmatch(rf"\s*(.+?)[\s_]+({units})\s*", name.lower())
    if match is None:
        return name.strip().lower(), None
    return match[1], SPELT.get(match[2], match[2])


def _numbers(
    path: Path,
    rows: Iterator[tuple[int, list[str]]],
    first: list[str] | None,
    number: int,
    wanted: tuple[_Column, _Column],
) -> tuple[Float, Float, list[int], int]:
    """Times, values, and the line of each; rows with an empty cell are gaps."""
    found: tuple[list[float], list[float]] = ([], [])
    lines: list[int] = []
    gaps = 0
    if first is not None:
        rows = _chain((number, first), rows)
    for line, cells in rows:
        if len(cells) <= max(c.index for c in wanted):
            raise ReferenceError(
                f"{path}, line {line}: {len(cells)} fields, too few", "complete the line or cut it"
            )
        texts = [cells[c.index] for c in wanted]
        values = [number_of(text) for text in texts]
        if any(text == "" or text.lower() == "nan" for text in texts):
            gaps += 1
            continue
        for text, value, column in zip(texts, values, wanted, strict=True):
            if value is None or not abs(value) < NUMBER_MAX:
                raise ReferenceError(
                    f"{path}, line {line}: {text[:30]!r} in '{column.name[:30]}' is not a number",
                    "correct it, or leave the cell empty for a gap",
                )
        for column_values, value in zip(found, values, strict=True):
            column_values.append(float(value or 0.0))
        lines.append(line)
    return np.array(found[0]), np.array(found[1]), lines, gaps


def _chain(
    first: tuple[int, list[str]], rest: Iterator[tuple[int, list[str]]]
) -> Iterator[tuple[int, list[str]]]:
    yield first
    yield from rest


def _known(path: Path, unit: str | None, units: Mapping[str, float], what: str) -> str | None:
    if unit is None or unit in units:
        return unit
    option = "--time-unit" if what == "time" else "--unit"
    raise ReferenceError(
        f"{path}, line 1: {unit[:20]!r} is no unit of {what}",
        f"{option} takes {', '.join(units)}",
    )


def _time_unit(path: Path, t: Float) -> str:
    step = float(np.median(np.abs(np.diff(t))))
    for unit, size in TIME_UNITS.items():
        if STEP_S[0] <= step * size <= STEP_S[1]:
            return unit
    raise ReferenceError(
        f"{path}: samples {step:g} apart are in no unit of time that makes sense",
        "say it: --time-unit s, ms, us or ns",
    )


def _value_unit(path: Path, column: _Column, x: Float) -> str:
    word = _split(column.name)[0]
    travel = float(np.ptp(x))
    if word in POSITION_NAMES:
        for unit in ("m", "mm"):
            if TRAVEL_M[0] <= travel * POSITION_UNITS[unit] <= TRAVEL_M[1]:
                return unit
    elif word in VELOCITY_NAMES and 0.2 <= travel <= 10.0:
        return "m/s"
    elif word in VELOCITY_NAMES and 200.0 <= travel <= 10_000.0:
        return "mm/s"
    raise ReferenceError(
        f"{path}: the unit of '{column.name[:30]}', which spans {travel:g}, cannot be told",
        f"say it: --unit {', '.join((*POSITION_UNITS, *VELOCITY_UNITS))}",
    )
