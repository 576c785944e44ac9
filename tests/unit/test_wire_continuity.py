# SPDX-License-Identifier: Apache-2.0
"""Sequence numbers: each case is a list of frames as (number, uptime of a HELLO or None)."""

from __future__ import annotations

import numpy as np
import pytest

from hil.wire.continuity import BOOT_LIMIT_MS, Continuity, continuity

Frames = list[tuple[int, int | None]]


def count(frames: Frames) -> Continuity:
    hello = [i for i, (_, uptime_ms) in enumerate(frames) if uptime_ms is not None]
    return continuity(
        np.array([seq for seq, _ in frames], np.uint16),
        np.array(hello, np.int64),
        np.array([frames[i][1] for i in hello], np.int64),
    )


def plain(*numbers: int) -> Frames:
    return [(n, None) for n in numbers]


@pytest.mark.parametrize(
    ("frames", "lost", "duplicated", "restarts"),
    [
        pytest.param([], 0, 0, 0, id="nothing"),
        pytest.param(plain(500), 0, 0, 0, id="one frame: what came before cannot be known"),
        pytest.param(plain(0, 1, 2), 0, 0, 0, id="in order"),
        pytest.param(plain(65534, 65535, 0, 1), 0, 0, 0, id="wrap"),
        pytest.param(plain(65534, 2), 3, 0, 0, id="loss across the wrap"),
        pytest.param(plain(10, 12, 20), 8, 0, 0, id="two losses"),
        pytest.param(plain(5, 5, 5, 6), 0, 2, 0, id="duplicates"),
        pytest.param(plain(0, 32767), 32766, 0, 0, id="largest loss that can be told"),
        pytest.param(plain(1, 32769), 32769, 0, 1, id="one more looks like a restart"),
        pytest.param([(7, 900), (8, None), (0, 5), (1, None)], 0, 0, 1, id="restart"),
        pytest.param([(9, None), (0, 5)], 0, 0, 1, id="restart, no HELLO before it"),
        pytest.param([(40000, None), (0, 5)], 0, 0, 1, id="restart that looks like a gap"),
        pytest.param([(65535, None), (0, 5)], 0, 0, 1, id="restart just before the wrap"),
        pytest.param([(65535, None), (0, 90_000)], 0, 0, 0, id="HELLO number 0 at the wrap"),
        pytest.param([(65534, None), (0, 90_000)], 1, 0, 0, id="the same with a loss"),
        pytest.param([(0, 5), (1, None), (0, 5), (1, None)], 0, 0, 1, id="boot loop"),
        pytest.param([(0, 5), (0, 7), (0, 6)], 0, 0, 2, id="boot loop of HELLO alone"),
        pytest.param([(0, 5), (0, 5)], 0, 1, 0, id="HELLO sent twice"),
        pytest.param([(0, 5), (1, None)], 0, 0, 0, id="HELLO number 0 first in the stream"),
        pytest.param([(50, 900), *plain(51, 4, 5)], 4, 0, 1, id="HELLO of the restart lost"),
        pytest.param([(50, 9000), *plain(51, 60, 61), (62, 2000)], 60, 0, 1, id="it steps forward"),
        pytest.param([(50, 9000), (70, 2000)], 70, 0, 1, id="only the later HELLO is left"),
        pytest.param([(50, 9000), (70, 2000), (75, 4000)], 74, 0, 1, id="and then a loss"),
        pytest.param([(50, 9000), *plain(51, 3, 4), (5, 2000)], 3, 0, 1, id="steps back once"),
        pytest.param(
            [(50, 2**32 - 10), (51, None), (52, 1990)], 0, 0, 0, id="uptime wraps after 49.7 days"
        ),
        pytest.param([(60000, 8), (0, BOOT_LIMIT_MS)], 5535, 0, 0, id="too old for a boot"),
    ],
)
def test_counts(frames: Frames, lost: int, duplicated: int, restarts: int) -> None:
    assert count(frames) == Continuity(lost, duplicated, restarts)


@pytest.mark.parametrize("seed", range(10))
def test_every_loss_is_counted_whatever_is_lost(seed: int) -> None:
    """200,000 frames over several wraps, of which a random share arrives."""
    rng = np.random.default_rng(seed)
    sent = np.arange(200_000)
    arrived = np.flatnonzero(rng.random(len(sent)) < rng.uniform(0.01, 1.0))
    nothing = np.empty(0, np.int64)
    found = continuity(arrived.astype(np.uint16), nothing, nothing)
    assert found == Continuity(int(arrived[-1] - arrived[0] + 1 - len(arrived)), 0, 0)
