# SPDX-License-Identifier: Apache-2.0
"""How much memory this process has."""

from __future__ import annotations

import os
from pathlib import Path


def rss_kib() -> int:
    """Resident memory of this process (``man 5 proc``, statm)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024
