# SPDX-License-Identifier: Apache-2.0
"""Talking to one unit: who it is, its raw samples, its calibration, its reset."""

from __future__ import annotations

import errno
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from hil.calibration.poses import Block, joined
from hil.errors import RigError
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, CLIPPED_LSB, GYRO_RADPS_PER_LSB_PER_DPS
from hil.wire.codec import Decoded, encode
from hil.wire.live import LiveStream
from hil.wire.messages import (
    FAULT_CODES,
    IMU_FLAGS,
    NODE_COMMANDS,
    ROLES,
    SUBTICK,
    TICK_RATE_HZ,
    schema_hash,
)

POLL_S: Final = 0.1
HELLO_LIMIT_S: Final = 6.0
"""HELLO comes every two seconds."""
ANSWER_LIMIT_S: Final = 3.0
TRIES: Final = 3
SAMPLES_LIMIT_S: Final = 5.0
BOOT_LIMIT_S: Final = 30.0
BOOTED_MS: Final = 1000
"""A HELLO this old is not the one that a node says at boot."""
RATE_BATCHES: Final = 64
"""The rate is the median of the periods that so many batches state."""

# What a frame may say whose CRC is right by chance only: one damaged frame in 65536.
ACCEL_FS_G: Final = (2, 4, 8, 16)
GYRO_FS_DPS: Final = (125, 250, 500, 1000, 2000)
RATE_LIMITS_HZ: Final = (10.0, 8000.0)
"""The sensor has 12.5 to 6667 Hz, a few percent off."""
TEMPERATURE_LIMITS_CDEGC: Final = (-6000, 12500)

Frame = Mapping[str, Any]


class Port(Protocol):
    """An open serial line."""

    def read_bytes(self, timeout_s: float) -> bytes:
        """What came since the last call; waits when nothing did; empty when nothing came."""
        ...

    def write(self, data: bytes) -> None: ...


class Unit:
    """One unit at the end of a serial line.

    Args:
        now_s: a clock that never goes back; limits of waiting are by it.

    Attributes:
        hello: its last HELLO, raw values by field.
        status: its last CAL status.
        record: its last CAL record; None until it sent one.
    """

    def __init__(self, port: Port, role: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self.role = role
        self.hello: dict[str, Any] = {}
        self.status: dict[str, Any] = {}
        self.record: dict[str, Any] | None = None
        self._port = port
        self._now_s = now_s
        self._stream = LiveStream()
        self._seq = 0
        self._refusals: list[int] = []
        self._blocks: list[Block] = []
        self._periods_ticks: deque[float] = deque(maxlen=RATE_BATCHES)

    @property
    def device_id(self) -> str:
        """16 hexadecimal digits."""
        return f"{int(self.hello['device_id']):016x}"

    @property
    def build_id(self) -> str:
        return f"{int(self.hello['build_id']):016x}"

    @property
    def rate_hz(self) -> float:
        """Measured rate of the raw samples; there must have been some."""
        return TICK_RATE_HZ / float(np.median(self._periods_ticks))

    def connect(self) -> None:
        """Wait for it to say who it is.

        Raises:
            RigError: nothing comes, it is another role's, or it speaks another protocol.
        """
        self._wait(lambda: bool(self.hello), HELLO_LIMIT_S, "did not say who it is", _MEND_SILENT)
        if self.hello["schema_hash"] != schema_hash():
            raise RigError(
                "this unit's firmware speaks another version of the protocol",
                f"hil build --role {self.role} --target nrf52840dk\nhil bench flash",
            )
        if self.hello["role"] != ROLES[self.role]:
            found = next((r for r, n in ROLES.items() if n == self.hello["role"]), "")
            raise RigError(
                f"this unit is {f'the {found}' if found else 'neither'}, not the {self.role}",
                (f"--role {found}\n" if found else "")
                + f"give the port of the {self.role}: --port PATH",
            )
        self._wait(lambda: bool(self.status), HELLO_LIMIT_S, "sends no CAL status", _MEND_SILENT)

    @contextmanager
    def raw(self) -> Iterator[None]:
        """Within the block samples come as the sensor makes them; whatever happens, not after."""
        try:
            self._set_raw(True)
            yield
            self._set_raw(False)
        except BaseException:
            # What went wrong is worth more than a unit that cannot be told any more.
            with suppress(RigError):
                self._set_raw(False)
            raise

    def samples(self) -> Block:
        """Raw samples since the last call; waits until there are some.

        Raises:
            RigError: none come.
        """
        self._wait(
            lambda: bool(self._blocks), SAMPLES_LIMIT_S, "sends no raw samples", _MEND_SENSOR
        )
        taken, self._blocks = self._blocks, []
        return joined(taken)

    def drop_samples(self) -> None:
        """Forget what has come, and what waits in the line."""
        while self._port.read_bytes(0.0):
            pass
        self._stream = LiveStream()
        self._blocks = []

    def read_record(self) -> Frame | None:
        """The record in its store; None when there is none.

        Raises:
            RigError: it does not answer.
        """
        before = self.status
        self.record = None
        self.status = {}
        # A status comes each second anyway; with a reason it says that there is no record.
        self._ask(
            "cal_read",
            lambda: self.record is not None or bool(self.status.get("reason", 0)),
        )
        self.status = self.status or before
        return self.record

    def write_record(self, values: Frame) -> None:
        """Store a record and compare what the unit reads back.

        Raises:
            RigError: it refused the record, or its store holds another one afterwards.
        """
        # What it said before, while somebody thought about a question, is no answer.
        self.drop_samples()
        self.record = None
        self._refusals = []
        for _ in range(TRIES):
            self._send("cal_record", values)
            if self._came(lambda: self.record is not None or bool(self._refusals)):
                break
        if self.record is None:
            raise self._not_taken()
        self._compare(values)

    def reboot(self) -> None:
        """Reset it and wait until its boot check has decided.

        Raises:
            RigError: it does not come back, or is moved.
        """
        # Its uptime goes back: one from its boot could not, for each boot is as long.
        self.hello = {}
        self._wait(
            lambda: self.hello.get("uptime_ms", 0) >= BOOTED_MS,
            HELLO_LIMIT_S,
            "does not say any more who it is",
            _MEND_SILENT,
        )
        before_ms = self.hello["uptime_ms"]
        self.hello, self.status = {}, {}
        for _ in range(TRIES):
            self._send("node_command", {"command": NODE_COMMANDS["reboot"]})
            if self._came(
                lambda: bool(self.hello) and self.hello["uptime_ms"] <= before_ms,
                BOOT_LIMIT_S / TRIES,
            ):
                break
        else:
            raise RigError(
                f"the {self.role} did not come back after its reset within {BOOT_LIMIT_S:g} s",
                "the new calibration is in its store: press its reset button, and look:\n"
                f"hil calibrate --role {self.role} --dry-run",
            )
        self.status = {}
        self.wait_boot_check()

    def wait_boot_check(self) -> None:
        """Wait for a decision of the boot check.

        Raises:
            RigError: it does not come: the unit is being moved, or its sensor is silent.
        """
        self._wait(
            lambda: bool(self.status) and bool(self.status["ready"]),
            BOOT_LIMIT_S,
            "found no second of stillness since its reset",
            "lay it down, let go of it, and reset it\n" + _MEND_SENSOR,
        )

    def poll(self, timeout_s: float = POLL_S) -> None:
        """Take in what has come."""
        decoded = self._stream.feed(self._port.read_bytes(timeout_s))
        for name in ("hello", "cal_status", "cal_record"):
            found = decoded.messages[name]
            if found.size:
                self._keep(name, {field: found[field][-1] for field in found.dtype.names or ()})
        faults = decoded.messages["fault"]
        refused = faults["code"] == FAULT_CODES["command_refused"]
        self._refusals += [int(argument) for argument in faults["argument"][refused]]
        self._keep_samples(decoded)

    def _keep(self, name: str, frame: dict[str, Any]) -> None:
        if name == "hello":
            self.hello = frame
        elif name == "cal_status":
            self.status = frame
        else:
            self.record = frame

    def _keep_samples(self, decoded: Decoded) -> None:
        sent = decoded.messages["imu_batch"]
        own = sent["source"] == ROLES[self.role]
        raw = own & ((sent["flags"] & IMU_FLAGS["uncorrected"]) != 0) & _possible(sent)
        if not raw.any():
            return
        rows = decoded.groups["imu_batch"]
        rows = rows[raw[rows["row"]]]
        batch = sent[rows["row"]]
        accel_lsb = rows["accel_lsb"].astype(np.float64)
        gyro_lsb = rows["gyro_lsb"].astype(np.float64)
        far = np.maximum(np.abs(accel_lsb), np.abs(gyro_lsb)).max(axis=1)
        self._periods_ticks.extend((sent["period_ticks"][raw] * SUBTICK).tolist())
        self._blocks.append(
            Block(
                accel_lsb * (batch["accel_fs_g"] * ACCEL_MPS2_PER_LSB_PER_G)[:, np.newaxis],
                gyro_lsb * (batch["gyro_fs_dps"] * GYRO_RADPS_PER_LSB_PER_DPS)[:, np.newaxis],
                far >= CLIPPED_LSB,
                float(np.mean(sent["temperature_cdegc"][raw])) * 0.01,
            )
        )

    def _set_raw(self, on: bool) -> None:
        self.status = {}
        self._ask(
            "raw_on" if on else "raw_off",
            lambda: bool(self.status) and bool(self.status["raw"]) == on,
        )
        self._blocks = []

    def _ask(self, command: str, answered: Callable[[], bool]) -> None:
        """Send a command until it is answered: nothing else says that it arrived."""
        for _ in range(TRIES):
            self._send("node_command", {"command": NODE_COMMANDS[command]})
            if self._came(answered):
                return
        raise RigError(f"the {self.role} does not answer the command {command}", _MEND_SILENT)

    def _send(self, name: str, values: Frame) -> None:
        self._port.write(encode(name, values, self._seq))
        self._seq += 1

    def _came(self, condition: Callable[[], bool], limit_s: float = ANSWER_LIMIT_S) -> bool:
        deadline_s = self._now_s() + limit_s
        while not condition():
            if self._now_s() > deadline_s:
                return False
            self.poll()
        return True

    def _wait(self, condition: Callable[[], bool], limit_s: float, what: str, mend: str) -> None:
        if not self._came(condition, limit_s):
            raise RigError(f"the {self.role} {what} within {limit_s:g} s", mend)

    def _not_taken(self) -> RigError:
        """Why there was no answer to a record, and what its store holds then."""
        if not self._refusals:
            return RigError(
                f"the {self.role} does not answer; its store holds the old calibration or the new "
                "one, whole",
                f"look which: hil calibrate --role {self.role} --dry-run\n" + _MEND_SILENT,
            )
        number = self._refusals[-1]
        if number == errno.EINVAL:
            return RigError(
                f"the {self.role} refused the calibration as impossible; it keeps the one it had",
                "calibrate again, each face with its own side up",
            )
        return RigError(
            f"the {self.role} could not store the calibration (its error {number}); its store "
            "holds the old one or the new one, whole",
            "reset it and try again\nif it stays, its flash is worn or the image has no store",
        )

    def _compare(self, values: Frame) -> None:
        assert self.record is not None
        for name, sent in values.items():
            stored = np.asarray(self.record[name])
            if not np.array_equal(stored, np.asarray(sent, dtype=stored.dtype)):
                raise RigError(
                    f"the {self.role} stored another {name} than it was sent: {stored.tolist()}",
                    "write the calibration again: hil calibrate --from FILE",
                )


def _possible(batches: NDArray[np.void]) -> NDArray[np.bool_]:
    """Batches that say nothing a sensor cannot do: a CRC of 16 bits lets some damage through."""
    period_ticks = np.maximum(batches["period_ticks"], 1) * SUBTICK
    low_hz, high_hz = RATE_LIMITS_HZ
    low_cdegc, high_cdegc = TEMPERATURE_LIMITS_CDEGC
    rate_hz = TICK_RATE_HZ / period_ticks
    celsius = batches["temperature_cdegc"]
    return np.asarray(
        np.isin(batches["accel_fs_g"], ACCEL_FS_G)
        & np.isin(batches["gyro_fs_dps"], GYRO_FS_DPS)
        & (rate_hz >= low_hz)
        & (rate_hz <= high_hz)
        & (celsius >= low_cdegc)
        & (celsius <= high_cdegc)
    )


_MEND_SILENT: Final = (
    "is the board powered, and this its port? a DK has two: hil bench show\n"
    "is our firmware on it? hil doctor"
)
_MEND_SENSOR: Final = "look at the sensor's wiring: boards/README.md"
