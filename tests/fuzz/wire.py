# SPDX-License-Identifier: Apache-2.0
"""The wire codec and demultiplexer, whole and live.

The first byte chooses where the stream is cut for the live decoder, and its lowest bit whether
the rest is the stream itself or, parted by SPLIT, messages to be framed with a right CRC.
"""

from __future__ import annotations

import random

import numpy as np

from hil.wire import cobs
from hil.wire.codec import Decoded, decode, encode_payload
from hil.wire.frames import CRC_SIZE, HEADER_SIZE, frame
from hil.wire.live import UNDELIMITED_MAX, LiveStream
from hil.wire.messages import BY_NAME
from tests.fuzz.common import SPLIT


def run(data: bytes) -> None:
    if not data:
        return
    stream = data[1:]
    if data[0] & 1:
        stream = _framed(stream)
    # What a closing 00 makes of the end is then the same in one piece and in many.
    stream += b"\0"
    whole = decode(stream)
    assert whole.stats.total_bytes == len(stream)
    _check_records(whole, stream)
    if len(stream) < UNDELIMITED_MAX:
        _check_live(whole, stream, random.Random(data[0]))


def _framed(stream: bytes) -> bytes:
    """Each part is type, seq and payload; one of fewer than three bytes is sent as it is."""
    framed = b""
    for part in stream.split(SPLIT):
        if len(part) < HEADER_SIZE:
            framed += part
        else:
            seq = int.from_bytes(part[1:HEADER_SIZE], "little")
            framed += frame(part[0], seq, part[HEADER_SIZE:])
    return framed


def _check_records(whole: Decoded, stream: bytes) -> None:
    """Every record encodes to the bytes that it was read from."""
    known = 0
    for name, records in whole.messages.items():
        group = BY_NAME[name].group
        rows = whole.groups.get(name)
        for number, record in enumerate(records):
            known += 1
            offset = int(record["offset"])
            chunk = stream[offset : stream.index(b"\0", offset)]
            message = cobs.unstuff(chunk)
            assert message is not None
            values = {f.name: record[f.name].tolist() for f in BY_NAME[name].fields}
            if group and rows is not None:
                own = rows[rows["row"] == number]
                values[group.name] = [
                    {f.name: row[f.name].tolist() for f in group.fields} for row in own
                ]
            payload = encode_payload(name, values)
            sent = message[HEADER_SIZE:-CRC_SIZE]
            # A NaN may come back as another NaN.
            floats = any(f.type == "f32" for f in BY_NAME[name].fields)
            assert payload == sent or (floats and "nan" in repr(values)), name
            assert int(record["seq"]) == int.from_bytes(message[1:HEADER_SIZE], "little")
    stats = whole.stats
    assert known + stats.unknown_types + stats.bad_lengths == stats.frames


def _check_live(whole: Decoded, stream: bytes, rng: random.Random) -> None:
    """In pieces of any length the same records and the same lines come out."""
    cuts = sorted(rng.randrange(len(stream) + 1) for _ in range(rng.randrange(1, 4)))
    live = LiveStream()
    pieces = [live.feed(stream[a:b]) for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    for name, records in whole.messages.items():
        columns = [c for c in records.dtype.names or () if c != "offset"]
        joined = np.concatenate([p.messages[name] for p in pieces])
        assert all(records[c].tobytes() == joined[c].tobytes() for c in columns), name
    for name, rows in whole.groups.items():
        columns = [c for c in rows.dtype.names or () if c != "row"]
        joined = np.concatenate([p.groups[name] for p in pieces])
        assert all(rows[c].tobytes() == joined[c].tobytes() for c in columns), name
    assert [line.text for line in whole.text] == [line.text for p in pieces for line in p.text]
    for count in ("frames", "unknown_types", "bad_lengths", "crc_errors", "text_bytes"):
        assert getattr(whole.stats, count) == sum(getattr(p.stats, count) for p in pieces), count
