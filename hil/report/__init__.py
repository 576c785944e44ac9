# SPDX-License-Identifier: Apache-2.0
"""Reports: judged recordings -> one JSON document -> page, JUnit file and terminal view.

>>> document = build([(recording, measurements, series)])
>>> write(document, Path("build/report"))
>>> terminal.render(document, Console())
"""

from __future__ import annotations

from hil.report import terminal
from hil.report.document import (
    EXIT_CODES,
    Document,
    NotRun,
    Result,
    build,
    gravest_outcome,
    passed,
    sound,
)
from hil.report.files import write

__all__ = [
    "EXIT_CODES",
    "Document",
    "NotRun",
    "Result",
    "build",
    "gravest_outcome",
    "passed",
    "sound",
    "terminal",
    "write",
]
