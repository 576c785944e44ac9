# SPDX-License-Identifier: Apache-2.0
"""Loading a recording: whatever is sound, and a plain account of what is not."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import BinaryIO, Final

from hil.errors import RecordingError
from hil.recording import container, layout
from hil.recording.assembler import RECORD_AGAIN, Assembler
from hil.recording.container import MAGIC, Problems
from hil.recording.model import Recording

_MAGIC_BYTES_ENOUGH: Final = 6
"""Of eight: fewer agreeing bytes than this and the file was never an MCAP file."""

_NOT_OURS: Final = "`hil record` did not write it like this; " + RECORD_AGAIN


def load(path: Path | str, *, max_bytes: int = layout.MAX_TOTAL_BYTES) -> Recording:
    """Read a recording, cut or damaged ones up to what is sound.

    Args:
        path: the ``.mcap`` file.
        max_bytes: limit of the uncompressed contents; memory stays within about twice that.

    Raises:
        RecordingError: the path is not a readable file, not a recording, written by a newer
            version, larger than ``max_bytes``, or so damaged that its provenance is gone.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        # ValueError: a path that no file can have, such as one with a NUL in it.
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise RecordingError(
            f"{str(path)!r} cannot be opened: {reason}",
            "check the path; `hil record` makes recordings",
        ) from error
    try:
        return _load(path, mode, max_bytes)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error.message}", error.mend or _NOT_OURS) from None
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read: {error.strerror}", "check its permissions and its disk"
        ) from error
    except MemoryError as error:
        raise RecordingError(
            f"{path}: does not fit in memory", "load it where there is more, or record less"
        ) from error


def _load(path: Path, mode: int, max_bytes: int) -> Recording:
    if stat.S_ISDIR(mode):
        inside = sorted(path.glob("*.mcap"))
        mend = f"did you mean {inside[0]}?" if inside else "name the .mcap file itself"
        raise RecordingError("is a folder, not a recording", mend)
    if not stat.S_ISREG(mode):
        raise RecordingError("is not a regular file", "name the .mcap file of a recording")
    with path.open("rb") as file:
        size = file.seek(0, 2)
        problems = Problems()
        _check_magic(file, size, problems)
        tail = container.read_tail(file, size, problems)
        assembler = Assembler(tail, problems)
        for chunk in container.sound_chunks(file, size, tail, problems, max_bytes):
            assembler.take(chunk)
    return assembler.finish(path)


def _check_magic(file: BinaryIO, size: int, problems: Problems) -> None:
    file.seek(0)
    start = file.read(64)
    if not size:
        raise RecordingError(
            "is empty", "the run was ended before anything was recorded; " + RECORD_AGAIN
        )
    if start.startswith(b"version https://git-lfs"):
        raise RecordingError("is only a pointer to a Git LFS object", "git lfs pull")
    agreeing = sum(a == b for a, b in zip(start, MAGIC, strict=False))
    if agreeing < min(_MAGIC_BYTES_ENOUGH, size):
        raise RecordingError(
            f"is not an MCAP file: it begins with {start[:16]!r}",
            "name the .mcap file of a recording; foreign data is imported, not opened",
        )
    if agreeing < len(MAGIC):
        problems.add("the first bytes of the file are damaged or cut")
