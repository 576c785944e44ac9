# SPDX-License-Identifier: Apache-2.0
"""The IMU chips of a synthetic run: what they sample, and what a sound driver makes of it."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.recording import ImuTruth
from hil.synthesis.clock import Clock
from hil.synthesis.draft import Draft
from hil.synthesis.estimator import State, locked
from hil.synthesis.plan import Plan
from hil.synthesis.radio import CONNECT_S
from hil.wire.messages import IMU_FLAGS, ROLES, TICK_RATE_HZ

Float = NDArray[np.float64]
Int = NDArray[np.int64]

BATCH: Final = 16
WATERMARK: Final = 2 * BATCH
FIRST_SAMPLE_S: Final = 0.5
UNSETTLED: Final = 37
"""Slots of the run before the first that is delivered."""
RUN: Final = 2
"""Setting the sensors up starts them once before."""
ALL_FLAGS: Final = 11
"""Both settled, in the FIFO."""
READ_AFTER_US: Final = 400.0
"""From the watermark to the end of the transfer that takes INT1 down again."""
BUS_US_PER_BATCH: Final = 240


def imu(plan: Plan, out: Draft, clocks: dict[str, Clock], models: list[State]) -> None:
    """Truth, INT1, batches, the leader's copies, and FIFO counters of both nodes."""
    for role, number in ROLES.items():
        rng = np.random.default_rng(plan.seed + 2 + number)
        node = plan.node(role)
        count = int((plan.duration_s - 0.6) * node.imu_rate_hz / BATCH)
        lsb = rng.integers(-32768, 32768, (count, BATCH, 6))
        slot_us = 1e6 * FIRST_SAMPLE_S + np.arange(count * BATCH) / node.imu_rate_hz * 1e6
        out.imu_truth[role] = _truth(slot_us, lsb.reshape(-1, 6))
        last_us = slot_us[BATCH - 1 :: BATCH]
        out.edges[f"{role}.imu_int1"] = _int1(last_us, clocks[role])
        ticks = clocks[role].ticks(slot_us[::BATCH])
        for values, read_us in _batches(plan, role, ticks, slot_us[::BATCH], lsb):
            out.add(role, read_us * 1e3, "imu_batch", **values)
            if role == "follower" and read_us > (CONNECT_S + 0.2) * 1e6:
                _forward(plan, out, models, values, read_us)
        _stats(plan, out, role, clocks[role])


def _truth(slot_us: Float, counts: NDArray[np.int64]) -> ImuTruth:
    """The delivered slots, and before them those of the set-up and of settling."""
    step_us = slot_us[1] - slot_us[0] if slot_us.size > 1 else 1.0
    early_us = slot_us[0] - step_us * np.arange(UNSETTLED, 0, -1)
    idle = np.zeros((UNSETTLED, 6), dtype=np.int64)
    return ImuTruth(
        run=np.repeat([RUN - 1, RUN], [3, UNSETTLED + slot_us.size]).astype(np.uint32),
        slot=np.concatenate([np.arange(3), np.arange(UNSETTLED + slot_us.size)]).astype(np.uint32),
        t_us_true=np.concatenate([early_us[0] - 1e5 + 100.0 * np.arange(3), early_us, slot_us]),
        counts=np.concatenate([idle[:3], idle, counts]).astype(np.int16),
        flags=np.repeat([0, ALL_FLAGS], [3, UNSETTLED + slot_us.size]).astype(np.uint8),
    )


def _int1(last_us: Float, clock: Clock) -> Int:
    """The line rises with the sample that fills a batch, on a whole microsecond, and falls."""
    rises = np.asarray(clock.true_us(clock.ticks(last_us)))
    both = np.stack([rises, rises + READ_AFTER_US], axis=1)
    return np.rint(both.ravel() * 1e3).astype(np.int64)


def _batches(
    plan: Plan, role: str, ticks: Float, first_us: Float, lsb: NDArray[np.int64]
) -> Iterator[tuple[dict[str, Any], float]]:
    """Values of each batch, and when it was read, true us."""
    node = plan.node(role)
    rate = 1.0 + node.drift_ppm * 1e-6
    period = round(TICK_RATE_HZ / node.imu_rate_hz * rate * 256)
    samples = lsb.tolist()
    for i, start_us in enumerate(first_us.tolist()):
        values: dict[str, Any] = {
            "source": ROLES[role],
            "flags": IMU_FLAGS["hardware_time"],
            "accel_fs_g": 16,
            "gyro_fs_dps": 2000,
            "sample_index": i * BATCH,
            "t_first_ticks_node": int(ticks[i]),
            "period_ticks": period,
            "t_sigma_ticks": 64,
            "temperature_cdegc": 2500,
            "count": BATCH,
            "samples": [{"gyro_lsb": s[:3], "accel_lsb": s[3:]} for s in samples[i]],
        }
        yield values, start_us + BATCH / node.imu_rate_hz * 1e6


def _forward(
    plan: Plan, out: Draft, models: list[State], values: dict[str, Any], read_us: float
) -> None:
    """The leader's copy, on the leader's clock as far as the model is locked by then."""
    arrives_us = read_us + plan.conn_interval_us + 3000.0
    if arrives_us > plan.duration_s * 1e6:
        return
    model = locked(models, arrives_us)
    copy = dict(values)
    if model is None:
        copy |= {"flags": 0, "t_first_ticks_node": 0}
    else:
        t = (values["t_first_ticks_node"] - model.offset + model.skew * model.t_ref) / (
            1.0 + model.skew
        )
        copy["t_first_ticks_node"] = round(t)
    out.add("leader", arrives_us * 1e3, "imu_batch", **copy)


def _stats(plan: Plan, out: Draft, role: str, clock: Clock) -> None:
    for second in range(1, int(plan.duration_s)):
        out.add(
            role,
            1e9 * second + 1e6,
            "fifo_stats",
            t_ticks_node=int(clock.ticks(1e6 * second)),
            samples=0,
            batches=0,
            overruns=0,
            tag_gaps=0,
            parity_errors=0,
            config_changes=0,
            short_reads=0,
            bus_errors=0,
            missed_edges=0,
            level_max=WATERMARK,
            watermark=WATERMARK,
            bus_busy_us=0,
            odr_hz=plan.node(role).imu_odr_hz,
            decimation=1,
            samples_crc32=0,
            samples_unsettled=UNSETTLED,
            slots_by_time=0,
            edges_refused=0,
            restarts=0,
            wake_ups=0,
            wake_to_sample_us=0,
        )
    count_samples(out, role)


def count_samples(out: Draft, role: str) -> None:
    """Set the counters of each frame to what the node's own batches before it amount to.

    They count from the last batch that holds sample 0.
    """
    own = [f for f in out.of(role, "imu_batch") if f.values["source"] == ROLES[role]]
    at, samples, crc = 0, 0, 0
    for frame in out.of(role, "fifo_stats"):
        while at < len(own) and own[at].t_ns <= frame.t_ns:
            if own[at].values["sample_index"] == 0:
                samples, crc = 0, 0
            rows = [s["gyro_lsb"] + s["accel_lsb"] for s in own[at].values["samples"]]
            crc = zlib.crc32(np.array(rows, dtype="<i2").tobytes(), crc)
            samples += len(rows)
            at += 1
        frame.values.update(
            samples=samples, batches=at, samples_crc32=crc, bus_busy_us=at * BUS_US_PER_BATCH
        )
