# SPDX-License-Identifier: Apache-2.0
"""Every run ever judged: kept, compared over time, never erased.

>>> with open_history(DEFAULT_FILE, create=True) as history:
...     history.add(document)
"""

from __future__ import annotations

from hil.history.store import DEFAULT_FILE, Added, History, HistoryError, open_history

__all__ = ["DEFAULT_FILE", "Added", "History", "HistoryError", "open_history"]
