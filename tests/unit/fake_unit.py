# SPDX-License-Identifier: Apache-2.0
"""A unit at the end of a serial line, without firmware: written from calib.c and node.c by hand.

It says HELLO each two seconds and CAL status each second, streams what a chip model makes of the
position that it is held in, and takes the host's commands. Time passes only while it is read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hil.motion.imu_model import ChipErrors, ImuConfig, chip_errors, measure
from hil.wire.codec import decode, encode
from hil.wire.messages import schema_hash

G_MPS2 = 9.80665
DEVICE_ID = 0x0123456789ABCDEF
RATE_HZ = 417.0
BATCH = 16
TICKS_PER_S = 16_000_000
ABSENT, CORRUPT, OTHER_DEVICE = 1, 2, 4
APPLIED, MOVING = 1, 4
EINVAL = 22
COMMANDS = {1: "cal_read", 2: "cal_erase", 3: "raw_on", 4: "raw_off", 5: "reboot"}
RECORD = (
    *("device_id", "created_unix_s", "temperature_cdegc"),
    *("accel_bias_mps2", "accel_matrix", "gyro_bias_radps"),
)
Values = dict[str, Any]


@dataclass
class Wrong:
    """Ways to go wrong; none by default.

    Attributes:
        deaf: commands, or ``cal_record``, that it never hears.
        lost: how often each is lost on its way to it.
        unanswered: carried out, and the answer lost.
        refuse: errno with which it refuses a record.
        stored_as: values that its store holds instead of what it was sent.
        comes_back: after a reset.
        after_reset: fields of CAL status that are otherwise than they should be after a reset.
        boot_s: after a reset, how long until its boot check has decided.
        noise: bytes that come before each slice of its stream.
    """

    silent: bool = False
    samples: bool = True
    deaf: frozenset[str] = frozenset()
    lost: Counter[str] = field(default_factory=Counter)
    unanswered: frozenset[str] = frozenset()
    refuse: int = 0
    stored_as: Mapping[str, Any] = field(default_factory=dict)
    comes_back: bool = True
    after_reset: Mapping[str, Any] = field(default_factory=dict)
    boot_s: float = 1.1
    noise: bytes = b""


class FakeUnit:
    """A port of :class:`hil.calibration.tool.unit.Unit`; :meth:`now_s` is its clock.

    Attributes:
        up: direction that points up, in the sensor's axes.
        stored: the record in its store.
        raw: whether the correction is switched off.
        heard: names of what it was sent and did hear, in order.
        boots: times that it has started.
    """

    def __init__(
        self,
        role: str = "leader",
        *,
        seed: int = 1,
        wrong: Wrong | None = None,
        stored: Values | None = None,
        schema: int | None = None,
        uptime_s: float = 10.3,
        slice_s: float = 0.2,
    ) -> None:
        self.errors: ChipErrors = chip_errors(seed, role, "uncalibrated")
        self.wrong = wrong or Wrong()
        self.stored = stored
        self.up = np.array([0.0, 0.0, 1.0])
        self.raw = False
        self.heard: list[str] = []
        self.boots = 1
        self.reads = 0
        self.before_read: Callable[[int], None] = lambda number: None
        self._role = 0 if role == "leader" else 1
        self._schema = schema_hash() if schema is None else schema
        self._rng = np.random.default_rng(seed)
        self._slice_s = slice_s
        self._now_s = 1000.0
        self._boot_s = self._now_s - uptime_s
        self._ready_s = 0.0
        self._seq = 0
        self._sample = 0
        self._moving_until_s = 0.0
        self._knocks_s: list[float] = []
        self._in_force = stored
        self._changed: Mapping[str, Any] = {}
        self._waiting = b""
        self._alive = True
        if uptime_s == 0.0:
            self._hello()
            self._status()

    # The host's side ----------------------------------------------------------------------

    def now_s(self) -> float:
        return self._now_s

    def read_bytes(self, timeout_s: float) -> bytes:
        self.before_read(self.reads)
        self.reads += 1
        if not self._waiting and timeout_s > 0.0:
            self._pass(self._slice_s)
        taken, self._waiting = self._waiting, b""
        return taken

    def write(self, data: bytes) -> None:
        decoded = decode(data)
        for name in ("node_command", "cal_record"):
            for row in decoded.messages[name]:
                what = name if name == "cal_record" else COMMANDS[int(row["command"])]
                if self.wrong.silent or not self._alive or what in self.wrong.deaf:
                    continue
                if self.wrong.lost[what] > 0:
                    self.wrong.lost[what] -= 1
                    continue
                self.heard.append(what)
                self._take(
                    what, {key: row[key].tolist() for key in RECORD if key in row.dtype.fields}
                )

    # A person's side ----------------------------------------------------------------------

    def turn(self, up: Any, moving_s: float = 0.4) -> None:
        """Turned by hand: it moves for a while, and then lies still that way up."""
        self.up = np.asarray(up, float) / np.linalg.norm(up)
        self._moving_until_s = self._now_s + moving_s

    def knock_at(self, *after_s: float) -> None:
        """Knocked so long from now."""
        self._knocks_s += [self._now_s + s for s in after_s]

    # Its own side -------------------------------------------------------------------------

    def _uptime_s(self) -> float:
        return self._now_s - self._boot_s

    def _pass(self, seconds: float) -> None:
        self._now_s += seconds
        if self.wrong.silent or not self._alive:
            return
        self._waiting += self.wrong.noise
        before_s = self._uptime_s() - seconds
        if before_s // 2.0 != self._uptime_s() // 2.0:
            self._hello()
        if before_s // 1.0 != self._uptime_s() // 1.0:
            self._status()
        if self.wrong.samples:
            self._stream()

    def _say(self, name: str, values: Values) -> None:
        self._waiting += encode(name, values, self._seq)
        self._seq += 1

    def _hello(self) -> None:
        self._say(
            "hello",
            {
                "protocol_version": 1,
                "role": self._role,
                "target": 1,
                "schema_hash": self._schema,
                "build_id": 0xABCDEF,
                "device_id": DEVICE_ID,
                "reset_reason": 0,
                "tick_rate_hz": TICKS_PER_S,
                "conn_interval_us": 7500,
                "uptime_ms": int(1000 * self._uptime_s()),
            },
        )

    def _status(self, reason: int | None = None) -> None:
        values = self._in_force
        ready = self._now_s >= self._ready_s
        gyro = values["gyro_bias_radps"] if values else [0.0] * 3
        status = {
            "t_ticks_node": int(self._uptime_s() * TICKS_PER_S),
            "origin": 1 if values else 0,
            "reason": reason if reason is not None else 0 if values else ABSENT,
            "boot_check": APPLIED if ready else MOVING,
            "boot_attempts": 1,
            "ready": int(ready),
            "raw": int(self.raw),
            "record_crc32": 0,
            "accel_bias_mps2": values["accel_bias_mps2"] if values else [0.0] * 3,
            "accel_matrix": values["accel_matrix"] if values else np.eye(3).ravel().tolist(),
            # The boot check puts what it has measured in the place of what was stored.
            "gyro_bias_radps": self.errors.gyro_bias_radps.tolist() if ready else gyro,
            "boot_delta_dps": 0.01,
            "temperature_cdegc": 2500,
        }
        self._say("cal_status", status | dict(self._changed))

    def _stream(self) -> None:
        whole = int(self._uptime_s() * RATE_HZ - self._sample) // BATCH
        if whole <= 0:
            return
        first_s = (self._sample + np.arange(whole * BATCH)) / RATE_HZ
        t = self._boot_s + first_s
        rate = np.zeros((len(t), 3))
        moved = t < self._moving_until_s
        for knock_s in self._knocks_s:
            moved |= (t >= knock_s) & (t < knock_s + 0.05)
        rate[moved] = self._rng.normal(0.0, 0.5, (int(moved.sum()), 3))
        got = measure(
            np.tile(G_MPS2 * self.up, (len(t), 1)),
            rate,
            t,
            config=ImuConfig(RATE_HZ),
            errors=self.errors,
            rng=self._rng,
        )
        for at in range(0, len(t), BATCH):
            rows = slice(at, at + BATCH)
            self._say(
                "imu_batch",
                self.batch(got.gyro_lsb[rows], got.accel_lsb[rows], float(first_s[at])),
            )
            self._sample += BATCH

    def batch(self, gyro_lsb: Any, accel_lsb: Any, first_s: float = 0.0) -> Values:
        return {
            "source": self._role,
            "flags": 1 | (8 if self.raw or self._now_s < self._ready_s else 0),
            "accel_fs_g": 16,
            "gyro_fs_dps": 2000,
            "sample_index": self._sample,
            "t_first_ticks_node": int(first_s * TICKS_PER_S),
            "period_ticks": round(256 * TICKS_PER_S / RATE_HZ),
            "t_sigma_ticks": 256,
            "temperature_cdegc": 2650,
            "samples": [
                {"gyro_lsb": g, "accel_lsb": a}
                for g, a in zip(gyro_lsb.tolist(), accel_lsb.tolist(), strict=True)
            ],
        }

    def _take(self, what: str, values: Values) -> None:
        answers = what not in self.wrong.unanswered
        if what == "reboot":
            self._reboot()
        elif what in ("raw_on", "raw_off"):
            self.raw = what == "raw_on"
            if answers:
                self._status()
        elif what == "cal_read":
            self._say("cal_record", self.stored) if self.stored else self._status(ABSENT)
        elif what == "cal_record":
            self._keep(values, answers)

    def _keep(self, values: Values, answers: bool) -> None:
        refused = EINVAL if values["device_id"] != DEVICE_ID else self.wrong.refuse
        if refused:
            self._fault(34, refused)
            return
        self.stored = self._in_force = values | dict(self.wrong.stored_as)
        if answers:
            self._say("cal_record", self.stored)
            self._status()

    def _fault(self, code: int, argument: int) -> None:
        self._say(
            "fault",
            {"t_ticks_node": 0, "code": code, "argument": argument, "detail": [0] * 48},
        )

    def _reboot(self) -> None:
        self.boots += 1
        self.raw = False
        self._waiting = b""
        self._alive = self.wrong.comes_back
        self._boot_s = self._now_s
        self._ready_s = self._boot_s + self.wrong.boot_s
        self._seq = self._sample = 0
        self._in_force = self.stored
        self._changed = self.wrong.after_reset
        if self._alive:
            self._hello()
            self._status()
