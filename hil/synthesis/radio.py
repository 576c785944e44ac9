# SPDX-License-Identifier: Apache-2.0
"""Connection events on two drifting clocks, with the stamps and edges that they leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.synthesis.plan import Plan

Int = NDArray[np.int64]
Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

CONNECT_S = 1.0
T_IFS_US = 150
LEADER_AIR_US = (44, 80, 132)
FOLLOWER_AIR_US = (44, 236, 496, 980)
TICKS_PER_US = 16
GAP_S = 0.5


@dataclass(frozen=True, eq=False)
class Events:
    """Connection events, one row each.

    Attributes:
        event, generation: int64[n].
        true_us: float64[n], true time of the leader's TX end.
        l_tx, l_rx, f_tx, f_rx: int64[n], END captures in ticks of their node.
        l_ok, f_ok: bool[n], the node received a packet with a good CRC.
    """

    event: Int
    generation: Int
    true_us: Float
    l_tx: Int
    l_rx: Int
    f_tx: Int
    f_rx: Int
    l_ok: Mask
    f_ok: Mask

    @property
    def paired(self) -> Mask:
        return self.l_ok & self.f_ok


def events(plan: Plan) -> tuple[Events, dict[str, Int]]:
    """All connection events of a run, and the END edges per channel, ns on the bench clock.

    As in the radio simulator, the leader, the channel (true time) and the follower each count
    whole microseconds of their own time, and every crossing from one to the other rounds.
    """
    rng = np.random.default_rng(plan.seed)
    leader, follower = plan.leader.clock, plan.follower.clock
    count = int((plan.duration_s - CONNECT_S - 0.1) * 1e6 / plan.conn_interval_us)
    number = np.arange(count)
    generation = np.ones(count, dtype=np.int64)
    start_us = int(np.rint(leader.local_us(CONNECT_S * 1e6)))
    anchor_us = start_us + number * plan.conn_interval_us
    if plan.reconnect_at_s is not None:
        elapsed_s = number * plan.conn_interval_us / 1e6
        back_s = plan.reconnect_at_s - CONNECT_S + GAP_S
        connected = (elapsed_s < back_s - GAP_S) | (elapsed_s >= back_s)
        generation = np.where(elapsed_s >= back_s, 2, 1)[connected]
        number, anchor_us = number[connected], anchor_us[connected]
        number = np.where(generation == 2, number - number[generation == 2][:1], number)
    n = number.size

    l_tx_us = anchor_us + rng.choice(LEADER_AIR_US, n)
    heard_us = np.rint(leader.true_us(l_tx_us)) + plan.delay_us
    f_rx_us = np.rint(follower.local_us(heard_us)).astype(np.int64)
    f_tx_us = f_rx_us + T_IFS_US + rng.choice(FOLLOWER_AIR_US, n)
    answered_us = np.rint(follower.true_us(f_tx_us)) + plan.delay_us
    l_rx_us = np.rint(leader.local_us(answered_us)).astype(np.int64)
    f_ok = rng.random(n) >= plan.loss
    l_ok = f_ok & (rng.random(n) >= plan.loss)
    late_us = rng.choice(plan.capture_late_us, n)

    def ticks(local_us: Int, role: str) -> Int:
        return TICKS_PER_US * (local_us - plan.node(role).timer_start_us)

    def edges(role: str, *local_us: Int) -> Int:
        true = plan.node(role).clock.true_us(np.concatenate(local_us))
        return np.sort(np.rint(np.asarray(true) * 1e3).astype(np.int64))

    # Advertisements before the connection, which no capture reports.
    advertised_us = np.arange(100_000, int(CONNECT_S * 9e5), 30_000)
    ends = {
        "leader.radio_end": edges("leader", l_tx_us, l_rx_us[f_ok]),
        "follower.radio_end": edges("follower", advertised_us, f_rx_us, f_tx_us[f_ok]),
    }
    table = Events(
        event=number,
        generation=generation,
        true_us=np.asarray(leader.true_us(l_tx_us)),
        l_tx=ticks(l_tx_us, "leader"),
        l_rx=ticks(l_rx_us, "leader"),
        f_tx=ticks(f_tx_us, "follower"),
        f_rx=ticks(f_rx_us + late_us, "follower"),
        l_ok=l_ok,
        f_ok=f_ok,
    )
    return table, ends
