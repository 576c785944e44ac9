# SPDX-License-Identifier: Apache-2.0
"""The lines of a text file that may be anything: numbered, and never longer than allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from hil.errors import RecordingError

Bad = Callable[[Path, int, str], RecordingError]
"""The error for a file, a line of it, and what is wrong there."""


def numbered(path: Path, line_bytes_max: int, bad: Bad) -> Iterator[tuple[int, bytes]]:
    """Each line with its number from 1.

    Raises:
        RecordingError: the file cannot be read, or, made by ``bad``, a line is too long.
    """
    try:
        with path.open("rb") as file:
            number = 0
            while line := file.readline(line_bytes_max):
                number += 1
                if len(line) == line_bytes_max:
                    raise bad(path, number, f"a line of {line_bytes_max} bytes or more")
                yield number, line
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
