# SPDX-License-Identifier: Apache-2.0
"""Faults of the nodes themselves: links broken, a node that is not there, bits of its flash."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from hil.faults.injection import Injection

ERASED: Final = 0xFF


def drops_s(injections: Sequence[Injection]) -> list[float]:
    """When the leader is told to break the link, s: evenly over the span of each storm."""
    times: list[float] = []
    for one in injections:
        if one.kind == "storm":
            count = int(one.value)
            times += (one.from_s + (one.to_s - one.from_s) * np.arange(count) / count).tolist()
    return sorted(times)


def is_absent(injections: Sequence[Injection], role: str) -> bool:
    """Whether the node is never started."""
    return any(one.kind == "absent" and one.stream == role for one in injections)


def flash_bits(injections: Sequence[Injection], role: str) -> list[Injection]:
    """The injections that turn bits of this node's flash over."""
    return [one for one in injections if one.kind == "flash" and one.covers(role)]


def turn_bits(path: Path, count: int, seed: Sequence[int]) -> int:
    """Turn over ``count`` bits among the bytes that something was written to; how many it were."""
    content = np.frombuffer(path.read_bytes(), np.uint8).copy()
    written = np.flatnonzero(content != ERASED)
    count = min(count, written.size * 8)
    for place in np.random.default_rng(seed).choice(written.size * 8, count, replace=False):
        content[written[place // 8]] ^= 1 << (place % 8)
    path.write_bytes(content.tobytes())
    return count
