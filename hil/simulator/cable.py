# SPDX-License-Identifier: Apache-2.0
"""A serial cable with a terminal at both ends, so that two programs can each open theirs.

Nothing is lost: when one end is not read, the other one waits, back to the simulation itself.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import tty
from typing import Final

CHUNK: Final = 4096
WAIT_S: Final = 0.1


class Cable:
    """Two pseudoterminals and a thread that copies between them.

    Attributes:
        inner, outer: paths of the two ends.
    """

    def __init__(self) -> None:
        self._fds: list[int] = []
        one, self.inner = self._end()
        other, self.outer = self._end()
        self._masters = (one, other)
        self._leaving = threading.Event()
        self._thread = threading.Thread(target=self._copy, name="serial cable", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._leaving.set()
        self._thread.join()
        for fd in self._fds:
            os.close(fd)

    def _end(self) -> tuple[int, str]:
        master, slave = os.openpty()
        for fd in (master, slave):
            tty.setraw(fd)
        os.set_blocking(master, False)
        # The slave stays open here, so that its other user can come and go.
        self._fds += [master, slave]
        return master, os.ttyname(slave)

    def _copy(self) -> None:
        one, other = self._masters
        peer = {one: other, other: one}
        waiting = {one: b"", other: b""}
        while not self._leaving.is_set():
            # An end is read when what came from it before has been passed on.
            readable, writable, _ = select.select(
                [fd for fd in peer if not waiting[fd]],
                [peer[fd] for fd in peer if waiting[fd]],
                [],
                WAIT_S,
            )
            for fd in readable:
                with contextlib.suppress(BlockingIOError):
                    waiting[fd] = os.read(fd, CHUNK)
            for fd in writable:
                with contextlib.suppress(BlockingIOError):
                    sent = os.write(fd, waiting[peer[fd]])
                    waiting[peer[fd]] = waiting[peer[fd]][sent:]
