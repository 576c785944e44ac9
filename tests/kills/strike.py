# SPDX-License-Identifier: Apache-2.0
"""One command, started on a terminal of its own and stopped in one of the ways there are."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

SIGNALS: Final[Mapping[str, tuple[int, bool]]] = {
    "ctrl-c": (signal.SIGINT, True),
    "int": (signal.SIGINT, False),
    "term": (signal.SIGTERM, False),
    "term-group": (signal.SIGTERM, True),
    "hup": (signal.SIGHUP, False),
    "kill": (signal.SIGKILL, False),
    "kill-group": (signal.SIGKILL, True),
}
"""Kind -> signal, and whether the whole foreground process group gets it."""
CLOSED: Final = "closed terminal"
FULL: Final = "full disk"
READ_ONLY: Final = "read-only disk"
KINDS: Final = (*SIGNALS, CLOSED, FULL, READ_ONLY)
MARK: Final = "HIL_KILLS"
END_LIMIT_S: Final = 90.0


@dataclass(frozen=True)
class Struck:
    """What became of the command: exit status (None: it hung and was killed), its words, times."""

    status: int | None
    said: str
    after_s: float
    took_s: float
    mark: str


def run(
    argv: list[str],
    environment: Mapping[str, str],
    cwd: Path,
    kind: str | None = None,
    after_s: float = 0.0,
) -> Struck:
    """Run ``argv`` on a terminal, strike after ``after_s`` unless it has ended, wait for its end.

    ``kind`` None, or one of the disks, does not strike.
    """
    mark = uuid.uuid4().hex
    begin_s = time.monotonic()
    with Terminal() as terminal:
        process = subprocess.Popen(
            [sys.executable, "-IS", str(Path(__file__).with_name("session.py")), *argv],
            stdin=terminal.slave,
            stdout=terminal.slave,
            stderr=terminal.slave,
            cwd=cwd,
            env={**environment, MARK: mark},
            start_new_session=True,
        )
        os.close(terminal.slave)
        strikes_s = begin_s + after_s if kind in SIGNALS or kind == CLOSED else float("inf")
        end_s = begin_s + (END_LIMIT_S + after_s if kind else 10 * END_LIMIT_S)
        while process.poll() is None and time.monotonic() < end_s:
            terminal.listen(0.02)
            if time.monotonic() >= strikes_s:
                strikes_s, end_s = float("inf"), time.monotonic() + END_LIMIT_S
                if kind == CLOSED:
                    terminal.close()
                else:
                    _strike(process.pid, str(kind))
        status = process.poll()
        if status is None:
            process.kill()
            process.wait()
        terminal.listen(0.0)
    return Struck(status, terminal.said, after_s, time.monotonic() - begin_s, mark)


def _strike(pid: int, kind: str) -> None:
    number, group = SIGNALS[kind]
    with contextlib.suppress(ProcessLookupError):
        (os.killpg if group else os.kill)(pid, number)


class Terminal:
    """A pseudoterminal; closing it hangs up what runs on it."""

    def __init__(self) -> None:
        self._master, self.slave = os.openpty()
        self._heard = bytearray()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def said(self) -> str:
        return self._heard.decode("utf-8", "replace")

    def close(self) -> None:
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def listen(self, wait_s: float) -> None:
        if self._master < 0:
            time.sleep(wait_s)
            return
        while select.select([self._master], [], [], wait_s)[0]:
            try:
                self._heard += os.read(self._master, 65536)
            except OSError:
                # The other end is closed.
                time.sleep(wait_s)
                return
            wait_s = 0.0


@contextmanager
def disk(folder: Path, kind: str, room_b: int) -> Iterator[None]:
    """Make ``folder`` a disk of its own with room for ``room_b`` bytes beside what it holds, or
    one that cannot be written to. What it held before is there again afterwards.

    Raises:
        PermissionError: this user may not mount.
    """
    with tempfile.TemporaryDirectory(prefix="hil-kills-") as kept:
        shutil.copytree(folder, kept, symlinks=True, dirs_exist_ok=True)
        _mount("-t", "tmpfs", "hil-kills", str(folder))
        try:
            shutil.copytree(kept, folder, symlinks=True, dirs_exist_ok=True)
            blocks = os.statvfs(folder)
            used_b = (blocks.f_blocks - blocks.f_bfree) * blocks.f_frsize
            limit = f"size={used_b + max(room_b, 4096)}" if kind == FULL else "ro"
            _mount("-o", f"remount,{limit}", str(folder))
            yield
        finally:
            subprocess.run(["umount", "-l", str(folder)], check=False)


def _mount(*arguments: str) -> None:
    made = subprocess.run(["mount", *arguments], check=False, capture_output=True, text=True)
    if made.returncode:
        raise PermissionError(made.stderr.strip())


def marked(mark: str) -> list[str]:
    """The processes that still run and were started, by whomever, from a struck command."""
    wanted = f"{MARK}={mark}".encode()
    found = []
    for place in Path("/proc").iterdir():
        if not place.name.isdecimal():
            continue
        try:
            environment = (place / "environ").read_bytes().split(b"\0")
            words = (place / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        # A zombie has neither.
        if wanted in environment and words:
            found.append(f"{place.name}: {words[:100]}")
    return found
