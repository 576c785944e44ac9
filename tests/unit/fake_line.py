# SPDX-License-Identifier: Apache-2.0
"""A serial line over a pseudo-terminal, that can be unplugged; and waiting for what it brings."""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Callable
from pathlib import Path


class Board:
    """The far end of a serial line, at ``link``; it can be unplugged and plugged in again."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = -1
        self.plug_in()

    def plug_in(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(slave)
        name = os.ttyname(slave)
        self.link.symlink_to(name)
        os.close(slave)

    def unplug(self) -> None:
        self.link.unlink()
        os.close(self.master)
        self.master = -1

    def resolve(self) -> str | None:
        return str(self.link) if self.link.is_symlink() else None


def until(happens: Callable[[], object], limit_s: float = 10.0) -> None:
    """Wait for ``happens``; fail when it does not within ``limit_s``."""
    deadline_s = time.monotonic() + limit_s
    while not happens():
        assert time.monotonic() < deadline_s, "did not happen in time"
        time.sleep(0.01)
