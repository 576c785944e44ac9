# SPDX-License-Identifier: Apache-2.0
"""One serial port of a board, read without pause, that survives being unplugged.

Debuggers drop off the bus when they are flashed, and cables get kicked. A port that is lost is
looked up again by what the board is, not by where it was, and the time without it is recorded:
what the board said then is gone, and whoever judges the run must know.
"""

from __future__ import annotations

import contextlib
import errno
import os
import termios
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hil.errors import RigError

BAUD = 1_000_000
READ_LIMIT_S = 0.1
RETRY_S = 0.05
REPLUG_LIMIT_S = 30.0
QUEUE_BYTES_MAX = 64 << 20
"""Eleven minutes at 1 Mbaud."""
CLOSE_LIMIT_S = 5.0


@dataclass(frozen=True)
class Chunk:
    """What one read brought.

    Attributes:
        t_ns_host: when it returned, host's monotonic clock.
        data: the bytes.
    """

    t_ns_host: int
    data: bytes


@dataclass(frozen=True)
class Gap:
    """A time without the port, host's monotonic clock; what was sent in it is lost."""

    t_lost_ns: int
    t_back_ns: int


class SerialPort:
    """An open serial port and the thread that reads it; a context manager.

    8 data bits, no parity, 1 stop bit, no flow control, locked against other programs.

    Attributes:
        path: device file.
        gaps: times without the port that are over.
        lost_ns: since when it has been away, host's monotonic clock; None while it is there.

    Args:
        path: device file.
        baud: line rate.
        resolve: gives the path of the same board's port now, or None while it is not there. A
            port without it is not opened again when lost: its path could be another board's.
        log: file that every byte read is appended to.
        replug_limit_s: how long a lost port is waited for.
        queue_bytes_max: how much may wait to be taken by :meth:`read`.

    Raises:
        RigError: the port is not there, not permitted, or in use, and by whom.
    """

    def __init__(
        self,
        path: str | Path,
        baud: int = BAUD,
        resolve: Callable[[], str | None] | None = None,
        log: Path | None = None,
        *,
        replug_limit_s: float = REPLUG_LIMIT_S,
        queue_bytes_max: int = QUEUE_BYTES_MAX,
    ) -> None:
        self.path = str(path)
        self.gaps: list[Gap] = []
        self.lost_ns: int | None = None
        self._baud = baud
        self._resolve = resolve
        self._replug_limit_s = replug_limit_s
        self._queue_bytes_max = queue_bytes_max
        self._changed = threading.Condition()
        self._waiting: deque[Chunk] = deque()
        self._waiting_bytes = 0
        self._failure: RigError | None = None
        self._closing = False
        self._serial: Any = open_serial(self.path, baud)
        self._log: FileIO | None = None
        try:
            self._log = None if log is None else log.open("ab", buffering=0)
        except OSError as error:
            self._serial.close()
            raise RigError(f"{log}: the log cannot be written: {error.strerror}") from error
        self._thread = threading.Thread(target=self._read, name=f"port {path}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def read(self, timeout_s: float) -> list[Chunk]:
        """Everything that came since the last call; waits when nothing did.

        Returns:
            Empty when nothing came in time.

        Raises:
            RigError: the port is lost for good, or came faster than it was taken; what had come
                before is given first.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._failure, timeout_s)
            taken = list(self._waiting)
            self._waiting.clear()
            self._waiting_bytes = 0
            if not taken and self._failure is not None:
                raise self._failure
        return taken

    def read_bytes(self, timeout_s: float) -> bytes:
        """As :meth:`read`, the bytes alone."""
        return b"".join(chunk.data for chunk in self.read(timeout_s))

    def write(self, data: bytes) -> None:
        """Send ``data``.

        Raises:
            RigError: the port is lost or takes nothing; how much was sent is not known.
        """
        try:
            self._serial.write(data)
        except _lost_errors() as error:
            raise RigError(
                f"{self.path}: {len(data)} bytes could not be sent: {error}",
                "write again when the port is back",
            ) from error

    def close(self) -> None:
        """Let go of the port and of the log."""
        self._closing = True
        self._thread.join(CLOSE_LIMIT_S)
        self._close_serial()
        if self._log is not None:
            self._log.close()

    def _read(self) -> None:
        errors = _lost_errors()
        while not self._closing and self._failure is None:
            try:
                data = self._serial.read(self._serial.in_waiting or 1)
            except errors as error:
                self._find_again(time.monotonic_ns(), error)
                continue
            if data:
                self._keep(Chunk(time.monotonic_ns(), data))

    def _keep(self, chunk: Chunk) -> None:
        if self._log is not None:
            try:
                if self._log.write(chunk.data) != len(chunk.data):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            except OSError as error:
                self._fail(RigError(f"{self._log.name}: cannot be written: {error.strerror}"))
                return
        with self._changed:
            full = self._waiting_bytes + len(chunk.data) > self._queue_bytes_max
            if not full:
                self._waiting.append(chunk)
                self._waiting_bytes += len(chunk.data)
                self._changed.notify_all()
        if full:
            self._fail(
                RigError(
                    f"{self.path}: {self._queue_bytes_max} bytes wait and nobody takes them",
                    "read the port more often",
                )
            )

    def _find_again(self, t_lost_ns: int, error: Exception) -> None:
        self.lost_ns = t_lost_ns
        self._close_serial()
        if self._resolve is None:
            self._fail(
                RigError(
                    f"{self.path}: the port was lost: {error}",
                    "look at the cable and the board's power switch\n"
                    "open ports by the debugger's serial number, so that they can be found again",
                )
            )
            return
        deadline_s = time.monotonic() + self._replug_limit_s
        while not self._closing:
            if self._open_again():
                self.gaps.append(Gap(t_lost_ns, time.monotonic_ns()))
                self.lost_ns = None
                return
            if time.monotonic() > deadline_s:
                self._fail(
                    RigError(
                        f"{self.path}: the port was lost and did not come back within "
                        f"{self._replug_limit_s:g} s: {error}",
                        "look at the cable and the board's power switch\ndmesg | tail",
                    )
                )
                return
            time.sleep(RETRY_S)

    def _open_again(self) -> bool:
        assert self._resolve is not None
        try:
            path = self._resolve()
            if path is None:
                return False
            port = open_serial(path, self._baud)
        except RigError:
            return False
        # Names are given anew while boards come back: the one opened must still be the board's.
        if not _still(self._resolve, path):
            port.close()
            return False
        self.path, self._serial = path, port
        return True

    def _close_serial(self) -> None:
        with contextlib.suppress(*_lost_errors()):
            self._serial.close()

    def _fail(self, failure: RigError) -> None:
        with self._changed:
            self._failure = failure
            self._changed.notify_all()


def open_serial(path: str, baud: int) -> Any:
    """Open and lock a port.

    Raises:
        RigError: not there, not permitted, in use, or no serial port.
    """
    import serial  # noqa: PLC0415

    try:
        return serial.Serial(
            path, baud, timeout=READ_LIMIT_S, write_timeout=CLOSE_LIMIT_S, exclusive=True
        )
    except _lost_errors() as error:
        raise _cannot_open(path, error) from error


def holders(path: str) -> list[str]:
    """Programs that have the device open, as ``name (pid)``, as far as we may look."""
    device = os.path.realpath(path)
    found = []
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            pid = link.parts[2]
            if os.readlink(link) == device and int(pid) != os.getpid():
                found.append(f"{Path('/proc', pid, 'comm').read_text().strip()} ({pid})")
    return sorted(set(found))


def _cannot_open(path: str, error: Exception) -> RigError:
    match getattr(error, "errno", None):
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            return RigError(
                f"{path}: there is no such serial port",
                "plug the board in and switch it on\nls /dev/ttyACM*",
            )
        case errno.EACCES | errno.EPERM:
            return RigError(
                f"{path}: permission denied",
                "sudo usermod -aG dialout $USER, then log in anew\n"
                "or install a udev rule for the debugger",
            )
        case errno.EAGAIN | errno.EBUSY:
            who = ", ".join(holders(path)) or "a program of this process or another user"
            return RigError(f"{path}: in use by {who}", "close it, then try again")
    return RigError(f"{path}: cannot be opened as a serial port: {error}", "ls -l " + path)


def _still(resolve: Callable[[], str | None], path: str) -> bool:
    with contextlib.suppress(RigError):
        return resolve() == path
    return False


def _lost_errors() -> tuple[type[Exception], ...]:
    """What an unplugged port raises; pyserial lets three kinds through."""
    import serial  # noqa: PLC0415

    return (serial.SerialException, OSError, termios.error)
