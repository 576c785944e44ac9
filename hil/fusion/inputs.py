# SPDX-License-Identifier: Apache-2.0
"""What the leader's estimator was fed, from the leader's own serial stream.

The leader gives each IMU batch to the estimator and to the line in the same order, so the stream
says which follower samples had arrived at each step. Units are made in float, with the very
operations of ``firmware/lib/fusion``: the host's core then comes to the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hil.core import Samples
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, CLIPPED_LSB, GYRO_RADPS_PER_LSB_PER_DPS
from hil.parity import Batch
from hil.recording import Recording
from hil.reference.params import Params
from hil.streams import ROLES, frames, rows
from hil.wire.messages import IMU_FLAGS, TICK_RATE_HZ

GAP_MAX_TICKS: Final = TICK_RATE_HZ // 4
"""After a longer pause of the leader's samples the estimator levels and begins again."""
SUBTICKS_PER_TICK: Final = 256
RIDES_MAX: Final = 4
"""Most follower samples on one step."""
WAITING_MAX: Final = 64
"""Follower samples that may wait for the next step; the oldest are dropped beyond."""


@dataclass(frozen=True, eq=False)
class Run:
    """One start of the estimator: its inputs, the rate that it was started with, its place.

    Attributes:
        samples: what it was fed.
        params: what it was started with: the rate of the leader's IMU, from the first batch and as
            a float32 holds it, and what the image chose by Kconfig.
        begin, end: byte offsets in the leader's stream from the first batch to the next start.
    """

    samples: Batch
    params: Params
    begin: int
    end: int


_KEPT: WeakKeyDictionary[Recording, list[Run]] = WeakKeyDictionary()


def runs(recording: Recording) -> list[Run]:
    """Every start of the leader's estimator, in order of time. Kept."""
    if recording not in _KEPT:
        _KEPT[recording] = _runs(recording)
    return _KEPT[recording]


def _runs(recording: Recording) -> list[Run]:
    sent = frames(recording, "leader", "imu_batch")
    raw = rows(recording, "leader", "imu_batch")
    # Before their boot check has ended, samples are not for the estimator.
    for_estimator = (sent["flags"] & IMU_FLAGS["uncorrected"]) == 0
    raw, sent = raw[for_estimator[raw["row"]]], sent[for_estimator]
    if sent.size == 0:
        return []
    begins = np.searchsorted(raw["row"], np.flatnonzero(for_estimator))
    begins = np.append(begins, len(raw))
    own = np.flatnonzero(sent["source"] == ROLES.index("leader"))
    first = sent["sample_index"][own].astype(np.int64)
    next_index = first + sent["count"][own]
    t_first = sent["t_first_ticks_node"][own].astype(np.int64)
    span = (sent["count"][own].astype(np.int64) - 1) * sent["period_ticks"][own].astype(np.int64)
    t_last = t_first + (span + SUBTICKS_PER_TICK // 2) // SUBTICKS_PER_TICK
    anew = (first[1:] < next_index[:-1]) | (t_first[1:] - t_last[:-1] > GAP_MAX_TICKS)
    starts = own[np.concatenate([[True], anew])] if own.size else own
    bounds = [*starts.tolist(), len(sent)]
    kconfig = recording.provenance.manifests.get("leader", {}).get("kconfig", {})
    iir = bool(kconfig.get("BV_PREFILTER_IIR", False))
    return [
        _run(sent[a:b], raw[begins[a] : begins[b]], _end(sent, b), iir) for a, b in pairwise(bounds)
    ]


def _end(sent: NDArray[Any], row: int) -> int:
    return int(sent["offset"][row]) if row < len(sent) else int(np.iinfo(np.int64).max)


def _run(sent: NDArray[Any], raw: NDArray[Any], end: int, iir: bool) -> Run:
    count = sent["count"].astype(np.int64)
    within = np.arange(len(raw)) - np.repeat(np.cumsum(count) - count, count)
    batch = np.repeat(np.arange(len(sent)), count)
    everything = _samples(sent[batch], raw, within)
    is_own = sent["source"][batch] == ROLES.index("leader")
    rides = np.flatnonzero(~is_own)
    kept, step = arrivals(is_own)
    period = np.float32(sent["period_ticks"][0])
    rate_hz = float(np.float32(SUBTICKS_PER_TICK * TICK_RATE_HZ) / period)
    # At 12.5 and 26 Hz the usual cutoff would lie beyond half of the rate.
    cutoff_hz = min(Params().cutoff_hz, rate_hz / 4.0)
    return Run(
        Batch(_take(everything, np.flatnonzero(is_own)), _take(everything, rides[kept]), step),
        Params(rate_hz=rate_hz, prefilter_iir=iir, cutoff_hz=cutoff_hz),
        int(sent["offset"][0]),
        end,
    )


def arrivals(is_own: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which follower samples ride on which step, as ``Fusion::step`` has it.

    Args:
        is_own: (n,) samples in the order of the stream; True for the leader's.

    Returns:
        (kept, step): numbers of the follower samples that ride at all, and the leader sample on
        which each does. Samples after the last step ride on none.
    """
    kept: list[int] = []
    step: list[int] = []
    waiting: list[int] = []
    steps = followers = 0
    for own in is_own.tolist():
        if not own:
            waiting.append(followers)
            followers += 1
            if len(waiting) > WAITING_MAX:
                waiting.pop(0)
            continue
        if waiting:
            now, waiting = waiting[:RIDES_MAX], waiting[RIDES_MAX:]
            kept += now
            step += [steps] * len(now)
        steps += 1
    return np.array(kept, dtype=np.int64), np.array(step, dtype=np.int64)


def _samples(sent: NDArray[Any], raw: NDArray[Any], within: NDArray[np.int64]) -> Samples:
    since = within * sent["period_ticks"].astype(np.int64)
    lsb = {name: raw[name].astype(np.float32) for name in ("accel_lsb", "gyro_lsb")}
    accel = (sent["accel_fs_g"] * ACCEL_MPS2_PER_LSB_PER_G).astype(np.float32)
    gyro = (sent["gyro_fs_dps"] * GYRO_RADPS_PER_LSB_PER_DPS).astype(np.float32)
    far = np.maximum(np.abs(lsb["accel_lsb"]), np.abs(lsb["gyro_lsb"])).max(axis=1, initial=0)
    sigma = np.float32(1.0 / (SUBTICKS_PER_TICK * TICK_RATE_HZ))
    return Samples(
        sent["t_first_ticks_node"].astype(np.int64)
        + ((since + SUBTICKS_PER_TICK // 2) // SUBTICKS_PER_TICK),
        (lsb["accel_lsb"] * accel[:, np.newaxis]).astype(np.float64),
        (lsb["gyro_lsb"] * gyro[:, np.newaxis]).astype(np.float64),
        far >= CLIPPED_LSB,
        (sent["t_sigma_ticks"].astype(np.float32) * sigma).astype(np.float64),
    )


def _take(samples: Samples, at: NDArray[np.int64]) -> Samples:
    t, accel, gyro, clipped, sigma = samples.columns()
    return Samples(t[at], accel[at], gyro[at], clipped[at], sigma[at])
