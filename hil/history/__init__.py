# SPDX-License-Identifier: Apache-2.0
"""Every run ever judged: kept, compared over time, never erased.

>>> from hil.history.store import open_history
>>> with open_history(DEFAULT_FILE, create=True) as history:
...     history.add(document)

The command line imports this at every start: whatever needs SQLite is in the modules below.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

DEFAULT_FILE: Final = Path("build/history.sqlite")
