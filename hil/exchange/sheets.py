# SPDX-License-Identifier: Apache-2.0
"""Foreign files as sheets of columns. What a file claims is checked before it is believed.

Every reader looks at names, types and sizes first; only columns that fit the limits are read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from hil.errors import printable
from hil.exchange.table import ExchangeError

ROWS_MAX: Final = 4_000_000
"""2 h 40 min at 417 Hz."""
COLUMNS_MAX: Final = 256
BYTES_MAX: Final = 1 << 29
"""Most that the columns of one file may take in memory."""
FILE_BYTES_MAX: Final = 1 << 30
NAME_MAX: Final = 200
SENSORS: Final = ("imu_leader", "imu_follower")
"""Tables of an export that are read again."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """Columns of one sensor.

    Attributes:
        where: the file, and the part of it: how messages begin.
        columns: name -> n numbers or truth values.
        lines: line of each row, for files that have lines.
        attributes: what else the file says, such as ``sampling_rate``.
        is_broad: it has the datasets of BROAD, so their units are known.
    """

    where: str
    columns: Mapping[str, NDArray[Any]]
    lines: Sequence[int] | None = None
    attributes: Mapping[str, Any] = field(default_factory=dict)
    is_broad: bool = False

    def place(self, row: int) -> str:
        """``row`` (from 0) as a person finds it."""
        return f"line {self.lines[row]}" if self.lines is not None else f"row {row + 1}"


class RefusedError(ExchangeError):
    """A foreign file that is not read; what is quoted of it is made printable."""

    def __init__(self, message: str, mend: str = "") -> None:
        super().__init__(printable(message), mend)


def read(path: Path) -> list[Sheet]:
    """The sheets of a file, or of an export's folder: one sensor, or leader and follower.

    Raises:
        ExchangeError: it is not one of the formats, it is damaged, or it is over a limit.
    """
    try:
        if path.is_dir():
            return _folder(path)
        if not path.is_file():
            raise RefusedError(f"{path}: is not a file", "name a CSV, NPZ, HDF5 or Parquet file")
        if path.stat().st_size > FILE_BYTES_MAX:
            raise RefusedError(
                f"{path}: larger than {FILE_BYTES_MAX >> 20} MiB", "cut it to one set"
            )
        with path.open("rb") as stream:
            begins = stream.read(8)
        return _reader(path, begins)(path)
    except OSError as error:
        raise RefusedError(f"{path}: cannot be read: {error.strerror or error}") from error


def files(path: Path) -> list[Path]:
    """The file itself, or those of an export's folder that are read, leader's first."""
    if not path.is_dir():
        return [path]
    wanted = [path / f"{name}{ending}" for name in SENSORS for ending in (".csv", ".parquet")]
    return [file for file in wanted if file.is_file()]


def _folder(path: Path) -> list[Sheet]:
    found = [sheet for file in files(path) for sheet in read(file)]
    if not found:
        raise RefusedError(
            f"{path}: is a folder without {SENSORS[0]}.csv or {SENSORS[0]}.parquet",
            "name a file, or the folder of an export",
        )
    return found


def _reader(path: Path, begins: bytes) -> Callable[[Path], list[Sheet]]:
    """By what the file begins with; its name tells nothing."""
    from hil.exchange import read_csv, read_hdf5, read_npz, read_parquet  # noqa: PLC0415 (a circle)

    if not begins:
        raise RefusedError(f"{path}: is empty", "give a file with samples")
    if begins.startswith(b"PK"):
        return read_npz.read
    if begins == b"\x89HDF\r\n\x1a\n":
        return read_hdf5.read
    if begins.startswith(b"PAR1"):
        return read_parquet.read
    return read_csv.read


def check_claim(where: str, names: Mapping[str, tuple[int, ...]]) -> None:
    """Refuse what is too much, before anything of it is read.

    Args:
        names: column -> shape that the file claims.

    Raises:
        RefusedError: more rows, columns or numbers than the limits.
    """
    if len(names) > COLUMNS_MAX:
        raise RefusedError(f"{where}: {len(names)} columns, the limit is {COLUMNS_MAX}")
    total = 0
    for name, shape in names.items():
        if shape and shape[0] > ROWS_MAX:
            raise RefusedError(
                f"{where}: '{name[:NAME_MAX]}' claims {shape[0]} rows, the limit is {ROWS_MAX}",
                "cut it to one set",
            )
        numbers = 1
        for length in shape:
            numbers *= length
        total += 8 * numbers
    if total > BYTES_MAX:
        raise RefusedError(
            f"{where}: claims {total} bytes of numbers, the limit is {BYTES_MAX}",
            "cut it to one set",
        )


def columns_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays of (n,) as they are, those of (n, 3) as three columns: ``gyro`` is ``gyro_x`` …"""
    found: dict[str, NDArray[Any]] = {}
    for name, values in arrays.items():
        if values.ndim == 1:
            found[name] = values
        elif values.ndim == 2 and values.shape[1] == 3:
            found |= {f"{name}\n{axis}": values[:, k] for k, axis in enumerate("xyz")}
    return found
