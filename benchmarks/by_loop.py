# SPDX-License-Identifier: Apache-2.0
"""The peer of the codec: a loop over frames with the ``cobs`` and ``fastcrc`` packages.

It gives the same values as :func:`hil.wire.codec.decode`: per message a list of tuples, the rows of
its group, number and position.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from typing import Any

from cobs import cobs
from fastcrc.crc16 import ibm_3740

from hil.wire.messages import MESSAGES, Field

STRUCT = {
    "u8": "B",
    "i8": "b",
    "u16": "H",
    "i16": "h",
    "u32": "I",
    "i32": "i",
    "f32": "f",
    "u64": "Q",
    "i64": "q",
}


def unpacker(fields: tuple[Field, ...]) -> struct.Struct:
    """One structure of all fields."""
    return struct.Struct("<" + "".join(f"{f.count}{STRUCT[f.type]}" for f in fields))


FIXED = {m.id: unpacker(m.fields) for m in MESSAGES}
ROWS = {m.id: unpacker(m.group.fields) for m in MESSAGES if m.group}


def decode_by_loop(data: bytes) -> tuple[dict[int, list[Any]], dict[int, list[Any]], int]:
    """Records and rows by type, and frames lost. What is no frame is left out."""
    records: dict[int, list[Any]] = defaultdict(list)
    rows: dict[int, list[Any]] = defaultdict(list)
    offset = lost = 0
    last = None
    for chunk in data.split(b"\0"):
        at, offset = offset, offset + len(chunk) + 1
        if not chunk:
            continue
        try:
            message = cobs.decode(chunk)
        except cobs.DecodeError:
            continue
        if len(message) < 5 or ibm_3740(message[:-2]) != message[-2] | message[-1] << 8:
            continue
        type_id, seq = message[0], message[1] | message[2] << 8
        lost += 0 if last is None else (seq - last - 1) & 0xFFFF
        last = seq
        fixed = FIXED[type_id]
        records[type_id].append((*fixed.unpack_from(message, 3), seq, at))
        if type_id in ROWS:
            rows[type_id] += ROWS[type_id].iter_unpack(message[3 + fixed.size : -2])
    return records, rows, lost
