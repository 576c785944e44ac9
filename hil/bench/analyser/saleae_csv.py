# SPDX-License-Identifier: Apache-2.0
"""Digital exports of Saleae Logic 2: ``digital.csv``, one row each time any channel changes.

The first row is the first sample; times are relative to it or to the trigger
(https://support.saleae.com/user-guide/using-logic/exporting-data).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from hil.bench.analyser.capture import CaptureEdges
from hil.bench.analyser.edges import TimedChanges
from hil.bench.analyser.lines import numbered
from hil.errors import RecordingError, printable

LINE_BYTES_MAX = 1 << 12
PS_PER_S = 10**12
PS_PER_NS = 1000
PRINTED_S = 1e-9
"""Logic 2 prints nanoseconds."""


def read_saleae_csv(path: Path, *, samplerate_hz: float) -> CaptureEdges:
    """The edges of an export.

    Args:
        samplerate_hz: digital rate that was set; the export does not say it.

    Raises:
        RecordingError: not such an export; the message names the line.
    """
    lines = _lines(path)
    number, header = next(lines, (0, ""))
    names = [name.strip().strip('"') for name in header.split(",")]
    if names[0] != "Time [s]" or len(names) < 2:
        mend = "export digital channels as CSV, without ISO8601 timestamps"
        raise RecordingError(f"{path}: line 1: no 'Time [s],Channel 0,...'", mend)
    changes = TimedChanges(str(path), names[1:], samplerate_hz=samplerate_hz, tick_s=PRINTED_S)
    first_ps: int | None = None
    for number, line in lines:
        time, *levels = line.split(",")
        if len(levels) != len(names) - 1 or not set(levels) <= {"0", "1"}:
            raise _bad(path, number, f"not a time and {len(names) - 1} levels of 0 or 1")
        t_ps = _picoseconds(path, number, time)
        first_ps = t_ps if first_ps is None else first_ps
        sample = changes.at((t_ps - first_ps) / PS_PER_NS, number)
        for channel, level in enumerate(levels):
            changes.put(sample, channel, int(level), number)
    if first_ps is None:
        raise _bad(path, number, "no row follows")
    return changes.finish()


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    for number, line in numbered(path, LINE_BYTES_MAX, _bad):
        yield number, line.decode("utf-8-sig", "replace").rstrip("\r\n")


def _picoseconds(path: Path, line: int, text: str) -> int:
    match = re.fullmatch(r"(-?)([0-9]{1,9})(?:\.([0-9]{1,18}))?", text)
    if match is None:
        raise _bad(path, line, f"'{text[:24]}' is no time in seconds")
    size = int(match[2]) * PS_PER_S + int((match[3] or "").ljust(12, "0")[:12])
    return -size if match[1] else size


def _bad(path: Path, line: int, what: str) -> RecordingError:
    return RecordingError(printable(f"{path}: line {line}: {what}"), "export it anew from Logic 2")
