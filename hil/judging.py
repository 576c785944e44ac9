# SPDX-License-Identifier: Apache-2.0
"""Recordings judged side by side: one process per processor, one recording at a time in each."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from hil import checks
from hil.measure import Measurement
from hil.process.pool import pool
from hil.recording import load
from hil.series import Series

Judged = tuple[list[Measurement], list[Series]]


def judge_files(files: Sequence[Path], jobs: int | None = None) -> Iterator[Judged]:
    """Measurements and series of each recording, in the order of ``files``.

    Args:
        jobs: processes; default: as many as this one may use. With one, or one file, all happens
            here.

    Raises:
        HilError: a recording cannot be read; as :func:`hil.recording.load` has it.
    """
    jobs = min(jobs or len(os.sched_getaffinity(0)), len(files))
    if jobs <= 1:
        yield from map(_judge, files)
        return
    # Not forked: the caller may have threads, such as a progress bar's, that hold locks.
    with pool(jobs, context=multiprocessing.get_context("spawn")) as workers:
        yield from workers.map(_judge, files)


def _judge(file: Path) -> Judged:
    recording = load(file)
    return checks.evaluate(recording), checks.series(recording)
