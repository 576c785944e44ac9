# SPDX-License-Identifier: Apache-2.0
"""Faults that a scenario gives to the simulated chip: noticed under their own names, and over.

Nothing else is softened for such a run: what a fault makes other checks say is said, and the
scenario lists it under ``expect_fail``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hil.budget import Conditions, judged
from hil.imu.batches import Batches, batches
from hil.imu.chip import FifoStats, fifo_stats
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import frames, seen_t_ns_bench
from hil.wire.messages import FAULT_CODES

NOTICED_S: Final = 2.5
"""A frame of counters is sent every second: by now one has told what happened."""
STEADY_S: Final = 5.0
"""For so long, or to the next fault, a batch without a hardware time belongs to its recovery."""
STALL_WORDS: Final = 512 + 64
"""How far a stall lets the FIFO overrun; two words are one sample."""


@dataclass(frozen=True)
class Signs:
    """What a kind of fault must show: one of ``counters`` raised, and a FAULT frame if named."""

    counters: tuple[str, ...] = ()
    code: str = ""


SIGNS: Final[Mapping[str, Signs]] = {
    "stuck_bus": Signs(("bus_errors",), "imu_bus"),
    "wrong_who_am_i": Signs((), "imu_who_am_i"),
    "dropped_edge": Signs(("missed_edges",)),
    "overrun": Signs(("overruns",)),
    "bit_errors": Signs(("parity_errors", "tag_gaps", "bus_errors")),
    "missing_int": Signs(("missed_edges",), "imu_no_interrupt"),
}


@dataclass(frozen=True)
class Injected:
    """One fault: kind, and when on the bench clock; ``end_s`` is infinite for one that stays."""

    kind: str
    start_s: float
    end_s: float


def listed(recording: Recording, role: str) -> list[Injected]:
    """The faults that the scenario gives to the chip of ``role``, in the scenario's order."""
    node = recording.provenance.scenario.get("nodes", {}).get(role, {})
    imu = node.get("imu", {}) if isinstance(node, Mapping) else {}
    tables = imu.get("faults", ()) if isinstance(imu, Mapping) else ()
    rate_hz = fifo_stats(recording, role).odr_hz
    return [_read(table, rate_hz) for table in tables if isinstance(table, Mapping)]


def _read(table: Mapping[str, Any], rate_hz: float) -> Injected:
    kind, start_s = str(table.get("kind", "")), float(table.get("at_s", 0.0))
    duration_s = float(table.get("duration_s", 0.0))
    if duration_s == 0.0:
        single = kind == "overrun" and "rate" not in table
        duration_s = STALL_WORDS / 2 / rate_hz if single and rate_hz > 0 else math.inf
    return Injected(kind, start_s, start_s + duration_s)


def measure(recording: Recording, role: str, c: Conditions) -> list[Measurement]:
    """Detection and recovery of each injected fault."""
    result: list[Measurement] = []
    faults = listed(recording, role)
    if not faults:
        return result
    stats = fifo_stats(recording, role)
    own = batches(recording, role, role)
    for number, fault in enumerate(faults, start=1):
        prefix = f"fifo.{role}.fault_{number}_{fault.kind}"
        result.append(detected(f"{prefix}_detected", recording, role, fault, stats, c))
        if math.isfinite(fault.end_s):
            later = [f.start_s for f in faults if f.start_s > fault.start_s]
            until_s = min([fault.end_s + STEADY_S, *later])
            result.append(recovery(f"{prefix}_recovery_s", fault, until_s, own, c))
    return result


def detected(  # noqa: PLR0917 (what to call it, where to look, what for)
    name: str,
    recording: Recording,
    role: str,
    fault: Injected,
    stats: FifoStats,
    c: Conditions,
) -> Measurement:
    """The smallest of the signs: how often its counters rose, how many FAULT frames came."""
    signs = SIGNS.get(fault.kind)
    if signs is None:
        how = f"'{fault.kind}' is no kind of fault; kinds: {', '.join(SIGNS)}"
        return judged(name, math.nan, "F6", c, how)
    found: dict[str, float] = {}
    if signs.counters:
        rises = [_rise(stats, counter, fault) for counter in signs.counters]
        found[" + ".join(signs.counters)] = float(sum(rises))
    if signs.code:
        sent = frames(recording, role, "fault")
        seen_s = seen_t_ns_bench(recording, role, sent) / 1e9
        named = sent["code"] == FAULT_CODES[signs.code]
        inside = (seen_s >= fault.start_s) & (seen_s <= fault.end_s + NOTICED_S)
        found[f"FAULT {signs.code}"] = float(np.sum(named & inside))
    how = (
        f"from {fault.start_s:g} s until {NOTICED_S:g} s after its end: rise of "
        f"{' and frames of '.join(found)}"
    )
    return judged(name, min(found.values()), "F6", c, how, details=found)


def _rise(stats: FifoStats, counter: str, fault: Injected) -> int:
    seen_s, count = stats.seen_t_ns_bench / 1e9, stats.count(counter)
    before = count[seen_s <= fault.start_s]
    until = count[seen_s <= fault.end_s + NOTICED_S]
    return int(until[-1] if until.size else 0) - int(before[-1] if before.size else 0)


def recovery(
    name: str, fault: Injected, until_s: float, own: Batches, c: Conditions
) -> Measurement:
    """From the fault's end to the first batch from which on all have a hardware time again."""
    seen_s = own.seen_t_ns_bench / 1e9
    after = seen_s >= fault.end_s
    timed = own.has("hardware_time")
    bad = np.flatnonzero(after & ~timed & (seen_s <= until_s))
    good = np.flatnonzero(after & timed)
    good = good[good > bad[-1]] if bad.size else good
    if good.size == 0:
        how = f"no batch with a hardware time after {fault.end_s:g} s"
        return judged(name, math.nan, "F7", c, how)
    how = (
        f"from the end of the fault at {fault.end_s:g} s until batches have hardware times again; "
        f"{bad.size} came without"
    )
    return judged(name, float(seen_s[good[0]]) - fault.end_s, "F7", c, how)
