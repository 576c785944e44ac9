# SPDX-License-Identifier: Apache-2.0
"""What of the IMU streams is worth looking at."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.budget import line
from hil.imu import fifo_series
from hil.imu.batches import Batches, batches, sample_rate_hz, since_setup, without_rests
from hil.imu.chip import has_chip, rests
from hil.imu.int1 import edge_errors_us
from hil.imu.measures import ages_ms
from hil.imu.truth import compare, period_errors, time_error_us
from hil.recording import Recording
from hil.series import LimitLine, Series
from hil.streams import ROLES
from hil.timesync.analysis import Sync

Float = NDArray[np.float64]


def series(recording: Recording, sync: Sync) -> list[Series]:
    """Rate, latency, FIFO, and sample times against the chip and its interrupt line."""
    own = {role: since_setup(batches(recording, role, role)) for role in ROLES}
    copy = since_setup(batches(recording, "leader", "follower"))
    return [
        *(
            rate(role, without_rests(own[role], rests(recording, role)))
            for role in ROLES
            if len(own[role])
        ),
        *latency(own["follower"], copy, sync),
        *(found for role in ROLES for found in int1_error(recording, role, sync)),
        *(found for role in ROLES for found in time_error(recording, role, sync)),
        *(found for role in ROLES for found in period_error(recording, role, sync)),
        *fifo_series.series(recording, sync),
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


def period_error(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """Decoded rate against the simulated chip's own."""
    if not has_chip(recording, role):
        return []
    found = compare(recording, role, sync)
    t_us, error_ppm = (np.zeros(0), np.zeros(0)) if isinstance(found, str) else period_errors(found)
    if t_us.size == 0:
        return []
    high = line("I8").limits(sync.conditions).high
    assert high is not None
    order = np.argsort(t_us, kind="stable")
    return [
        Series(
            name=f"imu.{role}.period_error",
            title=role,
            x_unit="s",
            y_unit="ppm",
            x=t_us[order] / 1e6,
            y=error_ppm[order],
            limits=(
                LimitLine(high, f"+{high:g} ppm, I8"),
                LimitLine(-high, f"−{high:g} ppm, I8", "below"),
            ),
            clock="bench",
            y_label="period in the batch over the chip's, minus one",
            plot="imu.period_error",
            plot_title="Decoded rate against the chip's",
            check=f"imu.{role}.truth_period_error_ppm",
            caption="The driver's period against the one at which the simulated chip sampled, on "
            "the node's clock, over half a second. The model's oscillator is off by a constant and "
            "drifts slowly; a real one also follows temperature and supply.",
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
