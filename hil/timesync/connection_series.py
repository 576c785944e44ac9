# SPDX-License-Identifier: Apache-2.0
"""What of the connections is worth looking at: one-way bias by PHY, convergence, loss."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import line
from hil.recording import Recording
from hil.series import LimitLine, Series
from hil.streams import ROLES, frames, seen_t_ns_bench
from hil.timesync.analysis import NS_PER_TICK, Sync
from hil.wire.messages import TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]

CONVERGENCE_S: Final = 10.0
LATEST_CONNECTIONS: Final = 5
"""More curves than this hide each other."""
PHYS: Final = {"2m": (2, "2M PHY"), "1m": (1, "1M PHY"), "untold": (0, "PHY not told yet")}


def series(recording: Recording, sync: Sync) -> list[Series]:
    """One-way bias by PHY, convergence after each connection, loss and reconnects."""
    return [*one_way(recording, sync), *convergence(sync), *loss(recording, sync)]


def one_way(recording: Recording, sync: Sync) -> list[Series]:
    """One-way bias of each pair, a trace per PHY."""
    pairs, c = sync.pairs, sync.conditions
    if len(pairs) == 0:
        return []
    limits = line("B1").limits(c)
    bounds = []
    if limits.low is not None:
        bounds.append(LimitLine(limits.low, f"{limits.low:g} ns, B1", "below"))
    if limits.high is not None:
        bounds.append(LimitLine(limits.high, f"{limits.high:g} ns, B1"))
    order = np.argsort(pairs.t_ticks_leader, kind="stable")
    t = pairs.t_ticks_leader[order]
    phy = phy_in_use(recording, t, pairs.key[order] >> 32)
    bias_ns = pairs.one_way_ticks[order] * NS_PER_TICK
    return [
        Series(
            name=f"sync.one_way_{key}",
            title=title,
            x_unit="s",
            y_unit="ns",
            x=t[phy == number] / TICK_RATE_HZ,
            y=bias_ns[phy == number],
            kind="points",
            limits=tuple(bounds) if number == c.phy else (),
            clock="leader",
            y_label="leader to follower minus half the round trip",
            plot="sync.one_way",
            plot_title="One-way bias",
            check="sync.one_way_bias_ns",
            caption="Chain delay of transmitter plus receiver; the two-way offset cancels it. The "
            "simulated radio has 5000 ns on 2M and 9000 ns on 1M, by definition; on silicon "
            "5600 and 10000 ns are expected, and no simulation can show them. A connection begins "
            "on 1M, and the leader tells its PHY once a second.",
        )
        for key, (number, title) in PHYS.items()
        if np.any(phy == number)
    ]


def phy_in_use(recording: Recording, t_ticks_leader: Float, generation: Int) -> Int:
    """int64[n]: 1 or 2, as the leader's latest LINK frame of the same connection says; else 0.

    Args:
        t_ticks_leader: float64[n], ascending.
        generation: int64[n], which connection.
    """
    stats = frames(recording, "leader", "link_stats")
    told = stats["t_ticks_node"].astype(np.int64)
    row = np.searchsorted(told, t_ticks_leader, side="right") - 1
    if told.size == 0:
        return np.zeros(t_ticks_leader.shape, dtype=np.int64)
    held = np.maximum(row, 0)
    names, first = np.unique(generation, return_index=True)
    began = t_ticks_leader[first][np.searchsorted(names, generation)]
    known = (row >= 0) & (stats["connected"][held] == 1) & (told[held] >= began)
    return np.where(known, stats["phy"][held], 0).astype(np.int64)


def convergence(sync: Sync) -> list[Series]:
    """Error of the model from the first event of each connection on; needs the truth."""
    m, own = sync.models, sync.own["leader"]
    if not sync.truth or len(m) == 0 or len(own) == 0:
        return []
    limit = line("T1").limits(sync.conditions).high
    assert limit is not None
    result = []
    for generation in np.unique(m.generation).tolist()[-LATEST_CONNECTIONS:]:
        captured = own.tx[own.key >> 32 == generation]
        rows = np.flatnonzero(m.generation == generation)
        if captured.size == 0:
            continue
        now = m.now_ticks_leader[rows]
        since_s = (now - int(captured.min())) / TICK_RATE_HZ
        use = (since_s >= 0.0) & (since_s <= CONVERGENCE_S)
        error_ns = np.abs(m.offset_at(rows, now) - sync.truth.offset_ticks(now)) * NS_PER_TICK
        result.append(
            Series(
                name=f"sync.convergence_{generation}",
                title=f"connection {generation}",
                x_unit="s",
                y_unit="ns",
                x=np.maximum.accumulate(since_s[use]),
                y=error_ns[use],
                y_log=True,
                limits=(LimitLine(limit, f"{limit:g} ns, T1"),),
                clock="leader",
                x_label="time since the connection's first event",
                y_label="error of the model",
                plot="sync.convergence",
                plot_title="Convergence after each connection",
                check="sync.convergence_s",
                caption="Every model, locked or not, at the time of its frame, against the true "
                "clocks. Simulated crystals do not warm up: on boards the first seconds after "
                "power-on may take longer.",
            )
        )
    return result


def loss(recording: Recording, sync: Sync) -> list[Series]:
    """Connection events without a pair, packets with a wrong CRC, disconnections: per second."""
    planned = sum(event.kind in ("disconnect", "reset") for event in recording.events)
    lost_s, lost = events_without_pair(recording, sync)
    traces: list[tuple[str, str, Float, Float, str]] = []
    if lost_s.size:
        traces.append(("events", "events without a pair", lost_s, lost, "sync.pairs_used"))
    for role in ROLES:
        stats = frames(recording, role, "link_stats")
        seen_s = np.maximum.accumulate(seen_t_ns_bench(recording, role, stats)) / 1e9
        if seen_s.size < 2:
            continue
        grown = {
            field: np.diff(stats[field].astype(np.int64)).clip(0).astype(np.float64)
            for field in ("crc_errors", "disconnects")
        }
        traces.append(
            (
                f"crc_{role}",
                f"{role}: wrong CRC",
                seen_s[1:],
                grown["crc_errors"],
                "link.radio_crc_errors",
            )
        )
        if role == "leader":
            traces.append(
                (
                    "disconnects",
                    "disconnections",
                    seen_s[1:],
                    grown["disconnects"],
                    "sync.reconnects",
                )
            )
    return [
        Series(
            name=f"sync.loss_{key}",
            title=title,
            x_unit="s",
            y_unit="1",
            x=x,
            y=y,
            clock="bench",
            y_label="in one second",
            plot="sync.loss",
            plot_title="Loss and reconnects",
            check=check,
            caption="Connection events of which the two nodes' own captures make no pair, and what "
            f"the nodes count in their LINK frames. {planned} disconnections were asked for. "
            "The simulated channel loses packets by a model of attenuation; it has no other "
            "radios and no bodies in the way.",
        )
        for key, title, x, y, check in traces
    ]


def events_without_pair(recording: Recording, sync: Sync) -> tuple[Float, Float]:
    """Seconds of the bench clock and how many connection events had no pair in each.

    Events before the first pair of a connection and after its last are not counted; a gap counts
    in the second in which it ends.
    """
    sent = frames(recording, "leader", "sync_capture")
    if sent.size < 2:
        return np.zeros(0), np.zeros(0)
    key = (sent["generation"].astype(np.int64) << 32) | sent["event"].astype(np.int64)
    seen_s = seen_t_ns_bench(recording, "leader", sent) / 1e9
    key, first = np.unique(key, return_index=True)
    seen_s = np.maximum.accumulate(seen_s[first])
    paired = key[np.isin(key, sync.pairs.key)]
    # Between two paired events of one connection as many are missing as their numbers skip.
    skipped = np.where(np.diff(paired >> 32) == 0, np.diff(paired) - 1, 0)
    at_s = seen_s[np.isin(key, paired)][1:]
    edges = np.arange(np.floor(seen_s[0]), np.ceil(seen_s[-1]) + 1.0)
    if edges.size < 2:
        return np.zeros(0), np.zeros(0)
    count, _ = np.histogram(at_s, bins=edges, weights=skipped)
    return edges[1:], count.astype(np.float64)
