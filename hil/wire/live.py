# SPDX-License-Identifier: Apache-2.0
"""A stream that is decoded while it comes in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from hil.wire.codec import Decoded, decode

UNDELIMITED_MAX: Final = 1 << 16
"""Bytes without a 00 after which nothing can come that begins in them."""


class LiveStream:
    """Takes bytes as they come and gives what has become whole.

    Each :class:`Decoded` stands for itself: its offsets count from the start of its own bytes, and
    frames lost between two of them are not among its losses.

    Args:
        schema: as :func:`hil.wire.codec.decode`.
    """

    def __init__(self, schema: Mapping[str, Any] | None = None) -> None:
        self._rest = b""
        self._schema = schema

    def feed(self, data: bytes) -> Decoded:
        """What ``data`` has made whole; what has not ended yet waits for the next call."""
        stream = self._rest + data
        end = stream.rfind(b"\0")
        # The last 00 may open a frame, too.
        self._rest = stream[max(end, 0) :]
        if len(self._rest) > UNDELIMITED_MAX:
            self._rest = b""
        return decode(stream[: end + 1], self._schema)
