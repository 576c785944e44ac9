# SPDX-License-Identifier: Apache-2.0
"""Clean-up that happens even when nobody is left to do it.

:class:`Guard` starts a small process of its own (this file, run as a script) that waits at the
end of a pipe. When the pipe closes without a farewell, its owner was killed: the guard then kills
the process groups and deletes the folders that it was told about.

Only the standard library is imported here, so that the script starts without the package.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import IO, Self

FAREWELL = "done"
GROUP_END_LIMIT_S = 5.0


class Guard:
    """Context manager: whatever it was told about is gone after the block, come what may.

    Leaving the block deletes the folders here and now; the owner ends its processes itself.
    """

    def __init__(self) -> None:
        self._folders: list[Path] = []
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
            # Out of reach of the terminal's Ctrl-C, which would end it together with its owner.
            start_new_session=True,
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for folder in self._folders:
            shutil.rmtree(folder, ignore_errors=True)
        assert self._process is not None
        self._tell(FAREWELL)
        with contextlib.suppress(BrokenPipeError):
            self._stdin().close()
        self._process.wait()

    def watch_group(self, pid: int) -> None:
        """Kill the process group of ``pid`` when the owner is killed."""
        self._tell(f"group {pid}")

    def watch_folder(self, folder: Path) -> None:
        """Delete ``folder``, which need not exist yet, after the block."""
        self._folders.append(folder)
        self._tell(f"folder {folder}")

    def _tell(self, line: str) -> None:
        # A guard that was killed by hand must not fail the run that it guards.
        with contextlib.suppress(BrokenPipeError):
            self._stdin().write(line + "\n")
            self._stdin().flush()

    def _stdin(self) -> IO[str]:
        assert self._process is not None
        assert self._process.stdin is not None
        return self._process.stdin


def main() -> None:
    """Wait for the owner's farewell or death."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: list[int] = []
    folders: list[str] = []
    for line in sys.stdin:
        what, _, value = line.rstrip("\n").partition(" ")
        if what == "group":
            groups.append(int(value))
        elif what == "folder":
            folders.append(value)
        elif what == FAREWELL:
            return
    for group in groups:
        end_group(group)
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)


def end_group(group: int) -> None:
    """Kill a process group and wait until it is empty, or until ``GROUP_END_LIMIT_S``."""
    deadline_s = time.monotonic() + GROUP_END_LIMIT_S
    with contextlib.suppress(ProcessLookupError, PermissionError):
        while time.monotonic() < deadline_s:
            os.killpg(group, signal.SIGKILL)
            time.sleep(0.02)


if __name__ == "__main__":
    main()
