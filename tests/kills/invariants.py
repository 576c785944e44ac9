# SPDX-License-Identifier: Apache-2.0
"""What must hold whenever and however a command was stopped."""

from __future__ import annotations

import fcntl
import re
import time
from collections.abc import Iterator
from pathlib import Path

from hil.errors import HilError
from hil.recording import load
from tests.kills import strike
from tests.kills.commands import Command
from tests.kills.strike import Struck

GONE_LIMIT_S = 10.0
"""Until then whoever cleans up after a killed owner must be done, on a busy machine."""
HIDDEN = re.compile(r"\..+\.[0-9a-f]{8}")
KILLS = ("kill", "kill-group")
ORPHAN = "process left"
UNREADABLE = "unreadable"


def broken(command: Command, kind: str, struck: Struck, out: Path, scratch: Path) -> list[str]:
    """Sentences about what does not hold; empty when all does.

    Args:
        out: the folder that the command wrote to.
        scratch: its folder for temporary files.
    """
    found = []
    if struck.status is None:
        found.append(f"it went on for {strike.END_LIMIT_S:.0f} s")
    if kind in (strike.FULL, strike.READ_ONLY) and "Traceback" in struck.said:
        found.append(f"a traceback instead of an error: {struck.said[-600:]}")
    deadline_s = time.monotonic() + GONE_LIMIT_S
    while (left := _left(struck, scratch)) and time.monotonic() < deadline_s:
        time.sleep(0.1)
    found += left
    found += _outputs(command, kind, out)
    found += command.half()
    found += [f"the lock {lock} is held" for lock in command.locks() if _is_held(lock)]
    return found


def _left(struck: Struck, scratch: Path) -> list[str]:
    left = [f"{ORPHAN}: {one}" for one in strike.marked(struck.mark)]
    return left + [f"left in the folder for temporary files: {p.name}" for p in scratch.iterdir()]


def _outputs(command: Command, kind: str, out: Path) -> Iterator[str]:
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if path.name.startswith("."):
            if not (kind in KILLS and HIDDEN.fullmatch(path.name) and path.is_file()):
                yield f"hidden file left: {name}"
        elif path.suffix == ".mcap" and command.records:
            try:
                load(path)
            except HilError as error:
                yield f"{UNREADABLE}: {name}, {path.stat().st_size} bytes: {error.message}"
        elif path.is_file() and not command.is_whole(name, path.read_bytes()):
            yield f"not whole: {name}, {path.stat().st_size} bytes"


def _is_held(lock: Path) -> bool:
    if not lock.exists():
        return False
    with lock.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
