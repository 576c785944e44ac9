# SPDX-License-Identifier: Apache-2.0
"""What the analyses read from a recording: frames of a role, when they were seen, conditions.

A role without a serial stream, or a message that an old protocol table did not have, gives empty
arrays here; the analysis that needed them says so in its verdict.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.budget import Conditions
from hil.recording import Event, Recording
from hil.wire.codec import Decoded, decode, physical
from hil.wire.messages import Message

ROLES = ("leader", "follower")
SIMULATED_SOURCES = ("sim", "synthetic")
LOSSY_CHANNELS = ("multiatt",)
PHY_2M = 2


def decoded(recording: Recording, role: str) -> Decoded:
    """The decoded stream of ``role``; empty when it was not recorded."""
    return recording.decoded(role) if role in recording.roles else _nothing()


@cache
def _nothing() -> Decoded:
    """The empty stream: each message of the table, and none of any."""
    return decode(b"")


def table(recording: Recording, role: str) -> Mapping[str, Message]:
    """The protocol table that the stream of ``role`` was written with: scales, units."""
    return decoded(recording, role).table


def frames(recording: Recording, role: str, message: str) -> NDArray[Any]:
    """The frames of one message, in the order of sending."""
    found = decoded(recording, role).messages
    return found[message] if message in found else _nothing().messages[message]


def rows(recording: Recording, role: str, message: str) -> NDArray[Any]:
    """The group rows of one message; field ``row`` is the frame they belong to."""
    found = decoded(recording, role).groups
    return found[message] if message in found else _nothing().groups[message]


def seen_t_ns_bench(recording: Recording, role: str, of: NDArray[Any]) -> NDArray[np.int64]:
    """int64[n]: when the read that brought each frame's first byte had returned."""
    if of.size == 0:
        return np.zeros(0, dtype=np.int64)
    return recording.serial[role].t_ns_bench(of["offset"])


def hold_s(event: Event) -> float:
    """For how long the leader was told to stay away from the link; 0 where it was not."""
    asked_ms = event.data.get("hold_ms") if event.kind == "disconnect" else None
    known = isinstance(asked_ms, int | float) and math.isfinite(asked_ms)
    return max(0.0, asked_ms / 1e3) if known and asked_ms is not None else 0.0


def conditions(recording: Recording) -> Conditions:
    """The conditions that limits depend on, from the streams and the scenario.

    Without any frame that tells the interval, the strictest one holds.
    """
    stats = frames(recording, "leader", "link_stats")
    stats = stats[stats["connected"] == 1]
    hello = frames(recording, "leader", "hello")
    spoken = table(recording, "leader")
    interval_us, phy = 7500.0, PHY_2M
    if stats.size:
        interval_us = float(np.median(physical(stats, "link_stats", "conn_interval_us", spoken)))
        phy = int(np.median(stats["phy"]))
    elif hello.size:
        interval_us = float(hello["conn_interval_us"][0])
    channel = recording.provenance.scenario.get("channel", {})
    return Conditions(
        conn_interval_us=interval_us,
        phy=phy,
        simulated=recording.provenance.source in SIMULATED_SOURCES,
        lossy=channel.get("kind") in LOSSY_CHANNELS,
    )


def last_value(of: NDArray[Any], field: str) -> float:
    """The last value of a counter; NaN when no frame came."""
    return float(of[field][-1]) if of.size else float("nan")
