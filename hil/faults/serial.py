# SPDX-License-Identifier: Apache-2.0
"""Faults of a serial line's bytes. Pure: the same seed does the same, however reads are cut."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Change = Callable[[np.random.Generator, Bytes, float], tuple[Bytes, int]]
"""(generator, bytes of one read, share) -> (what arrives, bytes changed)."""


def drop(rng: np.random.Generator, data: Bytes, share: float) -> tuple[Bytes, int]:
    hit = _hits(rng, data, share)
    return data[~hit], int(hit.sum())


def duplicate(rng: np.random.Generator, data: Bytes, share: float) -> tuple[Bytes, int]:
    hit = _hits(rng, data, share)
    return np.repeat(data, 1 + hit), int(hit.sum())


def reorder(rng: np.random.Generator, data: Bytes, share: float) -> tuple[Bytes, int]:
    """The last byte of a read has no next one, and stays."""
    changed = data.copy()
    at = np.flatnonzero(_hits(rng, data, share)[:-1])
    for i in at.tolist():
        changed[i], changed[i + 1] = changed[i + 1], changed[i]
    return changed, int(at.size)


def corrupt(rng: np.random.Generator, data: Bytes, share: float) -> tuple[Bytes, int]:
    drawn = rng.random((data.size, 2))
    hit = drawn[:, 0] < share
    bit = (1 << (drawn[:, 1] * 8).astype(np.uint8)).astype(np.uint8)
    return np.where(hit, data ^ bit, data).astype(np.uint8), int(hit.sum())


def _hits(rng: np.random.Generator, data: Bytes, share: float) -> NDArray[Any]:
    return np.asarray(rng.random(data.size) < share)


CHANGES: Final[dict[str, Change]] = {
    "drop": drop,
    "duplicate": duplicate,
    "reorder": reorder,
    "corrupt": corrupt,
}
