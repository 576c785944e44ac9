# SPDX-License-Identifier: Apache-2.0
"""Edges out of packed samples: against a plain loop, over piece borders, within bounds."""

from __future__ import annotations

import time

import numpy as np
import pytest
from captures import as_rows, edges_by_hand, in_memory

from hil.bench.analyser.capture import Capture
from hil.bench.analyser.edges import BLOCK_SAMPLES, EdgeExtractor, extract, renamed
from hil.errors import RecordingError

RNG = np.random.default_rng(3)


def by_hand(words: np.ndarray, bits: list[int]) -> list[tuple[int, int, int]]:
    return edges_by_hand([[int(w) >> b & 1 for b in bits] for w in words])


@pytest.mark.parametrize("dtype", ["<u1", "<u2", "<u4", "<u8"])
@pytest.mark.parametrize("piece", [1, 7, 64, 1 << 20])
def test_every_change_is_found_whatever_the_pieces(dtype: str, piece: int) -> None:
    top = 8 * np.dtype(dtype).itemsize - 1
    words = RNG.integers(0, 1 << 63, 500, dtype=np.uint64).astype(dtype)
    words |= (RNG.integers(0, 2, 500).astype(dtype) << np.array(top, dtype)).astype(dtype)
    channels = {"a": 0, "top": top, "c": 3}
    edges = extract(in_memory(words, channels, piece=piece))
    assert as_rows(edges) == by_hand(words, [0, top, 3])
    assert edges.initial.tolist() == [int(words[0]) >> b & 1 for b in (0, top, 3)]
    assert edges.samples == 500


def test_samples_of_three_bytes() -> None:
    raw = RNG.integers(0, 256, (400, 3), dtype=np.uint8)
    words = raw.astype(np.int64) @ np.array([1, 256, 65536])
    capture = Capture(1e6, {"low": 1, "high": 23}, 3, lambda: iter([raw.tobytes()]))
    assert as_rows(extract(capture)) == by_hand(words, [1, 23])


def test_a_change_on_the_border_of_two_blocks_is_found_once() -> None:
    words = np.zeros(2 * BLOCK_SAMPLES + 5, dtype=np.uint8)
    words[BLOCK_SAMPLES:] = 1
    words[2 * BLOCK_SAMPLES :] = 0
    found = as_rows(extract(in_memory(words, {"a": 0}, piece=words.size)))
    assert found == [(BLOCK_SAMPLES, 0, 1), (2 * BLOCK_SAMPLES, 0, 0)]


def test_bits_that_nobody_named_are_not_looked_at() -> None:
    words = RNG.integers(0, 256, 1000, dtype=np.uint8) & 0xFE
    assert len(extract(in_memory(words, {"a": 0}))) == 0


def test_a_floating_input_is_an_error_not_a_full_memory() -> None:
    words = (np.arange(100_000) & 1).astype(np.uint8)
    with pytest.raises(RecordingError, match="an input floats") as caught:
        extract(in_memory(words, {"a": 0}), changes_max=50_000)
    assert "grounds" in caught.value.mend


def test_a_cut_sample_and_an_empty_capture_are_errors() -> None:
    extractor = EdgeExtractor({"a": 0}, 2)
    extractor.feed(b"\x00\x00\x01")
    with pytest.raises(RecordingError, match="ends within a sample"):
        extractor.finish(1e6)
    with pytest.raises(RecordingError, match="empty"):
        EdgeExtractor({"a": 0}, 1).finish(1e6)


@pytest.mark.parametrize(
    ("rate", "channels", "unitsize", "what"),
    [
        (0.0, {"a": 0}, 1, "Hz"),
        (float("nan"), {"a": 0}, 1, "Hz"),
        (1e6, {"a": 8}, 1, "bit 8"),
        (1e6, {"a": 1, "b": 1}, 1, "share a bit"),
        (1e6, {}, 1, "needs a channel"),
        (1e6, {"a": 0}, 9, "9 bytes"),
    ],
)
def test_descriptions_that_cannot_be(
    rate: float, channels: dict[str, int], unitsize: int, what: str
) -> None:
    with pytest.raises(RecordingError, match=what):
        Capture(rate, channels, unitsize, lambda: iter([]))


def test_renaming_picks_and_reorders() -> None:
    words = np.array([0, 1, 3, 2, 6], dtype=np.uint8)
    edges = extract(in_memory(words, {"D0": 0, "D1": 1, "D2": 2}))
    new = renamed(edges, {"D2": "follower.pulse", "D0": "leader.pulse"})
    assert new.channels == ("follower.pulse", "leader.pulse")
    assert as_rows(new) == [(1, 1, 1), (3, 1, 0), (4, 0, 1)]
    with pytest.raises(RecordingError, match="no channel 'D9'"):
        renamed(edges, {"D9": "x"})


def test_a_hundred_million_samples_take_a_fraction_of_a_plain_difference() -> None:
    """A ratio, so that it holds on a slow machine: 20 M samples, 1,000 changes a million."""
    words = np.zeros(20_000_000, dtype=np.uint8)
    at = np.unique(RNG.integers(1, words.size, 20_000))
    words[at] = np.uint8(1) << RNG.integers(0, 8, at.size).astype(np.uint8)
    words = np.bitwise_xor.accumulate(words)
    capture = in_memory(words, {f"D{b}": b for b in range(8)})

    def least_s(work: object) -> float:
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            work()  # type: ignore[operator]
            times.append(time.perf_counter() - begin)
        return min(times)

    assert len(extract(capture)) == at.size
    ours_s = least_s(lambda: extract(capture))
    plain_s = least_s(lambda: np.diff(np.unpackbits(words[:, None], axis=1), axis=0))
    assert ours_s < 0.2 * plain_s
