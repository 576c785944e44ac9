# SPDX-License-Identifier: Apache-2.0
"""Captures made for the tests, and sigrok-cli's own reading of them."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.bench.analyser.capture import Capture, CaptureEdges
from hil.bench.analyser.edges import extract


def in_memory(
    words: NDArray[np.unsignedinteger],
    channels: Mapping[str, int],
    samplerate_hz: float = 1e6,
    piece: int = 1 << 20,
) -> Capture:
    data = words.tobytes()

    def pieces() -> Iterator[bytes]:
        for begin in range(0, len(data), piece):
            yield data[begin : begin + piece]

    return Capture(samplerate_hz, channels, words.itemsize, pieces)


def levels_by_sigrok(path: Path, *options: str) -> NDArray[np.uint8]:
    """uint8[samples, channels]: every sample of a session file as sigrok-cli prints it."""
    done = subprocess.run(
        ["sigrok-cli", "-i", str(path), *options, "-O", "csv:header=false:label=off:dedup=false"],
        capture_output=True,
        check=True,
        timeout=120,
    )
    row = done.stdout.index(b"\n") + 1
    text = np.frombuffer(done.stdout, dtype=np.uint8).reshape(-1, row)
    assert set(np.unique(text[:, ::2])) <= {ord("0"), ord("1")}
    return text[:, ::2] - np.uint8(ord("0"))


def edges_by_hand(rows: NDArray[np.uint8] | list[list[int]]) -> list[tuple[int, int, int]]:
    """(sample, channel, level) of every change, by comparing row with row."""
    table = np.asarray(rows)
    changed = np.argwhere(table[1:] != table[:-1])
    return [(int(k) + 1, int(c), int(table[k + 1, c])) for k, c in changed]


def as_rows(edges: CaptureEdges) -> list[tuple[int, int, int]]:
    return list(
        zip(edges.sample.tolist(), edges.channel.tolist(), edges.level.tolist(), strict=True)
    )


def pulses_of_two_nodes(
    samplerate_hz: float = 4e6,
    seconds: float = 8.0,
    period_s: float = 0.1,
    follower_late_s: float = 60e-9,
    jitter_s: float = 0.2e-6,
) -> dict[str, NDArray[np.float64]]:
    """Times of the level changes of a sound bench: all channels start low."""
    rng = np.random.default_rng(7)
    rise = np.arange(0.05, seconds - 0.01, period_s)
    near = rng.uniform(-jitter_s, jitter_s, rise.size)
    end = np.arange(0.003, seconds, 0.0075)
    return {
        "leader.radio_end": np.sort(np.concatenate([end, end + 400e-6])),
        "leader.pulse": np.sort(np.concatenate([rise, rise + 0.5e-3])),
        "follower.radio_end": np.sort(np.concatenate([end + 2e-6, end + 402e-6])),
        "follower.pulse": np.sort(
            np.concatenate([rise + follower_late_s + near, rise + follower_late_s + near + 0.5e-3])
        ),
    }


def sampled(
    changes: Mapping[str, NDArray[np.float64]], samplerate_hz: float = 4e6, seconds: float = 8.0
) -> CaptureEdges:
    """What an analyser makes of ideal toggles at these times: all channels begin low."""
    count = round(samplerate_hz * seconds)
    words = np.zeros(count, dtype=np.uint8)
    for bit, times in enumerate(changes.values()):
        first = np.ceil(times * samplerate_hz).astype(np.int64)
        toggles = np.zeros(count, dtype=np.uint8)
        np.bitwise_xor.at(toggles, first[first < count], np.uint8(1))
        words |= np.bitwise_xor.accumulate(toggles) << np.uint8(bit)
    channels = {name: bit for bit, name in enumerate(changes)}
    return extract(in_memory(words, channels, samplerate_hz))
