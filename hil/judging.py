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
from hil.recording import Recording, load
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


def judge_loaded(loaded: Sequence[tuple[Path, Recording]]) -> Iterator[Judged]:
    """As :func:`judge_files`, of recordings that are in memory already.

    One alone is judged as it is; other processes read theirs from the files.
    """
    if len(loaded) == 1:
        yield _judge_one(loaded[0][1])
    else:
        yield from judge_files([path for path, _ in loaded])


def _judge(file: Path) -> Judged:
    return _judge_one(load(file))


def _judge_one(recording: Recording) -> Judged:
    return checks.evaluate(recording), checks.series(recording)
