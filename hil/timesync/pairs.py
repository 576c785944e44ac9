# SPDX-License-Identifier: Apache-2.0
"""Pairs of captures: both nodes' stamps of the same connection event, and their offset.

Four stamps per event, two in each direction::

    leader   --- l_tx ------------ l_rx ---
                   \\              /
    follower ------ f_rx ---- f_tx --------

    forward  = f_rx - l_tx = offset + delay
    backward = f_tx - l_rx = offset - delay
    offset   = (forward + backward) / 2        the chain delay cancels
    one-way bias = (forward - backward) / 2    the delay itself

The pairing here starts from each node's own ``sync_capture`` frames and asks nothing of the
leader's pairing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Int = NDArray[np.int64]
Float = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Captures:
    """One node's captures, one row per connection event, in the order of sending.

    Attributes:
        key: int64[n], generation << 32 | event.
        tx, rx: int64[n], RADIO END of the first TX and RX, in ticks of the node.
        repeated: frames that repeated an event already seen; they are not among the rows.
    """

    key: Int
    tx: Int
    rx: Int
    repeated: int = 0

    def __len__(self) -> int:
        return int(self.key.size)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Both nodes' captures of the same events, in order of key. All arrays are int64[n]."""

    key: Int
    l_tx: Int
    l_rx: Int
    f_tx: Int
    f_rx: Int

    def __len__(self) -> int:
        return int(self.key.size)

    @property
    def offset_ticks(self) -> Float:
        """float64[n]: follower minus leader, two-way."""
        both_ways = (self.f_rx - self.l_tx) + (self.f_tx - self.l_rx)
        return np.asarray(0.5 * both_ways, dtype=np.float64)

    @property
    def one_way_ticks(self) -> Float:
        """float64[n]: leader to follower minus half the round trip."""
        round_trip = (self.f_rx - self.l_tx) - (self.f_tx - self.l_rx)
        return np.asarray(0.5 * round_trip, dtype=np.float64)

    @property
    def t_ticks_leader(self) -> Float:
        """float64[n]: the instant that the offset belongs to, on the leader's clock."""
        return np.asarray(0.5 * (self.l_tx + self.l_rx), dtype=np.float64)

    @property
    def generation(self) -> Int:
        """int64[n]: number of the connection."""
        return self.key >> 32

    def take(self, rows: Mask | Int) -> Pairs:
        """The pairs selected by ``rows``."""
        return Pairs(
            self.key[rows], self.l_tx[rows], self.l_rx[rows], self.f_tx[rows], self.f_rx[rows]
        )


def event_key(frames: NDArray[Any]) -> Int:
    """int64[n]: generation << 32 | event, one number per connection event since boot."""
    return (frames["generation"].astype(np.int64) << 32) | frames["event"].astype(np.int64)


def captures(frames: NDArray[Any]) -> Captures:
    """The ``sync_capture`` frames of one node; of a repeated event the first counts."""
    keys, first = np.unique(event_key(frames), return_index=True)
    return Captures(
        key=keys,
        tx=frames["tx_end_ticks_node"].astype(np.int64)[first],
        rx=frames["rx_end_ticks_node"].astype(np.int64)[first],
        repeated=int(frames.size - keys.size),
    )


def join(leader: Captures, follower: Captures) -> Pairs:
    """Pair the two nodes' own captures by connection event."""
    keys, at_leader, at_follower = np.intersect1d(
        leader.key, follower.key, assume_unique=True, return_indices=True
    )
    return Pairs(
        key=keys,
        l_tx=leader.tx[at_leader],
        l_rx=leader.rx[at_leader],
        f_tx=follower.tx[at_follower],
        f_rx=follower.rx[at_follower],
    )


@dataclass(frozen=True, eq=False)
class Reported:
    """The leader's ``sync_pair`` frames: its pairs, in the order of sending.

    Attributes:
        pairs: the four stamps.
        used: bool[n]; false where the leader dropped the pair as an outlier.
    """

    pairs: Pairs
    used: Mask


def reported(frames: NDArray[Any]) -> Reported:
    """The ``sync_pair`` frames as pairs."""
    return Reported(
        pairs=Pairs(
            key=event_key(frames),
            l_tx=frames["tx_end_ticks_leader"].astype(np.int64),
            l_rx=frames["rx_end_ticks_leader"].astype(np.int64),
            f_tx=frames["tx_end_ticks_follower"].astype(np.int64),
            f_rx=frames["rx_end_ticks_follower"].astype(np.int64),
        ),
        used=(frames["flags"].astype(np.int64) & 1).astype(bool),
    )


@dataclass(frozen=True, eq=False)
class Agreement:
    """The leader's pairs held against the nodes' own captures, bool[n] each.

    Attributes:
        mismatched: some stamp differs from what the node itself captured in that event.
        unverified: a node's own capture of that event is not in the recording.
    """

    mismatched: Mask
    unverified: Mask


def compare(pairs: Pairs, leader: Captures, follower: Captures) -> Agreement:
    """Look each pair's stamps up in both nodes' own captures of the same event."""
    mismatched = np.zeros(len(pairs), dtype=bool)
    unverified = np.zeros(len(pairs), dtype=bool)
    for node, tx, rx in ((leader, pairs.l_tx, pairs.l_rx), (follower, pairs.f_tx, pairs.f_rx)):
        if len(node) == 0:
            unverified[:] = True
            continue
        row = np.clip(np.searchsorted(node.key, pairs.key), 0, len(node) - 1)
        known = node.key[row] == pairs.key
        unverified |= ~known
        mismatched |= known & ((node.tx[row] != tx) | (node.rx[row] != rx))
    return Agreement(mismatched, unverified)
