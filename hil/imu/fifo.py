# SPDX-License-Identifier: Apache-2.0
"""The FIFO suite: throughput, errors and load, as the driver counts them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from hil.budget import Conditions, judged
from hil.imu import injected
from hil.imu.chip import FIFO_WORDS, FifoStats, fifo_stats, has_chip
from hil.imu.truth import measure_fifo as measure_against_truth
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, frames, table
from hil.timesync.analysis import Sync
from hil.wire.codec import physical
from hil.wire.messages import TICK_RATE_HZ

COUNTERS: Final = (
    "overruns",
    "tag_gaps",
    "parity_errors",
    "config_changes",
    "short_reads",
    "bus_errors",
    "missed_edges",
    "edges_refused",
    "restarts",
)


def measure(recording: Recording, sync: Sync) -> list[Measurement]:
    """All measurements of the FIFO suite; none for a node whose samples come from no chip."""
    result: list[Measurement] = []
    for role in ROLES:
        if not has_chip(recording, role):
            continue
        stats = fifo_stats(recording, role).since_setup()
        result += counted(f"fifo.{role}", stats, sync.conditions)
        result.append(cpu_load(recording, role, sync.conditions))
        result += measure_against_truth(recording, role, sync)
        result += injected.measure(recording, role, sync.conditions)
    return result


def counted(prefix: str, stats: FifoStats, c: Conditions) -> list[Measurement]:
    """What follows from the ``fifo_stats`` frames alone."""
    shares: tuple[tuple[str, str, Callable[[FifoStats], tuple[float, str]]], ...] = (
        ("level_max_share", "F2", _level_share),
        ("bus_occupancy", "F3", _bus_occupancy),
    )
    if len(stats) < 2:
        how = f"{len(stats)} fifo_stats frames, two are needed"
        return [
            judged(f"{prefix}.rate_hz", math.nan, "I2", c, how, unit="Hz"),
            *(judged(f"{prefix}.{name}", math.nan, "F1", c, how) for name in COUNTERS),
            *(judged(f"{prefix}.{name}", math.nan, line, c, how) for name, line, _ in shares),
        ]
    how = f"last of {len(stats)} fifo_stats frames"
    return [
        rate(f"{prefix}.rate_hz", stats, c),
        *(judged(f"{prefix}.{name}", stats.last(name), "F1", c, how) for name in COUNTERS),
        *(
            judged(f"{prefix}.{name}", value, line, c, said)
            for name, line, share in shares
            for value, said in [share(stats)]
        ),
        *wake_up(prefix, stats, c),
    ]


def rate(name: str, stats: FifoStats, c: Conditions) -> Measurement:
    """Samples decoded over time, on the node's clock, against the nominal rate."""
    samples, ticks = stats.count("samples"), stats.t_ticks
    grown, passed = np.diff(samples), np.diff(ticks)
    use = (samples[:-1] > 0) & (grown >= 0) & (passed > 0)
    if stats.last("wake_ups") > 0:
        # Seconds of rest are no loss of rate.
        use &= grown > 0.5 * np.median(grown[use]) if np.any(use) else use
    if not np.any(use):
        return judged(name, math.nan, "I2", c, "no two frames between which samples came")
    rate_hz = float(np.sum(grown[use])) / float(np.sum(passed[use])) * TICK_RATE_HZ
    nominal = stats.odr_hz if stats.odr_hz > 0 else rate_hz
    return judged(
        name,
        rate_hz,
        "I2",
        c,
        f"{int(np.sum(grown[use]))} samples decoded in "
        f"{np.sum(passed[use]) / TICK_RATE_HZ:.1f} s; nominal {nominal:g} Hz",
        unit="Hz",
        scale=nominal,
        clock="node",
    )


def _level_share(stats: FifoStats) -> tuple[float, str]:
    share = float(np.max(stats.count("level_max"))) / FIFO_WORDS
    return share, f"largest level in {len(stats)} frames over {FIFO_WORDS} words"


def _bus_occupancy(stats: FifoStats) -> tuple[float, str]:
    # The counter is of 32 bits and wraps after 71 minutes of transfers.
    busy_us = float(np.sum(np.diff(stats.count("bus_busy_us")) % (1 << 32)))
    passed_us = float(stats.t_ticks[-1] - stats.t_ticks[0]) / (TICK_RATE_HZ / 1e6)
    return busy_us / passed_us, "time in SPI transfers over time, first to last frame"


def wake_up(prefix: str, stats: FifoStats, c: Conditions) -> list[Measurement]:
    """How long the first sample took after motion had ended a rest; nothing without a rest."""
    if stats.last("wake_ups") == 0:
        return []
    worst_ms = float(np.max(stats.count("wake_to_sample_us"))) / 1e3
    how = f"longest of {stats.last('wake_ups'):g} wake-ups, from the wake-up edge to the batch"
    return [judged(f"{prefix}.wake_to_sample_ms", worst_ms, "F5", c, how)]


def cpu_load(recording: Recording, role: str, c: Conditions) -> Measurement:
    """Share of time in which the node's processor was not idle."""
    name = f"fifo.{role}.cpu_load"
    sent = frames(recording, role, "system")
    if sent.size == 0:
        return judged(name, math.nan, "F4", c, f"the {role} sent no SYSTEM frame")
    load = physical(sent, "system", "cpu_load_permille", table(recording, role))
    how = f"mean of {sent.size} SYSTEM frames"
    if c.simulated:
        how += "; a simulated processor takes no time but in busy waits, which stand for the bus"
    return judged(name, float(np.mean(load)), "F4", c, how, details={"max": float(np.max(load))})
