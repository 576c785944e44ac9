# SPDX-License-Identifier: Apache-2.0
"""What all targets share: a file to put hostile bytes in, and what an error must look like."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

from hil.errors import HilError

SPLIT: Final = b"\xff\xfe"
"""Parts the pieces of an input that a target seals with right lengths and checksums itself."""

MESSAGE_MAX: Final = 1000

Read = TypeVar("Read")


@cache
def _folder() -> Path:
    # In memory where there is such a place: a target writes thousands of files a second.
    memory = Path("/dev/shm")
    place = memory if os.access(memory, os.W_OK) else None
    holder = tempfile.TemporaryDirectory(prefix="hil-fuzz-", dir=place)
    _HOLDERS.append(holder)
    return Path(holder.name)


_HOLDERS: list[tempfile.TemporaryDirectory[str]] = []
"""Removes the folder when the process ends."""


def hostile_file(name: str, data: bytes) -> Path:
    """A file that holds ``data``; the one of the call before is gone."""
    path = _folder() / name
    path.write_bytes(data)
    return path


def read_or_refuse(path: Path, read: Callable[[Path], Read]) -> Read | None:
    """What ``read`` makes of the file; None when it refuses the file as it should.

    Raises:
        AssertionError: the refusal is not one line that names the file.
        Exception: whatever else ``read`` let out.
    """
    try:
        return read(path)
    except HilError as error:
        check_refusal(error, path)
        return None


def check_refusal(error: HilError, path: Path) -> None:
    """One printable line of bearable length that names the file, and mends of one line each."""
    assert str(path) in error.message, f"does not name the file: {error.message!r}"
    assert error.message.isprintable(), f"not one printable line: {error.message!r}"
    assert len(error.message) - len(str(path)) <= MESSAGE_MAX, f"{len(error.message)} characters"
    assert all(line.isprintable() for line in error.mend.split("\n")), repr(error.mend)
    assert len(error.mend) <= MESSAGE_MAX, f"a mend of {len(error.mend)} characters"
