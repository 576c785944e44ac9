# SPDX-License-Identifier: Apache-2.0
"""What of the IMU's FIFO is worth looking at: level, latency, slots, counters."""

from __future__ import annotations

import numpy as np

from hil.budget import line
from hil.imu.chip import FIFO_WORDS, fifo_stats, has_chip
from hil.imu.fifo import COUNTERS
from hil.imu.int1 import latency_ms
from hil.imu.truth import compare, may_wait, slots_waiting
from hil.recording import Recording
from hil.series import LimitLine, Series
from hil.streams import ROLES
from hil.timesync.analysis import Sync


def series(recording: Recording, sync: Sync) -> list[Series]:
    """Nothing for a node whose samples come from no chip."""
    roles = [role for role in ROLES if has_chip(recording, role)]
    return [
        *(found for role in roles for found in level(recording, role, sync)),
        *(found for role in roles for found in latency(recording, role, sync)),
        *(found for role in roles for found in slots(recording, role, sync)),
        *(found for role in roles for found in counters(recording, role)),
    ]


def level(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """Largest FIFO level of each second."""
    stats = fifo_stats(recording, role)
    if len(stats) == 0:
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
            f"{FIFO_WORDS}. Simulated code takes no time, so only the bus and the radio's "
            "schedule delay a read here; on silicon threads compete as well.",
        )
    ]


def latency(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """From INT1 to the batch on the serial line."""
    t_ns, late_ms = latency_ms(recording, role, sync)
    if late_ms.size == 0:
        return []
    return [
        Series(
            name=f"fifo.{role}.int1_latency",
            title=role,
            x_unit="s",
            y_unit="ms",
            x=t_ns / 1e9,
            y=late_ms,
            kind="points",
            clock="bench",
            y_label="frame on the serial line after the edge",
            plot="fifo.int1_latency",
            plot_title="INT1 to batch",
            caption="From the rising edge of INT1 on the analyser to the frame of each batch on "
            "the node's own serial line: reading the FIFO, decoding, and 216 B at 1 Mbaud. A "
            "processor's own time is not in it in simulation.",
        )
    ]


def slots(recording: Recording, role: str, sync: Sync) -> list[Series]:
    """Slots of the simulated chip that are not accounted for yet."""
    found = compare(recording, role, sync)
    if isinstance(found, str) or len(found.stats) == 0:
        return []
    t_us, waiting = slots_waiting(found)
    allowed = may_wait(found.stats)
    return [
        Series(
            name=f"fifo.{role}.slots",
            title=role,
            x_unit="s",
            y_unit="1",
            x=np.maximum.accumulate(t_us) / 1e6,
            y=waiting.astype(np.float64),
            limits=(LimitLine(float(allowed), f"{allowed} may wait"),),
            clock="bench",
            y_label="slots neither delivered nor dropped",
            plot="fifo.slots",
            plot_title="Slots accounted for",
            check=f"fifo.{role}.truth_slots_unread",
            caption="Samples that the simulated chip put into its FIFO less those that the driver "
            "has delivered or dropped while settling, at each FIFO frame: what waits, and what is "
            "lost. A step that stays is a loss. A real chip does not say what it sampled.",
        )
    ]


def counters(recording: Recording, role: str) -> list[Series]:
    """Counters of the driver that ever moved."""
    stats = fifo_stats(recording, role)
    grown = [name for name in COUNTERS if len(stats) and np.any(stats.count(name))]
    return [
        Series(
            name=f"fifo.{role}.{name}",
            title=f"{role}: {name.replace('_', ' ')}",
            x_unit="s",
            y_unit="1",
            x=np.maximum.accumulate(stats.seen_t_ns_bench) / 1e9,
            y=stats.count(name).astype(np.float64),
            clock="bench",
            y_label="count since the IMU was set up",
            plot="fifo.counters",
            plot_title="Counters of the FIFO driver",
            check=f"fifo.{role}.{name}",
            caption="As the FIFO frames give them; counters that stayed at zero are not drawn.",
        )
        for name in grown
    ]
