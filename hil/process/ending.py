# SPDX-License-Identifier: Apache-2.0
"""SIGTERM and SIGHUP as an orderly way out: what Ctrl-C cleans up, they clean up too."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Final

WORDS: Final = {
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "told to end",
    signal.SIGHUP: "the terminal was closed",
}


class Ended(SystemExit):
    """A signal asked this process to end; its exit status is that of a shell: 128 + number."""

    def __init__(self, number: signal.Signals) -> None:
        super().__init__(128 + number)
        self.number = number

    def __str__(self) -> str:
        return WORDS[self.number]


def end_in_order() -> None:
    """From now on SIGTERM and SIGHUP raise :class:`Ended` in the main thread.

    Python's own answer is to be gone at once, with temporary files left and recordings not closed.
    The first one is enough: more of them do not disturb the cleaning up.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        # A program started with nohup is meant to outlive its terminal.
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> None:
    for one in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(one, signal.SIG_IGN)
    raise Ended(signal.Signals(number))
