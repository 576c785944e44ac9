# SPDX-License-Identifier: Apache-2.0
"""Bytes that are no frame -> lines of text, and noise."""

from __future__ import annotations

from typing import Final, NamedTuple

PRINTABLE: Final = bytes(range(0x20, 0x7F)) + b"\t\r\n"


class TextLine(NamedTuple):
    """One line, without its line end; ``offset`` is that of its first byte in the stream."""

    offset: int
    text: str


def find_text(region: bytes, offset: int) -> tuple[list[TextLine], int]:
    """Lines of text in ``region``, which starts at ``offset``, and how many bytes they take.

    A region that is printable throughout is text. In any other region, text is what a node sends as
    text: whole lines ended by CR LF. So a line survives the damage of its neighbour, while the odd
    printable byte of a broken frame does not pass for text. Empty lines take bytes but are not
    listed.
    """
    all_text = _is_printable(region)
    if not all_text and b"\r\n" not in region:
        return [], 0
    lines: list[TextLine] = []
    taken = 0
    at = offset
    *ended, rest = region.split(b"\n")
    for line in ended:
        text = line.rstrip(b"\r")
        if all_text or (text and line.endswith(b"\r") and _is_printable(text)):
            taken += len(line) + 1
            if text:
                lines.append(TextLine(at, text.decode("ascii")))
        at += len(line) + 1
    if all_text:
        taken += len(rest)
        if rest:
            lines.append(TextLine(at, rest.decode("ascii")))
    return lines, taken


def _is_printable(region: bytes) -> bool:
    return not region.translate(None, PRINTABLE)
