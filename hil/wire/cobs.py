# SPDX-License-Identifier: Apache-2.0
"""Consistent Overhead Byte Stuffing: writes any bytes without a 00.

Each group of up to 254 bytes that are not zero is led by a code, the group's length plus one. A
group stands for its bytes and one zero, except the last group, and except a full one (code FF).

Source: S. Cheshire and M. Baker, Consistent Overhead Byte Stuffing, IEEE/ACM Transactions on
Networking 7(2), 1999.
"""

from __future__ import annotations

from typing import Final

FULL: Final = 0xFF
"""Code of a group of 254 bytes, which stands for no zero."""

RUN: Final = FULL - 1
"""Most bytes in a group."""

_CODES: Final = tuple(bytes([length + 1]) for length in range(RUN + 1))
"""By the length of the group."""


def stuff(data: bytes) -> bytes:
    """The shortest stuffed form of ``data``; no delimiters."""
    runs = data.split(b"\0")
    pieces: list[bytes] = []
    for run in runs:
        at = 0
        while len(run) - at >= RUN:
            pieces += _CODES[RUN], run[at : at + RUN]
            at += RUN
        pieces += _CODES[len(run) - at], run[at:]
    # The end needs no group of its own when a full one has just said all.
    if runs[-1] and len(runs[-1]) % RUN == 0:
        del pieces[-2:]
    return b"".join(pieces)


def unstuff(chunk: bytes) -> bytes | None:
    """The message of which ``chunk`` is a stuffed form, or ``None`` when it is of none.

    ``chunk`` must hold no 00.
    """
    message = bytearray()
    at = 0
    while at < len(chunk):
        code = chunk[at]
        message += chunk[at + 1 : at + code]
        at += code
        if code != FULL and at < len(chunk):
            message.append(0)
    return bytes(message) if at == len(chunk) else None
