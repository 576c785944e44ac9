# SPDX-License-Identifier: Apache-2.0
"""CSV with a line of names; fields parted by comma, semicolon or tab."""

from __future__ import annotations

from itertools import compress
from pathlib import Path

import numpy as np

from hil.exchange.sheets import RefusedError, Sheet
from hil.truth import reference


def read(path: Path) -> list[Sheet]:
    """The one sheet; a column with anything but numbers in it is left out, an empty cell is NaN.

    Raises:
        RefusedError: no names, a line of another length; the line is named.
        ReferenceError: not text, or over a limit.
    """
    # The reader of references bounds size, length and number of lines, and names what is wrong.
    rows = reference.csv_rows(path)
    number, names = next(rows, (0, []))
    if not names or any(reference.number_of(cell) is not None for cell in names):
        raise RefusedError(
            f"{path}, line {max(number, 1)}: is not a line of column names",
            "name the columns, e.g. t_s,gyro_x_radps,…,accel_z_mps2",
        )
    if len(set(names)) < len(names):
        raise RefusedError(f"{path}, line {number}: a column name occurs twice", "rename it")
    lines: list[int] = []
    columns: list[list[float]] = [[] for _ in names]
    numeric = [True] * len(names)
    for line, cells in rows:
        if len(cells) != len(names):
            raise RefusedError(
                f"{path}, line {line}: {len(cells)} fields, but {len(names)} column names",
                "complete the line or cut it",
            )
        lines.append(line)
        for k, cell in enumerate(cells):
            if not numeric[k]:
                continue
            value = float("nan") if cell == "" else reference.number_of(cell)
            if value is None:
                numeric[k] = False
                columns[k] = []
            else:
                columns[k].append(value)
    found = {
        name: np.array(values, dtype=np.float64)
        for name, values in compress(zip(names, columns, strict=True), numeric)
    }
    texts = [name for name, is_number in zip(names, numeric, strict=True) if not is_number]
    return [Sheet(str(path), found, lines, {"texts": texts})]
