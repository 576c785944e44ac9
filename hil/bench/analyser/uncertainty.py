# SPDX-License-Identifier: Apache-2.0
"""What a sample is worth in time, and a capture's edges on the bench clock of a recording.

Symbols: T sample period, k number of the first sample with the new level. The edge itself lies in
(k - 1, k] T: half a period either way of its middle, T / sqrt(12) rms (JCGM 100:2008, 4.3.7). Of
two edges on one analyser the half period that all edges are late cancels, and their difference
is within T either way, T / sqrt(6) rms.

The analyser's crystal is off by some parts per million. That scales every interval: a pulse
difference of 1 us changes by 50 ppm, 0.05 ns, which is nothing; a time from the start of a run of
60 s changes by 3 ms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hil.bench.analyser.capture import CaptureEdges
from hil.bench.analyser.edges import renamed
from hil.recording import Edges

CRYSTAL_PPM = 50.0
"""Tolerance of the crystals in analysers of the fx2lafw and Saleae kinds, from their makers."""


def period_ns(samplerate_hz: float) -> float:
    return 1e9 / samplerate_hz


def edge_rms_ns(samplerate_hz: float) -> float:
    """Standard uncertainty of one edge."""
    return period_ns(samplerate_hz) / math.sqrt(12.0)


def difference_rms_ns(samplerate_hz: float) -> float:
    """Standard uncertainty of the difference of two edges of one capture."""
    return period_ns(samplerate_hz) / math.sqrt(6.0)


def difference_uncertainty_ns(
    samplerate_hz: float, interval_ns: float = 0.0, crystal_ppm: float = CRYSTAL_PPM
) -> float:
    """Half width of the interval that a difference of two edges lies in, for a verdict.

    Args:
        interval_ns: size of the difference, which the crystal scales.
    """
    return period_ns(samplerate_hz) + abs(interval_ns) * crystal_ppm * 1e-6


def bench_edges(
    capture: CaptureEdges, names: Mapping[str, str] | None = None, *, start_ns_bench: int = 0
) -> Edges:
    """A capture's edges as a recording keeps them: sample k at round(k 1e9 / rate).

    Args:
        names: analyser channel -> edge channel; all channels by their own names when None.
        start_ns_bench: bench time of the first sample.

    Raises:
        RecordingError: the capture has not a channel of ``names``.
    """
    chosen = capture if names is None else renamed(capture, names)
    t_ns = np.rint(chosen.sample.astype(np.float64) * 1e9 / chosen.samplerate_hz)
    return Edges(
        t_ns.astype(np.int64) + start_ns_bench,
        chosen.channel,
        chosen.level,
        chosen.channels,
        period_ns(chosen.samplerate_hz),
    )
