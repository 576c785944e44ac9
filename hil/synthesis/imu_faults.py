# SPDX-License-Identifier: Apache-2.0
"""Faults of the IMU chip, its driver and its interrupt line, in a synthetic run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hil.synthesis.draft import Draft, Frame
from hil.synthesis.imu import count_samples
from hil.wire.messages import ROLES, TICK_RATE_HZ

LATE_US: Final = 3
TICKS_PER_US: Final = TICK_RATE_HZ // 1_000_000

COUNTED: Final = (
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


def _all_batches(draft: Draft, source: str) -> list[Frame]:
    """The batches of one IMU, the leader's copies among them."""
    number = ROLES[source]
    return [
        f for role in ROLES for f in draft.of(role, "imu_batch") if f.values["source"] == number
    ]


def _times_late(draft: Draft) -> None:
    for frame in (f for role in ROLES for f in _all_batches(draft, role)):
        if frame.values["t_first_ticks_node"]:
            frame.values["t_first_ticks_node"] += LATE_US * TICKS_PER_US


def _resample(draft: Draft, change: Callable[[list[Any], int], list[Any]]) -> None:
    """Change the samples as the driver took them: batches, copies and checksum all show it.

    ``change`` gets all samples of an IMU in a row and the index of one in the middle of the run.
    """
    for role in ROLES:
        frames = _all_batches(draft, role)
        by_index = {f.values["sample_index"]: f.values["samples"] for f in frames}
        order = sorted(by_index)
        sizes = [len(by_index[index]) for index in order]
        flat = [sample for index in order for sample in by_index[index]]
        flat = change(flat, sum(sizes[: len(sizes) // 2]) + 5)
        ends = np.cumsum(sizes).tolist()
        parts = {
            index: flat[end - size : end]
            for index, end, size in zip(order, ends, sizes, strict=True)
        }
        for frame in frames:
            frame.values["samples"] = parts[frame.values["sample_index"]]
        count_samples(draft, role)


def _lose_one(samples: list[Any], at: int) -> list[Any]:
    return [*samples[:at], *samples[at + 1 :], samples[-1]]


def _swap_two(samples: list[Any], at: int) -> list[Any]:
    return [*samples[:at], samples[at + 1], samples[at], *samples[at + 2 :]]


def _each_stats(
    change: Callable[[dict[str, Any]], None], after: int = 0
) -> Callable[[Draft], None]:
    def apply(draft: Draft) -> None:
        for role in ROLES:
            for frame in draft.of(role, "fifo_stats")[after:]:
                change(frame.values)

    return apply


def _restart(draft: Draft) -> None:
    """Half way, samples and counters count from 0 again."""
    for role in ROLES:
        frames = _all_batches(draft, role)
        base = sorted(f.values["sample_index"] for f in frames)[len(frames) // 2]
        for frame in frames:
            if frame.values["sample_index"] >= base:
                frame.values["sample_index"] -= base
        count_samples(draft, role)


def _int1_late(draft: Draft) -> None:
    for role in ROLES:
        draft.edges[f"{role}.imu_int1"] = draft.edges[f"{role}.imu_int1"] + 1000 * LATE_US


def _int1_silent(draft: Draft) -> None:
    for role in ROLES:
        draft.edges[f"{role}.imu_int1"] = np.zeros(0, dtype=np.int64)


def _silent(message: str) -> Callable[[Draft], None]:
    def apply(draft: Draft) -> None:
        for role in ROLES:
            draft.remove(role, lambda f: f.name == message)

    return apply


IMU_FAULTS: Final[dict[str, tuple[str, Callable[[Draft], None]]]] = {
    "times_late": ("all batch times are 3 us late, evenly", _times_late),
    "hidden_loss": (
        "each driver loses a sample and numbers on without a hole",
        lambda d: _resample(d, _lose_one),
    ),
    "swapped_samples": (
        "each driver exchanges two neighbouring samples",
        lambda d: _resample(d, _swap_two),
    ),
    "wrong_checksum": (
        "the last checksum is not that of the samples",
        _each_stats(lambda v: v.update(samples_crc32=v["samples_crc32"] ^ 1), after=-1),
    ),
    "samples_not_counted": (
        "each driver delivers 90 samples fewer than the FIFO held",
        _each_stats(lambda v: v.update(samples=v["samples"] - 90), after=6),
    ),
    "slow_counting": (
        "a fifth of the samples is not counted",
        _each_stats(lambda v: v.update(samples=v["samples"] * 4 // 5)),
    ),
    "driver_errors": (
        "every error that the drivers count has happened",
        _each_stats(lambda v: v.update({name: v[name] + 1 for name in COUNTED}), after=6),
    ),
    "fifo_nearly_full": (
        "the FIFO was read late once",
        _each_stats(lambda v: v.update(level_max=500), after=-1),
    ),
    "slow_bus": (
        "the bus is busy a fifth of the time",
        _each_stats(lambda v: v.update(bus_busy_us=v["t_ticks_node"] // TICKS_PER_US // 5)),
    ),
    "no_fifo_stats": ("neither node reports FIFO counters", _silent("fifo_stats")),
    "no_system": ("neither node reports its health", _silent("system")),
    "imu_restarts": ("each driver starts anew half way, unasked", _restart),
    "no_imu_truth": ("the chips' truth is missing", lambda d: d.imu_truth.clear()),
    "int1_late": ("INT1 rises 3 us late", _int1_late),
    "int1_silent": ("INT1 never moves on the analyser", _int1_silent),
}
"""Name -> what is wrong, and how to make it so."""
