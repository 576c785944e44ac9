# SPDX-License-Identifier: Apache-2.0
"""The whole report of recordings of 1, 10 and 60 minutes: processor time and peak memory."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import Row
from benchmarks.recordings import minutes


def rows() -> list[Row]:
    return [_row(duration) for duration in (1, 10, 60)]


def _row(duration: int) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        seconds, peak_mb = child(
            [sys.executable, "-m", "benchmarks.report", str(minutes(duration)), folder]
        )
        pages = sum(p.stat().st_size for p in Path(folder).iterdir())
    met = seconds <= 10 and peak_mb <= 500
    return Row(
        work=f"report of {duration} min",
        ours=f"{seconds:.1f} s, peak {peak_mb:.0f} MB, {pages / 1e6:.1f} MB written",
        peer="none",
        ratio=None,
        limit=None,
        aim="10 s, 500 MB",
        met=met,
        lacking=""
        if met
        else f"{seconds / 10:.1f} times the time, {peak_mb / 500:.1f} times the memory: the "
        "recording, its records and what the checks keep for each other are held at once; letting "
        "go of a suite's arrays when the next one does not ask for them comes next",
    )


def child(argv: list[str]) -> tuple[float, float]:
    """Processor time, s, and peak memory, MB, of a program that must end with 0."""
    with open(os.devnull, "wb") as nothing:
        actions = [(os.POSIX_SPAWN_DUP2, nothing.fileno(), 1)]
        process = os.posix_spawn(argv[0], argv, dict(os.environ), file_actions=actions)
        _, status, used = os.wait4(process, 0)
    if os.waitstatus_to_exitcode(status):
        raise RuntimeError(f"{' '.join(argv)} ended with {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


if __name__ == "__main__":
    from hil import report as views
    from hil.judging import judge_loaded
    from hil.recording import load

    source, output = map(Path, sys.argv[1:])
    recording = load(source)
    (found,) = judge_loaded([(source, recording)])
    views.write(views.build([views.Result(recording, *found)]), output)
