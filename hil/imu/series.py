# SPDX-License-Identifier: Apache-2.0
"""What of the IMU streams is worth looking at."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.budget import line
from hil.imu.batches import Batches, batches, sample_rate_hz, since_setup, without_rests
from hil.imu.chip import FIFO_WORDS, fifo_stats, has_chip, rests
from hil.imu.int1 import edge_errors_us
from hil.imu.measures import ages_ms
from hil.imu.truth import compare, time_error_us
from hil.recording import Recording
from hil.series import LimitLine, Series
from hil.streams import ROLES
from hil.timesync.analysis import Sync

Float = NDArray[np.float64]


def series(recording: Recording, sync: Sync) -> list[Series]:
    """Rate, latency, FIFO level, and sample times against the chip and its interrupt line."""
    own = {role: since_setup(batches(recording, role, role)) for role in ROLES}
    copy = since_setup(batches(recording, "leader", "follower"))
    return [
        *(
            rate(role, without_rests(own[role], rests(recording, role)))
            for role in ROLES
            if len(own[role])
        ),
        *latency(own["follower"], copy, sync),
        *(found for role in ROLES for found in fifo_level(recording, role, sync)),
        *(found for role in ROLES for found in int1_error(recording, role, sync)),
        *(found for role in ROLES for found in time_error(recording, role, sync)),
    ]


def rate(role: str, b: Batches) -> Series:
    """Sample rate over the last second, by the node's own clock."""
    t_ns, rate_hz = sample_rate_hz(b)
    return Series(
        name=f"imu.{role}.rate",
        title=role,
        x_unit="s",
        y_unit="Hz",
        x=t_ns / 1e9,
        y=rate_hz,
        clock="bench",
        y_label="sample rate",
        plot="imu.rate",
        plot_title="IMU sample rate",
        check=f"imu.{role}.rate_hz",
        caption="Slope of the hardware times of the last second over the sample index, on the "
        "node's own clock.",
    )


def latency(own: Batches, copy: Batches, sync: Sync) -> list[Series]:
    """Age of each of the follower's batches when the leader has sent it on."""
    t_ns, age_ms, how = ages_ms(own, copy, sync)
    if age_ms.size == 0:
        return []
    order = np.argsort(t_ns, kind="stable")
    limit = line("I6").limits(sync.conditions).high
    assert limit is not None
    return [
        Series(
            name="imu.follower_at_leader.latency",
            title="Age of the follower's batches at the leader",
            x_unit="s",
            y_unit="ms",
            x=t_ns[order] / 1e9,
            y=age_ms[order],
            kind="points",
            limits=(LimitLine(limit, f"{limit:g} ms, I6"),),
            clock="bench",
            y_label="age of the last sample",
            check="imu.follower_at_leader.latency_p99_ms",
            caption=how[0].upper() + how[1:] + ".",
        )
    ]


def fifo_level(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """Largest FIFO level of each second."""
    stats = fifo_stats(recording, role)
    if len(stats) == 0 or not has_chip(recording, role):
        return []
    share = line("F2").limits(sync.conditions).high
    assert share is not None
    return [
        Series(
            name=f"fifo.{role}.level",
            title=role,
            x_unit="s",
            y_unit="1",
            x=np.maximum.accumulate(stats.seen_t_ns_bench) / 1e9,
            y=stats.count("level_max").astype(np.float64),
            limits=(LimitLine(share * FIFO_WORDS, f"{share * FIFO_WORDS:g} words, F2"),),
            clock="bench",
            y_label="largest level, words",
            plot="fifo.level",
            plot_title="IMU FIFO level",
            check=f"fifo.{role}.level_max_share",
            caption=f"Words in the FIFO when it was read, largest since the frame before; it holds "
            f"{FIFO_WORDS}.",
        )
    ]


def int1_error(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """Rising edges of INT1 on the analyser against the sample instants of the batches."""
    if not has_chip(recording, role):
        return []
    t_ns, error_us = edge_errors_us(recording, role, sync)
    if error_us.size == 0:
        return []
    return [
        _points(
            f"imu.{role}.int1_error",
            role,
            t_ns / 1e9,
            error_us,
            limits=_both_sides(sync, "I9"),
            y_label="edge minus sample instant",
            plot="imu.int1_error",
            plot_title="INT1 against the batches",
            check=f"imu.{role}.int1_error_p99_us",
            caption="Each rising edge of INT1 on the analyser minus the nearest sample instant "
            "that the batches predict; clocks tied by the pulses.",
        )
    ]


def time_error(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """Batch times against the simulated chip's own."""
    if not has_chip(recording, role):
        return []
    found = compare(recording, role, sync)
    if isinstance(found, str) or found.timed.size == 0:
        return []
    return [
        _points(
            f"imu.{role}.time_error",
            role,
            found.truth.t_us_true[found.slot_row] / 1e6,
            time_error_us(found),
            limits=_both_sides(sync, "I7"),
            y_label="batch time minus the chip's",
            plot="imu.time_error",
            plot_title="Batch times against the chip",
            check=f"imu.{role}.truth_time_error_us",
            caption="Hardware time of each batch's first sample minus the instant at which the "
            "simulated chip took it.",
        )
    ]


def _points(name: str, title: str, x_s: Float, y_us: Float, **more: Any) -> Series:
    """Microseconds over seconds of the bench clock, put in ascending order."""
    order = np.argsort(x_s, kind="stable")
    return Series(
        name=name,
        title=title,
        x_unit="s",
        y_unit="us",
        x=x_s[order],
        y=y_us[order],
        kind="points",
        clock="bench",
        **more,
    )


def _both_sides(sync: Sync, line_id: str) -> tuple[LimitLine, ...]:
    high = line(line_id).limits(sync.conditions).high
    assert high is not None
    label = f"{high:g} us, {line_id}"
    return LimitLine(high, f"+{label}"), LimitLine(-high, f"−{label}", "below")
