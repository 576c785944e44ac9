# SPDX-License-Identifier: Apache-2.0
"""The files of a report, written so that a reader never finds half of one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.atomic import write_whole
from hil.errors import HilError
from hil.report import badge, html, junit


def write(document: Mapping[str, Any], directory: Path) -> None:
    """Write ``report.json``, ``junit.xml``, ``badge.json`` and ``index.html`` into ``directory``.

    All are computed before the first is written, and each replaces its predecessor in one
    step, so that a failure leaves the earlier report as it was.

    Raises:
        HilError: the directory cannot be made or written to.
    """
    contents = {
        "report.json": json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n",
        "junit.xml": junit.render(document),
        "badge.json": json.dumps(badge.render(document)) + "\n",
        "index.html": html.render(document),
    }
    try:
        for name, text in contents.items():
            write_whole(directory / name, text.encode("utf-8"))
    except OSError as error:
        raise HilError(
            f"{directory}: the report cannot be written: {error.strerror or error}",
            "name a folder that you may write to: hil report … -o DIR",
        ) from error
