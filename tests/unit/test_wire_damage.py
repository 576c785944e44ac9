# SPDX-License-Identifier: Apache-2.0
"""1,000 random cuts and 1,000 random corruptions of a realistic stream.

What must hold for each: no exception; every record is one that was sent; every byte is in one
class; and the frames sent are the frames decoded plus the frames lost. The last is exact for each
boot of the node between its first frame (the first good one, for the boot with which the stream
begins) and its last good one: frames before and behind these leave no trace in the numbers, and the
test counts them by what it knows was sent.

A CRC of 16 bits misses one in 65,536 of the errors that are more than a burst of 16 bits. The seeds
below are fixed, and with them it misses none.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from hil.wire.codec import Decoded, decode, encode

TRIALS = 1000
FRAMES_BEFORE_RESET = 65_536 - 40
"""The first boot starts so close to the wrap that the stream crosses it."""


@dataclass(frozen=True)
class Sent:
    """A stream as a node sends it, and where each frame is in it."""

    data: bytes
    records: frozenset[tuple[str, bytes]]
    boot: tuple[int, ...]
    """Boot of each frame."""
    number: tuple[int, ...]
    """Number of each frame since its boot, not wrapped."""
    start: tuple[int, ...]
    """Position of each frame's first byte behind its 00."""
    lines: tuple[tuple[int, str], ...]
    """Position and text of each line."""


def records(decoded: Decoded) -> list[tuple[str, bytes]]:
    """Every record, followed by its rows, as bytes; positions left out."""
    found = []
    for name, array in decoded.messages.items():
        placeless = array.copy()
        placeless["offset"] = 0
        contents = [record.tobytes() for record in placeless]
        if name in decoded.groups:
            rows = decoded.groups[name].copy()
            owner = rows["row"].tolist()
            rows["row"] = 0
            for i, row in zip(owner, rows, strict=True):
                contents[i] += row.tobytes()
        found += [(name, content) for content in contents]
    return found


def payload_values(
    rng: random.Random, name: str, t_ticks: int, uptime_ms: int
) -> dict[str, object]:
    """Values as a node would send: times that grow, counters that are small."""
    if name == "hello":
        return {
            "protocol_version": 1,
            "role": 0,
            "target": 0,
            "schema_hash": 0x1122334455667788,
            "build_id": 7,
            "device_id": 9,
            "reset_reason": 1,
            "tick_rate_hz": 16_000_000,
            "conn_interval_us": 7500,
            "uptime_ms": uptime_ms,
        }
    if name == "imu_batch":
        return {
            "source": 0,
            "flags": 1,
            "accel_fs_g": 16,
            "gyro_fs_dps": 2000,
            "sample_index": t_ticks >> 14,
            "t_first_ticks_node": t_ticks,
            "period_ticks": 42_279_108,
            "t_sigma_ticks": 64,
            "temperature_cdegc": 2512,
            "samples": [
                {
                    "gyro_lsb": [rng.randrange(-300, 300) for _ in range(3)],
                    "accel_lsb": [rng.randrange(-3000, 3000) for _ in range(3)],
                }
                for _ in range(rng.randrange(6, 10))
            ],
        }
    if name == "sync_pair":
        return {
            "event": t_ticks >> 17,
            "generation": 1,
            "flags": 1,
            "tx_end_ticks_leader": t_ticks,
            "rx_end_ticks_leader": t_ticks + 3104,
            "tx_end_ticks_follower": t_ticks + 123_456,
            "rx_end_ticks_follower": t_ticks + 126_560,
        }
    return {
        "event": t_ticks >> 17,
        "generation": 1,
        "tx_end_ticks_node": t_ticks,
        "rx_end_ticks_node": t_ticks + 3104,
    }


@cache
def sent_stream() -> Sent:
    """Two boots with a wrap of the numbers in the first; HELLO, batches, captures, CSV lines."""
    rng = random.Random(2026)
    data = bytearray()
    frames: list[tuple[int, int, int]] = []
    lines: list[tuple[int, str]] = []
    t_ticks = 5_000_000_000
    for boot, first, count in ((0, FRAMES_BEFORE_RESET, 90), (1, 0, 70)):
        for number in range(first, first + count):
            since_boot = number - first
            name = (
                "hello"
                if since_boot % 25 == 0
                else rng.choice(("imu_batch", "sync_pair", "sync_capture"))
            )
            t_ticks += rng.randrange(100_000, 140_000)
            uptime_ms = number * 4 + 12
            frames.append((boot, number, len(data) + 1))
            data += encode(name, payload_values(rng, name, t_ticks, uptime_ms), number)
            if number % 3 == 0:
                lines.append((len(data), f"{t_ticks},{rng.randrange(-999, 999)},ok"))
                data += lines[-1][1].encode() + b"\r\n"
    pristine = decode(bytes(data))
    assert pristine.stats.frames == len(frames)
    return Sent(
        bytes(data),
        frozenset(records(pristine)),
        *(tuple(column) for column in zip(*frames, strict=True)),
        tuple(lines),
    )


def check(sent: Sent, damaged: bytes, position: np.ndarray) -> Decoded:
    """``position`` is where each byte of ``damaged`` was in what was sent."""
    decoded = decode(damaged)
    stats = decoded.stats
    assert stats.total_bytes == len(damaged)
    assert stats.unknown_types == stats.bad_lengths == stats.duplicated == 0
    assert set(records(decoded)) <= sent.records, "a record that was never sent"

    at = {start: i for i, start in enumerate(sent.start)}
    good = sorted(
        at[int(position[offset])]
        for array in decoded.messages.values()
        for offset in array["offset"].tolist()
    )
    assert len(good) == stats.frames
    boots = {sent.boot[i] for i in good}
    assert stats.restarts == max(len(boots) - 1, 0)
    visible = 0
    for boot in boots:
        numbers = [sent.number[i] for i in good if sent.boot[i] == boot]
        first = min(numbers) if boot == min(boots) else 0
        visible += max(numbers) - first + 1
    assert stats.frames + stats.lost == visible, "a loss that is not counted, or one that is not"
    return decoded


def check_lines(sent: Sent, decoded: Decoded, hits: list[int]) -> None:
    """Lines clear of every hit arrive; text has no check sum, so one that is hit may be wrong."""

    def clear(line: tuple[int, str]) -> bool:
        first, end = line[0] - 1, line[0] + len(line[1]) + 2
        return not any(first <= at <= end for at in hits)

    assert {line for line in sent.lines if clear(line)} <= set(decoded.text)
    assert {line for line in decoded.text if clear(line)} <= set(sent.lines)


def test_pristine_stream_is_whole() -> None:
    sent = sent_stream()
    decoded = check(sent, sent.data, np.arange(len(sent.data)))
    assert decoded.stats.frames == len(sent.start) == len(sent.records)
    assert decoded.stats.restarts == 1
    assert decoded.stats.lost == decoded.stats.crc_errors == decoded.stats.noise_bytes == 0
    assert dict(decoded.text) == dict(sent.lines)


def test_cut_ends() -> None:
    """The stream begins and ends anywhere: nothing is damaged, so nothing may seem to be."""
    sent = sent_stream()
    rng = random.Random(11)
    for _ in range(TRIALS):
        first, end = sorted(rng.sample(range(len(sent.data) + 1), 2))
        decoded = check(sent, sent.data[first:end], np.arange(first, end))
        assert decoded.stats.crc_errors == decoded.stats.lost == 0


def test_cut_out_of_the_middle() -> None:
    """A stretch is missing, as when a host reads too late."""
    sent = sent_stream()
    rng = random.Random(12)
    for _ in range(TRIALS):
        first = rng.randrange(len(sent.data))
        end = min(first + rng.randrange(1, 2000), len(sent.data))
        check(
            sent,
            sent.data[:first] + sent.data[end:],
            np.concatenate((np.arange(first), np.arange(end, len(sent.data)))),
        )


@pytest.mark.parametrize("bytes_hit", [1, 8])
def test_corrupted_bytes(bytes_hit: int) -> None:
    sent = sent_stream()
    rng = random.Random(20 + bytes_hit)
    errors = losses = 0
    for _ in range(TRIALS):
        damaged = bytearray(sent.data)
        hits = rng.sample(range(len(damaged)), bytes_hit)
        for at in hits:
            damaged[at] ^= rng.randrange(1, 256)
        decoded = check(sent, bytes(damaged), np.arange(len(damaged)))
        check_lines(sent, decoded, hits)
        errors += decoded.stats.crc_errors
        losses += decoded.stats.lost
    assert errors > TRIALS / 2
    assert losses > TRIALS / 2


def test_corrupted_bytes_in_one_long_stream() -> None:
    """1,000 bytes of one stream, long enough for the vectorised way."""
    repeats = 40
    frames = []
    rng = random.Random(31)
    for number in range(160 * repeats):
        name = "hello" if number % 200 == 0 else "sync_pair"
        frames.append(encode(name, payload_values(rng, name, number << 17, number * 4), number))
    data = bytearray(b"".join(frames))
    starts = np.cumsum([1] + [len(f) for f in frames[:-1]])
    pristine = set(records(decode(bytes(data))))
    for at in rng.sample(range(len(data)), TRIALS):
        data[at] ^= rng.randrange(1, 256)
    decoded = decode(bytes(data))
    stats = decoded.stats
    assert set(records(decoded)) <= pristine
    offsets = np.concatenate([array["offset"] for array in decoded.messages.values()])
    good = np.flatnonzero(np.isin(starts, offsets))
    assert len(good) == stats.frames < len(frames) - 800
    assert stats.frames + stats.lost == good[-1] - good[0] + 1
    assert stats.crc_errors > 800
    assert stats.total_bytes == len(data)
