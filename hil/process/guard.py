# SPDX-License-Identifier: Apache-2.0
"""Clean-up that happens even when nobody is left to do it.

:class:`Guard` starts a small process of its own (this file, run as a script) that waits at the
end of a pipe. When the pipe closes without a farewell, its owner was killed: the guard then kills
the sessions of programs and deletes the folders that it was told about.

A program is started in a session of its own. Killing its process group would not do: ninja, for
one, gives each compiler that it starts a group of its own, but all stay in the session.

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
SESSION_END_LIMIT_S = 5.0


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
        self.leave()

    def leave(self) -> None:
        """End the guard; without a farewell it cleans up first."""
        assert self._process is not None
        with contextlib.suppress(BrokenPipeError):
            self._stdin().close()
        self._process.wait()

    def watch_session(self, pid: int) -> None:
        """Kill all of the session that ``pid`` leads when the owner is killed."""
        self._tell(f"session {pid}")

    def forget_session(self, pid: int) -> None:
        """That session has ended, and its number may soon be another's."""
        self._tell(f"ended {pid}")

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
    sessions: dict[int, None] = {}
    folders: list[str] = []
    for line in sys.stdin:
        what, _, value = line.rstrip("\n").partition(" ")
        if what == "session":
            sessions[int(value)] = None
        elif what == "ended":
            sessions.pop(int(value), None)
        elif what == "folder":
            folders.append(value)
        elif what == FAREWELL:
            return
    for session in sessions:
        end_session(session)
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)


def end_session(session: int) -> None:
    """Kill all of a session and wait until it is empty, or until ``SESSION_END_LIMIT_S``."""
    deadline_s = time.monotonic() + SESSION_END_LIMIT_S
    while (left := running(session)) and time.monotonic() < deadline_s:
        for pid in left:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.005)


def running(session: int) -> list[int]:
    """The processes of a session that have not ended."""
    found = []
    for name in os.listdir("/proc"):
        if not name.isdecimal():
            continue
        try:
            with open(f"/proc/{name}/stat", "rb") as file:
                # After the name in brackets: state, parent, group, session (man 5 proc).
                fields = file.read().rpartition(b")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] not in (b"Z", b"X"):
            found.append(int(name))
    return found


if __name__ == "__main__":
    main()
