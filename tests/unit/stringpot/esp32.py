# SPDX-License-Identifier: Apache-2.0
"""A string pot on an ESP32 that is not there: what its converter would say, and its serial line."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

MM_PER_COUNT = 0.1
OFFSET_MM = -150.0
"""A track of 1.6 m over 16,380 counts, the sum of four conversions of 12 bits."""
NOISE_COUNTS = 8.0
"""Four conversions of 4 counts rms each; 0.8 mm."""


def counts(height_mm: NDArray[np.float64], seed: int = 1) -> NDArray[np.int64]:
    """What the converter says at these lengths: noise of each conversion, then whole counts."""
    rng = np.random.default_rng(seed)
    quarter = (height_mm - OFFSET_MM) / MM_PER_COUNT / 4.0
    noise = NOISE_COUNTS / 2.0 * rng.standard_normal((4, len(height_mm)))
    return np.rint(quarter + noise).astype(np.int64).sum(axis=0)


def lines(t_us: NDArray[np.int64], raw: NDArray[np.int64]) -> list[bytes]:
    """What the sketch would send."""
    both = zip((t_us % (1 << 32)).tolist(), raw.tolist(), strict=True)
    return [b"%d,%d\r\n" % pair for pair in both]


class Sending:
    """Sends 1,000 lines a second in real time, or ``speed`` times as fast; a context manager.

    It begins when ``begin`` is set.

    Args:
        raw: k -> what the converter says in sample k; None ends it.
        skip: samples that are not sent.
    """

    def __init__(
        self,
        master: int,
        raw: Callable[[int], int | None],
        *,
        first_us: int = 0,
        speed: float = 1.0,
        skip: frozenset[int] = frozenset(),
    ) -> None:
        self.begin = threading.Event()
        self._ending = threading.Event()
        self._job = (master, raw, first_us, speed, skip)
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Sending:
        self._thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self._ending.set()
        self.begin.set()
        self._thread.join(10)

    def _run(self) -> None:
        master, raw, first_us, speed, skip = self._job
        self.begin.wait(20.0)
        begin_s = time.monotonic()
        k = 0
        while not self._ending.is_set():
            due = int((time.monotonic() - begin_s) * 1000.0 * speed)
            data = b""
            while k < due:
                x = raw(k)
                if x is None:
                    os.write(master, data)
                    return
                if k not in skip:
                    data += b"%d,%d\r\n" % ((first_us + 1000 * k) % (1 << 32), x)
                k += 1
            while data:
                data = data[os.write(master, data) :]
            time.sleep(0.005)
