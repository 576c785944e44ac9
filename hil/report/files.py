# SPDX-License-Identifier: Apache-2.0
"""The files of a report, written so that a reader never finds half of one."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.errors import HilError
from hil.report import html, junit


def write(document: Mapping[str, Any], directory: Path) -> None:
    """Write ``report.json``, ``junit.xml`` and ``index.html`` into ``directory``.

    All three are computed before the first is written, and each replaces its predecessor in one
    step, so that a failure leaves the earlier report as it was.

    Raises:
        HilError: the directory cannot be made or written to.
    """
    contents = {
        "report.json": json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n",
        "junit.xml": junit.render(document),
        "index.html": html.render(document),
    }
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, text in contents.items():
            _replace(directory / name, text.encode("utf-8"))
    except OSError as error:
        raise HilError(
            f"{directory}: the report cannot be written: {error.strerror or error}",
            "name a folder that you may write to: hil report … -o DIR",
        ) from error


def _replace(path: Path, data: bytes) -> None:
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        # mkstemp makes files that only their owner may read; a report is for everyone.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
