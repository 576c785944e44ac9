# SPDX-License-Identifier: Apache-2.0
"""What of the IMU streams is worth looking at."""

from __future__ import annotations

import numpy as np

from hil.budget import line
from hil.imu.batches import Batches, batches, sample_rate_hz
from hil.imu.measures import ages_ms
from hil.recording import Recording
from hil.series import LimitLine, Series
from hil.streams import ROLES
from hil.timesync.analysis import Sync


def series(recording: Recording, sync: Sync) -> list[Series]:
    """Sample rate of both nodes and latency of the follower's batches."""
    own = {role: batches(recording, role, role) for role in ROLES}
    copy = batches(recording, "leader", "follower")
    return [
        *(rate(role, own[role]) for role in ROLES if len(own[role])),
        *latency(own["follower"], copy, sync),
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
