# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, kill and a closed terminal as the ordinary end of a command, not as an accident."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from hil.process.ending import WORDS


@contextmanager
def told_to_stop() -> Iterator[Callable[[], str]]:
    """Gives a function that says why to end, or nothing while there is no reason.

    A second Ctrl-C interrupts in the usual way.
    """
    reasons: list[str] = []

    def told(number: int, frame: FrameType | None) -> None:
        reasons.append(WORDS[signal.Signals(number)])
        signal.signal(number, before[signal.Signals(number)])

    before = {one: signal.getsignal(one) for one in WORDS}
    for one in WORDS:
        signal.signal(one, told)
    try:
        yield lambda: reasons[0] if reasons else ""
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
