# SPDX-License-Identifier: Apache-2.0
"""The machine that a cost was measured on."""

from __future__ import annotations

import platform
from pathlib import Path


def name() -> str:
    """Processor and Python."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    except OSError:
        pass
    return f"{model}, Python {platform.python_version()}"
