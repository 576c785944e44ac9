# SPDX-License-Identifier: Apache-2.0
"""Health of the two nodes, line by line, in words: what their status frames say.

Where the error budget has a limit, it is the one that is used. Counters that run since boot are
held against what they were ``RECENT_S`` ago, so that a fault of an hour ago does not look like one
of now.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from hil.budget import Conditions, line
from hil.live import words
from hil.reference.estimator import Flag
from hil.streams import PHY_2M, ROLES
from hil.timesync.model import NS_PER_TICK
from hil.wire.codec import Decoded, physical
from hil.wire.messages import (
    BOOT_CHECKS,
    CAL_ORIGINS,
    IMU_FLAGS,
    SYNC_STATES,
    TICK_RATE_HZ,
)

RECENT_S: Final = 10.0
SILENT_S: Final = 3.0
"""HELLO comes every two seconds."""
RESTING_S: Final = 2.0
FAULTS_MAX: Final = 6
RSSI_UNKNOWN: Final = 127
RSSI_LOW_DBM: Final = -82
"""Ten above the receiver's sensitivity at 2 Mbit/s (nRF52840 PS v1.7, section 6.20.15)."""
OFFSET_OLD_S: Final = 1.0

STATUS: Final = ("hello", "link_stats", "sync_state", "fifo_stats", "system", "cal_status")
FIFO_FAULTS: Final = ("overruns", "parity_errors", "short_reads", "bus_errors", "restarts")
LINK_LOSSES: Final = ("batches_lost", "tx_dropped", "bad_payloads")


@dataclass(frozen=True)
class Row:
    """One line of the page's health panel.

    Attributes:
        level: a key of :data:`hil.live.words.LEVELS`.
    """

    id: str
    title: str
    value: str
    words: str
    level: str

    def plain(self) -> dict[str, str]:
        return {**vars(self), "state": words.LEVELS[self.level]}


class Rising:
    """A counter since boot, and by how much it rose of late."""

    def __init__(self) -> None:
        self.total = 0
        self._steps: deque[tuple[float, int]] = deque(maxlen=64)

    def take(self, t_s: float, total: int) -> None:
        if total < self.total:
            self._steps.clear()
        elif self._steps and total > self.total:
            self._steps.append((t_s, total - self.total))
        if not self._steps:
            # What was counted before this page was there is not of late.
            self._steps.append((float("-inf"), 0))
        self.total = total

    def recent(self, t_s: float) -> int:
        return sum(rise for at_s, rise in self._steps if at_s >= t_s - RECENT_S)


@dataclass
class Node:
    """The last status frames of one node, and its serial port.

    Attributes:
        port: ``waiting``, ``open`` or ``lost``; ``why`` it is lost.
        heard_s: host's time at which it last said anything.
        t_s: its own clock's time, by its latest status frame.
        last: message -> field -> raw value.
    """

    role: str
    port: str = "waiting"
    why: str = ""
    heard_s: float = float("-inf")
    t_s: float = float("nan")
    last: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    counters: dict[str, Rising] = field(default_factory=dict)
    clipped_s: float = float("-inf")
    broken: Rising = field(default_factory=Rising)

    def take(self, found: Decoded, now_s: float) -> None:
        if found.stats.total_bytes:
            self.heard_s = now_s
        for name in STATUS:
            records = found.messages.get(name)
            if records is not None and records.size:
                self.last[name] = plain(records[-1])
        for name, fields in (("fifo_stats", FIFO_FAULTS), ("link_stats", LINK_LOSSES)):
            self._count(found, name, fields)
        self._count(found, "system", ("uart_dropped",))
        self.broken.take(now_s, self.broken.total + found.stats.crc_errors)

    def count(self, name: str) -> tuple[int, int]:
        """(since boot, of late) of a counter; zeros while nothing is known."""
        rising = self.counters.get(name)
        return (rising.total, rising.recent(self.t_s)) if rising else (0, 0)

    def _count(self, found: Decoded, name: str, fields: tuple[str, ...]) -> None:
        for record in found.messages.get(name, ()):
            known = record.dtype.names
            if "t_ticks_node" in known:
                self.t_s = float(record["t_ticks_node"]) / TICK_RATE_HZ
            for one in fields:
                if one in known:
                    self.counters.setdefault(one, Rising()).take(self.t_s, int(record[one]))


class Health:
    """What is known of both nodes.

    Args:
        roles: whose ports there are; the leader speaks for the follower where it has none.
        simulated: the radio is; processor load then has no limit.
    """

    def __init__(self, roles: tuple[str, ...], simulated: bool) -> None:
        self.nodes = {role: Node(role) for role in roles}
        self.faults: deque[dict[str, Any]] = deque(maxlen=FAULTS_MAX)
        self._simulated = simulated
        self._estimate: tuple[float, int] | None = None
        self._sync: tuple[float, float] = (float("nan"), float("nan"))

    def take(self, role: str, found: Decoded, now_s: float) -> None:
        """What a node said; ``now_s`` is the host's time."""
        node = self.nodes[role]
        node.take(found, now_s)
        for record in found.messages.get("fault", ()):
            said = bytes(record["detail"]).split(b"\0")[0].decode("ascii", "replace")
            at_s = float(record["t_ticks_node"]) / TICK_RATE_HZ
            what = {"role": role, "t_s": round(at_s, 1), "words": words.fault(int(record["code"]))}
            self.faults.append({**what, "detail": said, "at_s": at_s})
        batches = found.messages.get("imu_batch")
        if batches is not None and ((batches["flags"] & IMU_FLAGS["clipped"]) != 0).any():
            node.clipped_s = node.t_s
        if role != "leader":
            return
        states = found.messages.get("ekf_state")
        if states is not None and states.size:
            self._estimate = (
                float(states["t_ticks_leader"][-1]) / TICK_RATE_HZ,
                int(states["flags"][-1]),
            )
        models = found.messages.get("sync_state")
        if models is not None and models.size:
            last = models[-1:]
            sigma = physical(last, "sync_state", "offset_sigma_ticks", found.table)[0]
            self._sync = (
                float(last["t_ref_ticks_leader"][0]) / TICK_RATE_HZ,
                float(sigma) * NS_PER_TICK,
            )

    @property
    def resting(self) -> bool:
        """The leader speaks, but its sensor sleeps until the bar is moved."""
        node = self.nodes["leader"]
        if self._estimate is None or not np.isfinite(node.t_s):
            return False
        return node.t_s - self._estimate[0] > RESTING_S

    def rows(self, now_s: float, ended: str = "") -> list[Row]:
        """The panel, from top to bottom."""
        nodes = list(self.nodes.values())
        leader = self.nodes["leader"].last
        return [
            _joined("ports", "Serial ports", [self._port(node, now_s, ended) for node in nodes]),
            self._estimator(),
            *self._radio(leader),
            *self._clock(leader),
            _joined("fifo", "FIFO overruns", [self._sensor(node) for node in nodes]),
            _joined("cpu", "Processor load", [self._load(node) for node in nodes]),
            _joined("cal", "Calibration", [self._calibration(node) for node in nodes]),
        ]

    def _port(self, node: Node, now_s: float, ended: str) -> Row:
        broken = node.broken.recent(now_s)
        dropped, lately = node.count("uart_dropped")
        found = ("Connected", "no damage", "ok")
        if ended:
            found = ("Ended", ended, "unknown")
        elif node.port == "lost":
            found = ("Disconnected", node.why, "bad")
        elif node.port == "waiting":
            found = ("Waiting", node.why or "not open yet", "unknown")
        elif now_s - node.heard_s > SILENT_S:
            found = ("Silent", "says nothing: is it switched on?", "bad")
        elif broken:
            found = ("Damaged", f"{broken} broken frames in {RECENT_S:g} s", "warn")
        elif lately:
            found = ("Too slow", f"{dropped} frames dropped", "warn")
        return Row(node.role, "", *found)

    def _estimator(self) -> Row:
        id_, title = "estimate", "Estimate"
        if self._estimate is None:
            return Row(id_, title, "–", "starts once the bar is still", "unknown")
        flags = self._estimate[1]
        if self.resting:
            return Row(id_, title, "Resting", "the sensor sleeps until the bar moves", "ok")
        if not flags & Flag.ALIGNED:
            return Row(id_, title, "Levelling", "keep the bar still", "unknown")
        if flags & Flag.FOLLOWER_LOST:
            return Row(id_, title, "One end", "without the follower: less exact", "warn")
        if self.nodes["leader"].t_s - self.nodes["leader"].clipped_s < RECENT_S:
            return Row(id_, title, "Clipped", "the sensor went beyond its range", "warn")
        still = bool(flags & (Flag.STILL | Flag.ZUPT))
        return Row(id_, title, "Still" if still else "Moving", "both ends of the bar", "ok")

    def _radio(self, leader: Mapping[str, Mapping[str, Any]]) -> list[Row]:
        link = leader.get("link_stats")
        if link is None:
            return [Row("radio", "Radio link", "–", "not heard of yet", "unknown")]
        lost, lately = self.nodes["leader"].count("batches_lost")
        level = "warn" if lately else "ok"
        late = f"{lately} in the last {RECENT_S:g} s" if lately else f"none for {RECENT_S:g} s"
        losses = Row("lost", "Lost on air", f"{lost}", late, level)
        if not link["connected"]:
            return [Row("radio", "Radio link", "Down", "the follower is not there", "bad"), losses]
        rssi = int(link["rssi_dbm"])
        speed = "2M" if link["phy"] == PHY_2M else "1M"
        about = f"{speed}, every {link['conn_interval_us'] / 1000:g} ms"
        if rssi == RSSI_UNKNOWN:
            return [Row("radio", "Radio link", "Connected", about, "ok"), losses]
        weak = rssi < RSSI_LOW_DBM
        about = f"weak: bring the nodes closer ({about})" if weak else about
        level = "warn" if weak else "ok"
        return [Row("radio", "Radio link", f"{_minus(rssi)} dBm", about, level), losses]

    def _clock(self, leader: Mapping[str, Mapping[str, Any]]) -> list[Row]:
        model = leader.get("sync_state")
        if model is None:
            return [Row("sync", "Clock sync", "–", "not heard of yet", "unknown")]
        name = next((n for n, v in SYNC_STATES.items() if v == model["state"]), "unsynced")
        level, about = words.SYNC[name]
        t_ref_s, sigma_ns = self._sync
        limit_ns = line("T1").limits(self._conditions(leader)).high or float("inf")
        if name == "locked" and sigma_ns > limit_ns:
            level, about = "warn", f"over the {limit_ns:g} ns allowed"
        value = f"±{_ns(sigma_ns)}" if name in ("locked", "holdover") else "–"
        rows = [Row("sync", "Sync error", value, f"{name}: {about}", level)]
        now_s = self.nodes["leader"].t_s
        if self._estimate is not None and not self.resting:
            now_s = float(np.fmax(now_s, self._estimate[0]))
        age_s = max(now_s - t_ref_s, 0.0)
        if np.isfinite(age_s):
            old = age_s > OFFSET_OLD_S
            about = "too old: no new pairs" if old else "since the last clock offset"
            level = "warn" if old else "ok"
            rows.append(Row("offset", "Offset age", f"{age_s * 1e3:.0f} ms", about, level))
        return rows

    def _sensor(self, node: Node) -> Row:
        id_, title = node.role, ""
        if "fifo_stats" not in node.last:
            return Row(id_, title, "–", "not heard of yet", "unknown")
        total, lately = node.count("overruns")
        value = str(total)
        other = [f"{name.replace('_', ' ')}: {node.count(name)[0]}" for name in FIFO_FAULTS[1:]]
        other = [text for text in other if not text.endswith(": 0")]
        if lately:
            return Row(id_, title, value, f"{lately} of them just now: samples lost", "bad")
        if total or other:
            about = ", ".join(other) or "samples were lost earlier"
            return Row(id_, title, value, about, "warn")
        return Row(id_, title, value, "no sample lost", "ok")

    def _load(self, node: Node) -> Row:
        id_, title = node.role, ""
        system = node.last.get("system")
        if system is None:
            return Row(id_, title, "–", "not heard of yet", "unknown")
        load = int(system["cpu_load_permille"]) * 1e-3
        limit = line("F4").limits(self._conditions(self.nodes["leader"].last)).high
        if limit is None:
            return Row(id_, title, f"{load:.0%}", "simulated, not a real one's", "ok")
        over = load > limit
        about = f"{'over' if over else 'within'} the {limit:.0%} allowed"
        return Row(id_, title, f"{load:.0%}", about, "warn" if over else "ok")

    def _calibration(self, node: Node) -> Row:
        id_, title = node.role, ""
        status = node.last.get("cal_status")
        if status is None:
            return Row(id_, title, "–", "not heard of yet", "unknown")
        check = next((n for n, v in BOOT_CHECKS.items() if v == status["boot_check"]), "pending")
        level, about = words.BOOT_CHECKS[check]
        stored = status["origin"] == CAL_ORIGINS["stored"]
        if not stored and level == "ok":
            level, about = ("ok" if self._simulated else "warn"), "none stored: factory values"
        return Row(id_, title, "Stored" if stored else "Defaults", about, level)

    def _conditions(self, leader: Mapping[str, Mapping[str, Any]]) -> Conditions:
        link = leader.get("link_stats", {})
        interval_us = float(link.get("conn_interval_us", 0) or 7500)
        return Conditions(interval_us, int(link.get("phy", PHY_2M)), self._simulated)

    def fault_list(self) -> list[dict[str, Any]]:
        """The last faults, newest first."""
        return [{k: v for k, v in one.items() if k != "at_s"} for one in reversed(self.faults)]

    def fault_level(self) -> str:
        """``bad`` while a fault is of late, ``warn`` after, ``ok`` without any."""
        if not self.faults:
            return "ok"
        fresh = any(
            self.nodes[f["role"]].t_s - f["at_s"] < 60.0
            for f in self.faults
            if f["role"] in ROLES and np.isfinite(self.nodes[f["role"]].t_s)
        )
        return "bad" if fresh else "warn"


def _joined(id_: str, title: str, rows: list[Row]) -> Row:
    """One line for all nodes: their values side by side, and the words of the worst."""
    level = words.worst([row.level for row in rows])
    worst = next(row for row in rows if row.level == level)
    values = list(dict.fromkeys(row.value for row in rows))
    same = len({(row.level, row.words) for row in rows}) == 1
    about = worst.words if same or len(rows) == 1 else f"{worst.id}: {worst.words}"
    return Row(id_, title, " / ".join(values), about, level)


def plain(record: Any) -> dict[str, Any]:
    """A record as plain numbers, by field."""
    return {name: record[name].tolist() for name in record.dtype.names}


def _ns(value: float) -> str:
    if not np.isfinite(value):
        return "?"
    return f"{value:.0f} ns" if value < 10_000 else f"{value / 1000:.0f} µs"


def _minus(value: int) -> str:
    return str(value).replace("-", "−")
