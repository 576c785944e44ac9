# SPDX-License-Identifier: Apache-2.0
"""Reading a file that another program is still writing."""

from __future__ import annotations

from pathlib import Path
from typing import IO


class Tail:
    """Gives what was appended to ``path`` since the last look; the file may not exist yet."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[bytes] | None = None

    def read(self) -> bytes:
        """The new bytes; empty when there are none."""
        if self._file is None:
            try:
                self._file = self._path.open("rb")
            except FileNotFoundError:
                return b""
        return self._file.read()

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
