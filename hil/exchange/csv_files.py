# SPDX-License-Identifier: Apache-2.0
"""A folder of CSV files, RFC 4180: one table each, and provenance.json."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

from hil.exchange.table import Column, Contents, Table


def write(contents: Contents, folder: Path) -> None:
    """Write every table into ``folder``, which is there. A number that is not known is empty."""
    for name, table in contents.tables.items():
        (folder / f"{name}.csv").write_text(as_csv(table), encoding="utf-8", newline="")
    write_provenance(contents, folder)


def write_provenance(contents: Contents, folder: Path) -> None:
    text = json.dumps(dict(contents.provenance), indent=1, allow_nan=False) + "\n"
    (folder / "provenance.json").write_text(text, encoding="utf-8")


def as_csv(table: Table) -> str:
    """Names with units, then one line per row; each number reads back as the same float64."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow(column.name for column in table.columns)
    writer.writerows(zip(*(_cells(column) for column in table.columns), strict=True))
    return text.getvalue()


def _cells(column: Column) -> list[Any]:
    values: list[Any] = column.values.tolist()
    if column.values.dtype.kind == "f":
        return ["" if math.isnan(v) else v for v in values]
    return values
