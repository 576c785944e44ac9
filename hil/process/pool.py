# SPDX-License-Identifier: Apache-2.0
"""This program in several processes, none of which outlives the first."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import BaseContext
from typing import Any

from hil.process.trampoline import die_with_parent


@contextmanager
def pool(
    jobs: int | None = None,
    *,
    context: BaseContext | None = None,
    initializer: Callable[..., None] | None = None,
    initargs: tuple[Any, ...] = (),
) -> Iterator[ProcessPoolExecutor]:
    """A pool of ``jobs`` processes, as many as processors when None.

    Leaving the block after an exception, a Ctrl-C among them, ends the processes at once, whatever
    they are at; otherwise they end when they have done what they were given.
    """
    before = set(multiprocessing.active_children())
    made = ProcessPoolExecutor(
        jobs,
        mp_context=context,
        initializer=_begin,
        initargs=(os.getpid(), initializer, initargs),
    )
    try:
        yield made
    except BaseException:
        for child in multiprocessing.active_children():
            if child not in before:
                child.kill()
        raise
    finally:
        made.shutdown(wait=True, cancel_futures=True)


def _begin(
    parent_pid: int, initializer: Callable[..., None] | None, initargs: tuple[Any, ...]
) -> None:
    # Whoever started this process ends it; a Ctrl-C at the terminal reaches the whole group.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    die_with_parent(parent_pid)
    if initializer is not None:
        initializer(*initargs)
