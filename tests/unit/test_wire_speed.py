# SPDX-License-Identifier: Apache-2.0
"""The codec against a loop over frames with the ``cobs`` and ``fastcrc`` packages, in one run.

The loop gives the same values: per message a list of tuples, the rows of its group, number and
position. The limit is far below what is usual, so that a busy machine does not fail it; what it
holds is that decoding stays vectorised.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from benchmarks.by_loop import decode_by_loop
from hil.wire.codec import Decoded, decode, encode
from hil.wire.messages import BY_NAME, MESSAGES

LEAST_RATIO = 2.5


def nodes_stream(count: int) -> Iterator[bytes]:
    """What a leader sends: batches, captures, pairs and clock models in turn; 63 bytes a frame."""
    rng = random.Random(5)
    for seq in range(count):
        t_ticks = 1_000_000_000 + 120_000 * seq
        if seq % 4 == 0:
            axes = [[round(rng.gauss(0, 800)) for _ in range(3)] for _ in range(16)]
            values: dict[str, Any] = {
                "source": 1,
                "flags": 1,
                "accel_fs_g": 4,
                "gyro_fs_dps": 2000,
                "sample_index": 2 * seq,
                "t_first_ticks_node": t_ticks,
                "period_ticks": 42_279_108,
                "t_sigma_ticks": 64,
                "temperature_cdegc": 2500,
                "samples": [
                    {"gyro_lsb": gyro, "accel_lsb": accel}
                    for gyro, accel in zip(axes[::2], axes[1::2], strict=True)
                ],
            }
            yield encode("imu_batch", values, seq)
        elif seq % 4 == 1:
            values = {"event": seq, "generation": 1}
            values |= {"tx_end_ticks_node": t_ticks, "rx_end_ticks_node": t_ticks + 3104}
            yield encode("sync_capture", values, seq)
        elif seq % 4 == 2:
            values = {"event": seq, "generation": 1, "flags": 1}
            values |= {"tx_end_ticks_leader": t_ticks, "rx_end_ticks_leader": t_ticks + 3104}
            values |= {"tx_end_ticks_follower": t_ticks + 99, "rx_end_ticks_follower": t_ticks}
            yield encode("sync_pair", values, seq)
        else:
            values = {f.name: 1 for f in BY_NAME["sync_state"].fields}
            values |= {"t_ref_ticks_leader": t_ticks, "skew": -44_800_000}
            yield encode("sync_state", values, seq)


def fastest(work: Callable[[], Any], times: int) -> float:
    """Least processor time of several runs, in seconds: that of the run disturbed least."""

    def once() -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    return min(once() for _ in range(times))


def same_values(decoded: Decoded, looped: dict[int, list[Any]]) -> bool:
    return all(
        [tuple(r) for r in decoded.messages[m.name].tolist()] == looped.get(m.id, [])
        for m in MESSAGES
        if m.name in {"imu_batch", "sync_capture", "sync_pair", "sync_state"}
    )


def test_decoding_is_several_times_faster_than_a_loop(
    record_property: Callable[[str, object], None],
) -> None:
    data = b"".join(nodes_stream(40_000))
    looped, rows, lost = decode_by_loop(data)
    decoded = decode(data)
    assert same_values(decoded, looped)
    assert len(decoded.groups["imu_batch"]) == len(rows[BY_NAME["imu_batch"].id])
    assert decoded.stats.lost == lost == 0

    loop_s = fastest(lambda: decode_by_loop(data), 5)
    bulk_s = fastest(lambda: decode(data), 10)
    ratio = loop_s / bulk_s
    record_property("loop_mb_per_s", round(len(data) / loop_s / 1e6))
    record_property("decode_mb_per_s", round(len(data) / bulk_s / 1e6))
    print(
        f"loop {len(data) / loop_s / 1e6:.0f} MB/s, decode {len(data) / bulk_s / 1e6:.0f} MB/s, "
        f"{ratio:.1f} times"
    )
    if ratio < LEAST_RATIO:
        pytest.fail(f"decoding is only {ratio:.1f} times as fast as a loop over the frames")
