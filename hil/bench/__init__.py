# SPDX-License-Identifier: Apache-2.0
"""The real bench: two boards, their probes, serial ports and wires, and who may use them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

BENCH_FILE: Final = Path("boards/bench.toml")
"""Where the bench file is, below the project's folder."""
