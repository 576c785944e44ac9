# SPDX-License-Identifier: Apache-2.0
"""Raw binary captures: packed samples and nothing else, as ``sigrok-cli -O binary`` writes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from hil.bench.analyser.capture import Capture, check_layout
from hil.errors import RecordingError

PIECE_BYTES = 4 << 20


def open_raw(
    path: Path, *, samplerate_hz: float, channels: Mapping[str, int], unitsize: int = 1
) -> Capture:
    """A raw file as a capture; the file says nothing about itself, so the caller says it.

    Raises:
        RecordingError: the file is not there, is empty, ends within a sample, or the description
            cannot be.
    """
    check_layout(samplerate_hz, channels, unitsize)
    try:
        size = path.stat().st_size
        with path.open("rb"):
            pass
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    if size == 0 or size % unitsize:
        raise RecordingError(
            f"{path}: {size} bytes are not a whole number of samples of {unitsize} bytes",
            "state the unit size that it was written with, as unitsize=",
        )

    def pieces() -> Iterator[bytes]:
        with path.open("rb") as file:
            while piece := file.read(PIECE_BYTES):
                yield piece

    return Capture(samplerate_hz, dict(channels), unitsize, pieces)
