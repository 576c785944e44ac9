# SPDX-License-Identifier: Apache-2.0
"""Files that are there whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import secrets
import time
from pathlib import Path
from typing import Final

FORGOTTEN_S: Final = 3600.0
"""No writer takes so long: what is older was left by one that was killed."""


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` to ``path``, making its folder; what was there before stays until the end.

    A reader never finds half of it, and after a power cut there is the old file or the new one.
    A writer that is killed outright leaves at most one hidden file, ``.NAME.`` and eight hex
    digits, beside it; a later write of the same file deletes it when an hour has gone by.

    Raises:
        OSError: the folder or the file cannot be written, or it is a device or a folder.
    """
    if path.exists() and not path.is_file():
        # A rename would put a file in the place of a device.
        raise PermissionError(errno.EPERM, "it is there, and no file", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    _delete_forgotten(path)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with temporary.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def take_name(temporary: Path, path: Path) -> None:
    """Give a file its name, if nobody has it, in one step.

    Raises:
        FileExistsError: the name is taken.
        OSError: the folder cannot be written.
    """
    try:
        # A link, unlike a rename, fails when the name is taken.
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.EMLINK):
            raise
        # A file system without links, such as a memory stick's.
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        os.rename(temporary, path)
    else:
        os.unlink(temporary)


def _delete_forgotten(path: Path) -> None:
    pattern = re.compile(re.escape(f".{path.name}.") + "[0-9a-f]{8}")
    with os.scandir(path.parent) as entries:
        for entry in entries:
            if not pattern.fullmatch(entry.name):
                continue
            try:
                if time.time() - entry.stat(follow_symlinks=False).st_mtime > FORGOTTEN_S:
                    os.unlink(entry.path)
            except OSError:
                # Another writer deleted it first, or it is not ours to delete.
                continue
