# SPDX-License-Identifier: Apache-2.0
"""An hour of two nodes' serial streams into records: clean, and with damaged bytes."""

from __future__ import annotations

import numpy as np

from benchmarks.by_loop import decode_by_loop
from benchmarks.measure import Row, best, reading_s
from benchmarks.recordings import minutes
from hil.recording import load
from hil.wire.codec import decode

DAMAGED = 1e-4
"""Share of the bytes; at some 50 B a frame, one frame in 200."""


def rows() -> list[Row]:
    return [_row(0.0), _row(DAMAGED)]


def _row(damaged: float) -> Row:
    streams = [stream.data for stream in load(minutes(60)).serial.values()]
    if damaged:
        rng = np.random.default_rng(1)
        streams = [stream.copy() for stream in streams]
        for stream in streams:
            hit = rng.random(len(stream)) < damaged
            stream[hit] = rng.integers(0, 256, int(hit.sum()), np.uint8)
    size = sum(len(stream) for stream in streams)
    # The loop takes a minute of each node, and as long per byte as it would for the hour.
    pieces = [stream[: len(stream) // 60].tobytes() for stream in streams]
    ours = size / best(lambda: [decode(stream) for stream in streams], 3) / 1e6
    loop = (
        sum(map(len, pieces)) / best(lambda: [decode_by_loop(piece) for piece in pieces], 3) / 1e6
    )
    what = f"{damaged:.2%} of the bytes damaged" if damaged else "clean"
    met = ours >= 10 * loop and (ours >= 300 or bool(damaged))
    return Row(
        work=f"decode an hour of two nodes, {size / 1e6:.0f} MB, {what}",
        ours=f"{ours:.0f} MB/s",
        peer=f"loop with cobs and fastcrc: {loop:.0f} MB/s",
        ratio=ours / loop,
        limit=reading_s(size) / (size / ours / 1e6),
        aim="10 times the loop" + ("" if damaged else ", 300 MB/s"),
        met=met,
        lacking=""
        if met
        else f"{300 / ours:.2f} times too slow, or {10 * loop / ours:.2f} of the loop: "
        "places and lengths are kept of all chunks; keeping those of lines alone comes next",
    )
