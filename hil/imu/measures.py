# SPDX-License-Identifier: Apache-2.0
"""The IMU suite: complete, in order, evenly timed, and on the leader in time."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import Conditions, judged
from hil.imu import int1, outages, truth
from hil.imu.batches import (
    WARM_UP_S,
    Batches,
    batches,
    continuity,
    delivery,
    matched,
    period_error_ppm,
    sample_period_ticks,
    since_setup,
    starts,
    time_jitter_us,
    without_rests,
)
from hil.imu.chip import fifo_stats, rests
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES
from hil.timesync.analysis import NS_PER_TICK, Sync
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]

NOMINAL_RATES_HZ: Final = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
"""Output data rates of the LSM6DSOX."""
IN_FLIGHT_S: Final = 1.0
"""Samples this young at the end of a run may still be on their way to the leader."""


def measure(recording: Recording, sync: Sync) -> list[Measurement]:
    """All measurements of the IMU suite."""
    everything = {role: batches(recording, role, role) for role in ROLES}
    own = {role: since_setup(b) for role, b in everything.items()}
    copy = since_setup(batches(recording, "leader", "follower"))
    result: list[Measurement] = []
    for role in ROLES:
        result.append(restarts(recording, role, everything[role], sync.conditions))
        result += stream(f"imu.{role}", own[role], sync.conditions)
        even = without_rests(own[role], rests(recording, role))
        result += timing(f"imu.{role}", even, sync.conditions, _odr_hz(recording, role))
        result += truth.measure(recording, role, sync)
        result += int1.measure(recording, role, sync)
    asked = outages.asked_for(recording, copy)
    absent = sum(outage.samples for outage in asked)
    result += stream("imu.follower_at_leader", copy, sync.conditions, absent)
    result += delivered(own["follower"], copy, sync, absent)
    result += outages.measure(recording, asked, sync.conditions)
    return result


def _odr_hz(recording: Recording, role: str) -> float | None:
    """Nominal rate of the stream: as the node says it, or else as the scenario does."""
    stats = fifo_stats(recording, role)
    if stats.odr_hz > 0:
        return stats.odr_hz / stats.decimation
    node = recording.provenance.scenario.get("nodes", {}).get(role, {})
    odr = node.get("imu", {}).get("odr_hz")
    return float(odr) if isinstance(odr, int | float) else None


def restarts(recording: Recording, role: str, b: Batches, c: Conditions) -> Measurement:
    """Starts of the IMU beyond those that the run asked for; what follows judges the last one."""
    asked = sum(e.kind == "imu_setup" and e.node == role for e in recording.events)
    found = len(starts(b))
    how = f"sample indices of {len(b)} batches fell back to 0; {asked} starts were asked for"
    value = float(max(0, found - asked)) if len(b) else math.nan
    return judged(f"imu.{role}.restarts", value, "L1", c, how)


def stream(prefix: str, b: Batches, c: Conditions, absent: int = 0) -> list[Measurement]:
    """Is every sample there, once, in order? ``absent`` samples are not expected to be."""
    names = ("samples_lost", "samples_duplicated", "batches_out_of_order", "overruns")
    if len(b) == 0:
        how = "no batch in this stream"
        return [judged(f"{prefix}.{n}", math.nan, "I1", c, how) for n in names]
    found = continuity(b.first, b.count)
    overruns = int(np.sum(b.has("overrun_before")))
    values = (found.lost - absent, found.duplicated, found.out_of_order, overruns)
    how = f"sample indices of {len(b)} batches, {int(b.count.sum())} samples"
    if absent:
        how += f"; {absent} more that a link ended on request kept back"
    return [
        judged(f"{prefix}.{n}", float(v), "I1", c, how) for n, v in zip(names, values, strict=True)
    ]


def timing(prefix: str, b: Batches, c: Conditions, odr_hz: float | None) -> list[Measurement]:
    """Rate, reported period and evenness of the batches' hardware times."""
    period = sample_period_ticks(b)
    if not math.isfinite(period) or period <= 0:
        how = "fewer than three batches with a hardware time, or time does not advance"
        return [
            judged(f"{prefix}.rate_hz", math.nan, "I2", c, how, unit="Hz"),
            judged(f"{prefix}.period_error_ppm", math.nan, "I3", c, how),
            judged(f"{prefix}.time_jitter_us", math.nan, "I4", c, how),
        ]
    rate_hz = TICK_RATE_HZ / period
    nominal = odr_hz or min(NOMINAL_RATES_HZ, key=lambda r: abs(math.log(r / rate_hz)))
    period_ppm, jitter_us = period_error_ppm(b, rate_hz), time_jitter_us(b)
    return [
        judged(
            f"{prefix}.rate_hz",
            rate_hz,
            "I2",
            c,
            f"slope of {len(b)} hardware times over the sample index, rests taken out; nominal "
            f"{nominal:g} Hz",
            unit="Hz",
            scale=nominal,
            clock="node",
        ),
        judged(
            f"{prefix}.period_error_ppm",
            float(np.percentile(np.abs(period_ppm), 99)) if period_ppm.size else math.nan,
            "I3",
            c,
            f"99th percentile over {period_ppm.size} batches: period in the batch minus slope of "
            f"the hardware times of the last second, after {WARM_UP_S:g} s",
            details={"median_ppm": float(np.median(period_ppm)) if period_ppm.size else None},
        ),
        judged(
            f"{prefix}.time_jitter_us",
            float(np.max(np.abs(jitter_us))) if jitter_us.size else math.nan,
            "I4",
            c,
            f"largest of {jitter_us.size} hardware times minus the one before plus its samples' "
            "periods",
            details={"rms_us": float(np.sqrt(np.mean(jitter_us**2))) if jitter_us.size else None},
        ),
    ]


def delivered(own: Batches, copy: Batches, sync: Sync, absent: int = 0) -> list[Measurement]:
    """The follower's samples on the leader: complete, unaltered, rightly timed, fresh."""
    c = sync.conditions
    names = ("samples_missing", "samples_altered")
    prefix = "imu.follower_at_leader"
    if len(own) == 0 or len(copy) == 0:
        how = "no batch of the follower's in " + ("its own" if len(own) == 0 else "the leader's")
        how += " stream"
        return [
            *(judged(f"{prefix}.{n}", math.nan, "I1", c, how) for n in names),
            judged(f"{prefix}.time_error_p99_ns", math.nan, "I5", c, how),
            judged(f"{prefix}.latency_p99_ms", math.nan, "I6", c, how),
        ]
    period = sample_period_ticks(own)
    in_flight = int(IN_FLIGHT_S * TICK_RATE_HZ / period) if period > 0 else 0
    found = delivery(own, copy, in_flight)
    how = (
        f"{found.compared} samples of the follower's own serial stream looked up in the leader's, "
        f"from the first delivered to {IN_FLIGHT_S:g} s before the end"
    )
    return [
        judged(f"{prefix}.samples_missing", float(found.missing - absent), "I1", c, how),
        judged(f"{prefix}.samples_altered", float(found.altered), "I1", c, how),
        time_error(own, copy, sync),
        latency(own, copy, sync),
    ]


def time_error(own: Batches, copy: Batches, sync: Sync) -> Measurement:
    """The leader's conversion of the follower's hardware times to its own clock."""
    name = "imu.follower_at_leader.time_error_p99_ns"
    i, j = matched(own, copy)
    t_copy = copy.t_first_ticks[j]
    use = copy.has("hardware_time")[j] & own.has("hardware_time")[i] & sync.settled(t_copy)
    i, at_leader = i[use], np.asarray(t_copy[use], dtype=np.float64)
    offset = own.t_first_ticks[i] - at_leader
    reference = "the true clocks" if sync.truth else "a line through the nodes' own captures"
    error_ns = (offset - _reference_offset(sync, at_leader)) * NS_PER_TICK
    error_ns = error_ns[np.isfinite(error_ns)]
    if error_ns.size == 0:
        how = "no batch with a hardware time on both nodes while the model was locked"
        return judged(name, math.nan, "I5", sync.conditions, how)
    return judged(
        name,
        float(np.percentile(np.abs(error_ns), 99)),
        "I5",
        sync.conditions,
        f"{error_ns.size} batches: the leader's time of the first sample against the follower's, "
        f"converted by {reference}",
        clock="leader",
        details={
            "mean_ns": float(np.mean(error_ns)),
            "max_ns": float(np.max(np.abs(error_ns))),
        },
    )


def _reference_offset(sync: Sync, t_ticks_leader: Float) -> Float:
    if sync.truth:
        return sync.truth.offset_ticks(t_ticks_leader)
    return sync.refit_offset(t_ticks_leader)


def ages_ms(own: Batches, copy: Batches, sync: Sync) -> tuple[Float, Float, str]:
    """Age of the last sample of each batch when the leader's frame was seen.

    Returns:
        bench time of the frames in ns and ages in ms, float64[n] each, and how they were found.
    """
    i, j = matched(own, copy)
    seen_ns = np.asarray(copy.seen_t_ns_bench[j], dtype=np.float64)
    if sync.truth:
        last_ticks = own.t_first_ticks[i] + (own.count[i] - 1) * own.period_ticks[i]
        sampled_ns = sync.truth.clocks["follower"].true_ns(last_ticks)
        how = "bench time of the leader's frame minus true time of the batch's last sample"
        return seen_ns, (seen_ns - sampled_ns) / 1e6, how
    now = sync.leader_clock.at(copy.offset[j])
    last = copy.t_first_ticks[j] + (copy.count[j] - 1) * copy.period_ticks[j]
    use = copy.has("hardware_time")[j] & sync.settled(copy.t_first_ticks[j])
    how = "leader's latest time stamp before the frame minus time of the batch's last sample"
    return seen_ns[use], ((now - last) / TICK_RATE_HZ * 1e3)[use], how


def latency(own: Batches, copy: Batches, sync: Sync) -> Measurement:
    """From the last sample of a follower's batch to its frame on the leader's serial line."""
    name = "imu.follower_at_leader.latency_p99_ms"
    _, age_ms, how = ages_ms(own, copy, sync)
    if age_ms.size == 0:
        how = "no batch both in the follower's stream and in the leader's"
        return judged(name, math.nan, "I6", sync.conditions, how)
    details: dict[str, Any] = {
        "median_ms": float(np.median(age_ms)),
        "max_ms": float(np.max(age_ms)),
        "batches": int(age_ms.size),
    }
    # Without true clocks the leader's clock is only read once per connection event.
    uncertainty_ms = 0.0 if sync.truth else sync.conditions.conn_interval_us / 1e3
    return judged(
        name,
        float(np.percentile(age_ms, 99)),
        "I6",
        sync.conditions,
        how,
        uncertainty=uncertainty_ms,
        details=details,
    )
