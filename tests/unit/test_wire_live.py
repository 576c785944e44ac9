# SPDX-License-Identifier: Apache-2.0
"""A stream decoded piece by piece is the stream decoded whole, however it is cut."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire.codec import decode, encode
from hil.wire.live import UNDELIMITED_MAX, LiveStream


def frame(number: int) -> bytes:
    return encode("link_drop", {"hold_ms": number}, number)


def batch(number: int) -> bytes:
    rows = [{"gyro_lsb": [number, 0, -1], "accel_lsb": [1, 0, k]} for k in range(number % 5)]
    values = {
        **dict.fromkeys(("source", "flags", "accel_fs_g", "t_sigma_ticks", "period_ticks"), 0),
        **dict.fromkeys(("gyro_fs_dps", "t_first_ticks_node", "temperature_cdegc"), 0),
        **{"sample_index": number, "samples": rows},
    }
    return encode("imu_batch", values, number)


piece = st.one_of(
    st.integers(0, 65535).map(frame),
    st.integers(0, 30000).map(batch),
    st.sampled_from([b"time,x,y\r\n1,2,3\r\n", b"\0", b"\0\0\0", b"\xff\xfe\x01", b""]),
    st.binary(max_size=40),
    st.integers(1, 12).map(lambda n: frame(7)[:n]),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(piece, max_size=12).map(b"".join), st.data())
def test_any_cuts_give_the_same_frames(stream: bytes, data: st.DataObject) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    live = LiveStream()
    edges = [0, *cuts, len(stream)]
    # The 00 at the end closes what is open: a stream without one holds something back.
    pieces = [stream[a:b] for a, b in pairwise(edges)] + [b"\0"]
    found = [live.feed(part) for part in pieces]
    whole = decode(stream + b"\0")
    for name in ("link_drop", "imu_batch", "hello"):
        got = np.concatenate([d.messages[name] for d in found])
        for column in [c for c in got.dtype.names or () if c != "offset"]:
            np.testing.assert_array_equal(got[column], whole.messages[name][column])
    got_rows = np.concatenate([d.groups["imu_batch"]["gyro_lsb"] for d in found])
    np.testing.assert_array_equal(got_rows, whole.groups["imu_batch"]["gyro_lsb"])
    assert sum(d.stats.frames for d in found) == whole.stats.frames


def test_byte_by_byte_each_frame_comes_once_and_at_its_end() -> None:
    live = LiveStream()
    stream = frame(5) + frame(6)
    came = [
        (at, int(value))
        for at in range(len(stream))
        for value in live.feed(stream[at : at + 1]).messages["link_drop"]["hold_ms"]
    ]
    assert came == [(len(frame(5)) - 1, 5), (len(stream) - 1, 6)]


def test_frames_that_share_their_00_all_come() -> None:
    """00 frame 00 frame 00: the middle one closes and opens."""
    live = LiveStream()
    shared = frame(5) + frame(6)[1:]
    assert live.feed(frame(5)).messages["link_drop"]["hold_ms"].tolist() == [5]
    assert live.feed(shared[len(frame(5)) :]).messages["link_drop"]["hold_ms"].tolist() == [6]


def test_a_frame_cut_in_two_comes_with_its_end() -> None:
    live = LiveStream()
    assert live.feed(frame(9)[:4]).stats.frames == 0
    assert live.feed(b"").stats.frames == 0
    assert live.feed(frame(9)[4:]).messages["link_drop"]["hold_ms"].tolist() == [9]


def test_rows_name_the_record_of_their_own_piece() -> None:
    live = LiveStream()
    live.feed(batch(3))
    rows = live.feed(batch(4)).groups["imu_batch"]
    assert rows["row"].tolist() == [0, 0, 0, 0]
    assert rows["gyro_lsb"][:, 0].tolist() == [4, 4, 4, 4]


@pytest.mark.parametrize("byte", [b"\x01", b"a"])
def test_a_line_without_delimiters_takes_no_memory(byte: bytes) -> None:
    live = LiveStream()
    live.feed(frame(1))
    tracemalloc.start()
    try:
        for _ in range(400):
            live.feed(byte * 4096)
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 3 * UNDELIMITED_MAX
    assert peak < 8 * UNDELIMITED_MAX
    # And it finds back to frames.
    assert live.feed(frame(2)).messages["link_drop"]["hold_ms"].tolist() == [2]
