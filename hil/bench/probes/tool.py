# SPDX-License-Identifier: Apache-2.0
"""What the runners share that are programs of their own: start, time limit, error."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hil.bench.errors import ProbeLostError
from hil.errors import RigError
from hil.process import Finished, run

READY_S: Final = 6.0
"""Limit for asking a program for its version."""

QUICK_S: Final = 20.0
"""Limit for listing probes, reading registers and resetting."""
READ_S: Final = 60.0
WRITE_S: Final = 120.0
"""1 MiB at the slowest probe's 20 kB/s, and as long again."""

MEND_LOST: Final = (
    "is the board switched on, its USB cable in the debugger's connector, not in nRF USB?\n"
    "unplug the board, wait five seconds, plug it in, run again\n"
    "hil doctor shows which probes are seen"
)


def ask(
    argv: Sequence[str | Path],
    *,
    name: str,
    timeout_s: float = QUICK_S,
    mend: str = MEND_LOST,
    check: bool = True,
) -> Finished:
    """Run a probe's program.

    Raises:
        ProbeLostError: it is not there, took too long or failed.
    """
    return run(argv, name=name, timeout_s=timeout_s, error=ProbeLostError, mend=mend, check=check)


def installed(program: str) -> bool:
    return shutil.which(program) is not None


def first_line(argv: Sequence[str], timeout_s: float = READY_S) -> str:
    """The first line that a program says, whatever its exit status; empty when there is none."""
    try:
        finished = run(argv, name=argv[0], timeout_s=timeout_s, check=False)
    except RigError:
        return ""
    return next((line.strip() for line in finished.lines if line.strip()), "")


def dump(path: Path, size: int, name: str) -> bytes:
    """The memory dump that a program wrote.

    Raises:
        ProbeLostError: it is not there, or has another size than was asked for.
    """
    try:
        found = path.stat().st_size
        if found == size:
            return path.read_bytes()
    except OSError:
        found = 0
    raise ProbeLostError(f"{name} read {found} bytes of the {size} asked for", MEND_LOST)
