# SPDX-License-Identifier: Apache-2.0
"""Rows of the history as text for other programs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hil.atomic import write_whole
from hil.errors import HilError


def as_csv(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """RFC 4180 with a heading; an empty field where there is no number."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


def as_json(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A list of objects; infinities, which JSON has not, as the strings inf and -inf."""

    def plain(value: Any) -> Any:
        return repr(value) if isinstance(value, float) and not math.isfinite(value) else value

    records = [dict(zip(columns, map(plain, row), strict=True)) for row in rows]
    return json.dumps(records, indent=1, allow_nan=False) + "\n"


def write(path: Path, text: str) -> None:
    """Write ``text``, whole or not at all.

    Raises:
        HilError: the file cannot be written.
    """
    try:
        write_whole(path, text.encode("utf-8"))
    except OSError as error:
        raise HilError(
            f"{path} cannot be written: {error.strerror or error}",
            "name a file that you may write to: -o history.csv",
        ) from error
