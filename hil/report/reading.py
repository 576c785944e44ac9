# SPDX-License-Identifier: Apache-2.0
"""Reports that are read back, from a file that may hold anything."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from hil.errors import HilError
from hil.report.document import SCHEMA_ID, Document
from hil.report.plain import plain

MAX_BYTES: Final = 256 * 2**20
"""An hour of both nodes makes a report of 2 MB."""

_MEND: Final = "name a report.json that hil wrote: hil report RECORDING... -o DIR"


class ReportError(HilError):
    """A file that is not a report, or not one that this version reads."""


def load(path: Path) -> Document:
    """The report in ``path``, or in the folder ``path``, without its series.

    Everything but the series, which nobody who compares reports looks at and which are most of the
    file, has been held against the schema.

    Raises:
        ReportError: no such file, too large, not JSON, or not what the schema says.
    """
    file = path / "report.json" if path.is_dir() else path
    try:
        with file.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > MAX_BYTES:
                raise ReportError(f"{file}: {size} bytes are too many for a report", _MEND)
            document = json.loads(
                stream.read(MAX_BYTES + 1),
                parse_constant=_no_constant,
                parse_float=_finite,
                parse_int=_whole,
            )
    except OSError as error:
        raise ReportError(f"{file} cannot be read: {error.strerror or error}", _MEND) from error
    except (ValueError, RecursionError) as error:
        raise ReportError(f"{file} is not JSON: {error}", _MEND) from error
    return checked(document, str(file))


def is_report(path: Path) -> bool:
    """Whether ``path`` names a report rather than a recording."""
    return path.suffix == ".json" or (path / "report.json").is_file()


def checked(document: Any, where: str) -> Document:
    """``document`` without its series, and as every report of version 1.1 has it.

    Raises:
        ReportError: it is not what the schema says.
    """
    if not isinstance(document, dict) or document.get("$schema") != SCHEMA_ID:
        raise ReportError(f"{where} is not a report: its $schema is not {SCHEMA_ID}", _MEND)
    entries = document.get("recordings")
    if isinstance(entries, list):
        light = [{**e, "series": []} if isinstance(e, Mapping) else e for e in entries]
        document = {**document, "recordings": light}
    fault = next(_validator().iter_errors(document), None)
    if fault is not None:
        place = "/".join(str(part) for part in fault.absolute_path) or "the top"
        raise ReportError(f"{where}: at {place}: {fault.message:.200}", _MEND)
    unknown = {"git": {"commit": "", "state": "unknown"}, "host": {}, "packages": {}}
    read: Document = plain({"rig": unknown, **document}, where)
    for entry in read["recordings"]:
        entry.setdefault("attachments", [])
    return read


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is no JSON number")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text:.40} is no number that a double can hold")
    return value


def _whole(text: str) -> int | float:
    """Integers that no counter can reach become floats, so that arithmetic cannot overflow."""
    return int(text) if len(text) < 19 else _finite(text)


@cache
def _validator() -> Any:
    from jsonschema import Draft202012Validator  # noqa: PLC0415 (start-up time)

    text = (files("hil.report") / "report.schema.json").read_text(encoding="utf-8")
    return Draft202012Validator(json.loads(text))
