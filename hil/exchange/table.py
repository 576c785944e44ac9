# SPDX-License-Identifier: Apache-2.0
"""Tables: what an export holds, whatever the format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError


class ExchangeError(HilError):
    """A file that cannot be written or read; the message names it, and its line where it has."""


@dataclass(frozen=True, eq=False)
class Column:
    """One column.

    Attributes:
        name: quantity, axis, clock and unit: ``gyro_x_radps``, ``t_leader_s``.
        values: n numbers, truth values, or texts (dtype object, each a str).
        unit: SI unit; ``"1"`` for pure numbers, empty for text and truth values.
        meaning: one sentence.
    """

    name: str
    values: NDArray[Any]
    unit: str
    meaning: str

    @property
    def is_text(self) -> bool:
        return self.values.dtype == object


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one length.

    Attributes:
        name: also of the file, group or topic that it becomes: ``imu_leader``.
        t_ns: int64[n], the leader's clock, for formats in which each row has a time; a row whose
            time is not known has that of the row before.
    """

    name: str
    columns: tuple[Column, ...]
    t_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Values of the column ``name``.

        Raises:
            KeyError: there is none.
        """
        for column in self.columns:
            if column.name == name:
                return column.values
        raise KeyError(name)


@dataclass(frozen=True)
class Contents:
    """All that an export holds: tables by name, and where they come from as plain JSON data."""

    tables: Mapping[str, Table]
    provenance: Mapping[str, Any]
