# SPDX-License-Identifier: Apache-2.0
"""Did the last run on a bench come to its end? A mark beside the bench file says when not."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def attempt(bench: Path) -> Iterator[bool]:
    """Marks the bench for the time of a run; True when the run before left its mark.

    A run that fails or is killed leaves the mark; the boards may then be in any state. Where the
    mark cannot be written the bench counts as in order.
    """
    mark = bench.with_name(f".{bench.name}.unfinished")
    before = mark.exists()
    with contextlib.suppress(OSError):
        mark.touch()
    yield before
    with contextlib.suppress(OSError):
        mark.unlink()
