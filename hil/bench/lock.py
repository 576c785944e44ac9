# SPDX-License-Identifier: Apache-2.0
"""One run at a time: a lock file beside the bench file.

The lock itself is the kernel's (``flock``), so that it ends with its owner, also when that is
killed outright; a file that was left behind therefore never blocks anyone. The text in the file
only says who the owner is.
"""

from __future__ import annotations

import contextlib
import fcntl
import getpass
import json
import os
import shlex
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from hil.bench.errors import BenchBusyError

POLL_S: Final = 0.1
OWNER_LIMIT_B: Final = 4096


@dataclass(frozen=True)
class Owner:
    """Who holds a bench.

    Attributes:
        user: login name.
        host: machine.
        pid: process.
        command: what was started.
        since_unix_s: when it took the bench.
    """

    user: str
    host: str
    pid: int
    command: str
    since_unix_s: float

    def describe(self, now_unix_s: float) -> str:
        """One line: who, what, where, for how long."""
        held = duration(now_unix_s - self.since_unix_s)
        return f"{self.user} on {self.host} (pid {self.pid}, `{self.command}`) for {held}"


def duration(seconds: float) -> str:
    """A time span in the two largest units that matter."""
    whole = max(int(seconds), 0)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def lock_path(bench: Path) -> Path:
    """The lock file of a bench file."""
    return bench.with_name(f".{bench.name}.lock")


@contextmanager
def hold(
    bench: Path, *, wait_s: float = 0.0, waiting: Callable[[str], None] = lambda text: None
) -> Iterator[None]:
    """Hold the bench for this process; waits up to ``wait_s`` for the one that has it.

    Args:
        bench: the bench file.
        waiting: called once with a sentence that names the owner, when there is one to wait for.

    Raises:
        BenchBusyError: another run has it, or the lock file cannot be written.
    """
    path = lock_path(bench)
    deadline_s = time.monotonic() + wait_s
    told = False
    while (fd := _take(path)) is None:
        owner = owner_of(bench)
        who = owner.describe(time.time()) if owner else "a run that has just started"
        if time.monotonic() >= deadline_s:
            raise BenchBusyError(
                f"the bench {bench} is in use by {who}",
                f"wait for it: --lock-wait {max(60, int(wait_s) * 2)}\n"
                "is that run dead? A dead run holds nothing: this one is alive; "
                + (f"end it with: kill {owner.pid}" if owner else "hil bench unlock names it"),
            )
        if not told:
            waiting(f"waiting up to {duration(wait_s)} for the bench, in use by {who}")
            told = True
        time.sleep(POLL_S)
    try:
        _write_owner(fd)
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(fd)


def owner_of(bench: Path) -> Owner | None:
    """Who holds the bench; None when nobody does."""
    path = lock_path(bench)
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        try:
            # A shared lock: two that only look do not take each other for an owner.
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return None
        except BlockingIOError:
            data = json.loads(os.read(fd, OWNER_LIMIT_B))
            return Owner(
                str(data["user"]),
                str(data["host"]),
                int(data["pid"]),
                str(data["command"]),
                float(data["since_unix_s"]),
            )
    except (OSError, ValueError, KeyError, TypeError):
        return Owner("somebody", "this machine", 0, "unknown", time.time())
    finally:
        os.close(fd)


def _take(path: Path) -> int | None:
    """The locked file; None when another process has it."""
    try:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o664)
    except OSError as error:
        raise BenchBusyError(
            f"the lock file {path} cannot be written: {error.strerror}",
            f"make the folder writable: chmod g+w {path.parent}",
        ) from error
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # The owner before deletes the file: what is locked must still be what the name means.
        if os.path.samestat(os.fstat(fd), os.stat(path)):
            return fd
    except (BlockingIOError, FileNotFoundError):
        pass
    os.close(fd)
    return None


def _write_owner(fd: int) -> None:
    command = shlex.join([Path(sys.argv[0]).name or "python", *sys.argv[1:]])[:500]
    owner = Owner(_user(), socket.gethostname(), os.getpid(), command, time.time())
    os.ftruncate(fd, 0)
    os.pwrite(fd, json.dumps(asdict(owner)).encode(), 0)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())
