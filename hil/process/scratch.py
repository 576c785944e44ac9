# SPDX-License-Identifier: Apache-2.0
"""A folder for what is needed only for a moment."""

from __future__ import annotations

import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil.process.guard import Guard


@contextmanager
def scratch(name: str, where: Path | None = None) -> Iterator[Path]:
    """A new folder ``hil-NAME-…`` that is gone after the block, even when this process is killed.

    Args:
        where: the folder to make it in; by default the system's for temporary files. In any
            other it is hidden.
    """
    unique = f"hil-{name}-{uuid.uuid4().hex[:12]}"
    folder = Path(tempfile.gettempdir()) / unique if where is None else where / f".{unique}"
    with Guard() as guard:
        # Told before it is made, so that there is no moment at which it could be left.
        guard.watch_folder(folder)
        folder.mkdir(mode=0o700)
        yield folder
