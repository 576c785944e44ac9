# SPDX-License-Identifier: Apache-2.0
"""One running program: its session, its output, its end."""

from __future__ import annotations

import atexit
import contextlib
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from hil.errors import HilError, RigError
from hil.process.guard import Guard, end_session

TRAMPOLINE = Path(__file__).with_name("trampoline.py")
LINES_KEPT = 4000
STOP_GRACE_S = 2.0
BYTES_AT_ONCE = 1 << 20


class Child:
    """A program started in a session of its own; a context manager that ends all of the session.

    Standard output and error are read together, line by line, by a thread; a carriage return
    ends a line like a newline does. A program whose standard output is data, not text, is given
    ``on_bytes``; the lines are then those of its standard error alone.

    Args:
        argv: program and arguments. The program is a path or is found on ``PATH``.
        name: what messages call it.
        cwd: working folder.
        env: the whole environment; the caller's own by default.
        core: CPU to pin it to.
        on_bytes: called, in a thread of its own, with each piece of standard output. After an
            exception of its own it is called no more, and ``refusal`` holds the exception.
        hold_input: standard input is a pipe for :meth:`send`, not empty.
        error: raised when the program is not there.
        mend: how to get it when it is not there.

    Raises:
        HilError: as ``error``: there is no such program, or no such folder.
    """

    def __init__(
        self,
        argv: Sequence[str | Path],
        *,
        name: str,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
        core: int | None = None,
        on_bytes: Callable[[bytes], None] | None = None,
        hold_input: bool = False,
        error: type[HilError] = RigError,
        mend: str = "",
    ) -> None:
        if isinstance(argv, str) or not argv:
            raise TypeError("argv must be a list of arguments, never a shell line")
        self.argv = tuple(str(part) for part in argv)
        self.name = name
        program = shutil.which(self.argv[0], path=None if env is None else env.get("PATH"))
        if program is None:
            raise error(f"{name}: there is no program '{self.argv[0]}'", mend)
        if cwd is not None and not cwd.is_dir():
            raise error(f"{name}: there is no folder {cwd} to run it in", mend)
        self.lines: deque[str] = deque(maxlen=LINES_KEPT)
        self.refusal: Exception | None = None
        self._fresh: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._popen = subprocess.Popen(
            [
                *(sys.executable, "-I", "-S", str(TRAMPOLINE)),
                *(str(os.getpid()), "-" if core is None else str(core)),
                *(os.path.abspath(program), *self.argv[1:]),
            ],
            stdin=subprocess.PIPE if hold_input else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT if on_bytes is None else subprocess.PIPE,
            cwd=cwd,
            env=None if env is None else dict(env),
            start_new_session=True,
        )
        _guard().watch_session(self.pid)
        assert self._popen.stdout is not None
        self._readers: list[threading.Thread] = []
        if on_bytes is None:
            self._start_reader(self._read, self._popen.stdout)
        else:
            assert self._popen.stderr is not None
            self._start_reader(self._read, self._popen.stderr)
            self._start_reader(self._pass_on, self._popen.stdout, on_bytes)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop(grace_s=STOP_GRACE_S if kind is None else 0.0)

    @property
    def pid(self) -> int:
        """Process id, which is also the id of its process group and its session."""
        return self._popen.pid

    def next_line(self, timeout_s: float) -> str | None:
        """The next line of output.

        Returns:
            None when the output has ended.

        Raises:
            TimeoutError: nothing came in time.
        """
        try:
            return self._fresh.get(timeout=timeout_s)
        except queue.Empty:
            raise TimeoutError from None

    def send(self, data: bytes) -> None:
        """Write to the program's standard input; a program that has gone hears nothing.

        Raises:
            TypeError: the program was started without ``hold_input``.
        """
        if self._popen.stdin is None:
            raise TypeError("the program was started without an input")
        if self._popen.stdin.closed:
            return
        with contextlib.suppress(BrokenPipeError):
            self._popen.stdin.write(data)
            self._popen.stdin.flush()

    def exit_status(self) -> int | None:
        """None while it runs; else its exit status, negative for the signal that killed it."""
        if self._popen.returncode is None and self._has_ended():
            self._end()
        return self._popen.returncode

    def wait(self, timeout_s: float) -> int:
        """Wait for the end and return the exit status.

        Raises:
            TimeoutError: still running.
        """
        deadline_s = time.monotonic() + timeout_s
        while (status := self.exit_status()) is None:
            if time.monotonic() > deadline_s:
                raise TimeoutError
            time.sleep(0.01)
        return status

    def stop(self, grace_s: float = STOP_GRACE_S) -> int:
        """End the whole session: ask, wait ``grace_s``, kill. Safe to repeat."""
        if self.exit_status() is None and grace_s > 0:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGTERM)
            with contextlib.suppress(TimeoutError):
                self.wait(grace_s)
        if self.exit_status() is None:
            self._end()
        if self._popen.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._popen.stdin.close()
        self._join_readers()
        assert self._popen.returncode is not None
        return self._popen.returncode

    def last_words(self, count: int = 40) -> str:
        """The last ``count`` lines of output, indented for a message."""
        # What was written just before the end is on its way through the reading thread.
        if self._popen.returncode is not None:
            self._join_readers()
        lines = [line for line in self.lines if line.strip()][-count:]
        return "\n".join(f"    {line}" for line in lines) or "    (it said nothing)"

    def _start_reader(self, target: Callable[..., None], *args: object) -> None:
        thread = threading.Thread(
            target=target, args=args, name=f"output of {self.name}", daemon=True
        )
        self._readers.append(thread)
        thread.start()

    def _join_readers(self) -> None:
        for thread in self._readers:
            thread.join(timeout=STOP_GRACE_S)

    def _has_ended(self) -> bool:
        options = os.WEXITED | os.WNOHANG | os.WNOWAIT
        return os.waitid(os.P_PID, self.pid, options) is not None

    def _end(self) -> None:
        # While the leader is not reaped, the session's number cannot belong to anyone else.
        end_session(self.pid)
        self._popen.wait()
        _guard().forget_session(self.pid)

    def _read(self, stream: IO[bytes]) -> None:
        rest = b""
        with stream:
            while chunk := os.read(stream.fileno(), 65536):
                *lines, rest = (
                    (rest + chunk).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
                )
                for line in lines:
                    self._keep(line)
        if rest:
            self._keep(rest)
        self._fresh.put(None)

    def _pass_on(self, stream: IO[bytes], on_bytes: Callable[[bytes], None]) -> None:
        with stream:
            while piece := os.read(stream.fileno(), BYTES_AT_ONCE):
                if self.refusal is None:
                    try:
                        on_bytes(piece)
                    except Exception as refusal:
                        # Read on: a program that cannot write would never end.
                        self.refusal = refusal

    def _keep(self, line: bytes) -> None:
        text = line.decode("utf-8", "replace")
        self.lines.append(text)
        self._fresh.put(text)


_GUARDS: dict[int, Guard] = {}
"""Process id -> the guard of all that this process starts; a forked process gets its own."""
_GUARDS_LOCK = threading.Lock()


def _guard() -> Guard:
    owner = os.getpid()
    with _GUARDS_LOCK:
        if owner not in _GUARDS:
            _GUARDS[owner] = Guard().__enter__()
            atexit.register(_leave, owner)
        return _GUARDS[owner]


def _leave(owner: int) -> None:
    if owner == os.getpid():
        _GUARDS.pop(owner).leave()


def describe_status(status: int) -> str:
    """An exit status in words."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"
