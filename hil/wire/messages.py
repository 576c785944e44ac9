# SPDX-License-Identifier: Apache-2.0
"""The protocol table: every message that either node sends, field by field.

This table is the only definition of the protocol. ``hil.wire.cgen`` turns it into
``firmware/lib/wire/wire.h``, ``hil.wire.codec`` into NumPy structured types, and
:func:`schema_hash` into the 64-bit number that both sides exchange in HELLO.

The same payloads travel on two carriers: framed on the serial line
(``00 <COBS(type u8, seq u16, payload, crc16)> 00``) and, as ``type u8, payload``, in GATT
notifications between the nodes.

All integers are little-endian and unaligned. A field's physical value is ``raw * scale`` in
``unit``. A field that is a time names its clock: ``leader`` and ``follower`` are the 16 MHz
TIMER of that node, extended to 64 bit; ``node`` is the clock of whichever node sends the frame.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any, Final

TICK_RATE_HZ: Final = 16_000_000
"""Rate of the timestamp TIMER on both nodes (nRF52840 PS v1.7, section 6.30, prescaler 0)."""

PROTOCOL_VERSION: Final = 1

TYPE_SIZES: Final[Mapping[str, int]] = {
    "u8": 1,
    "i8": 1,
    "u16": 2,
    "i16": 2,
    "u32": 4,
    "i32": 4,
    "f32": 4,
    "u64": 8,
    "i64": 8,
}


class WireError(ValueError):
    """A schema, a frame or a payload that the protocol does not allow."""


@dataclass(frozen=True)
class Field:
    """One field of a message.

    Attributes:
        name: quantity, unit and clock, in the field's standard terms.
        type: a key of :data:`TYPE_SIZES`.
        unit: SI unit of ``raw * scale``; ``"1"`` for pure numbers, ``"tick"`` for TIMER ticks.
        meaning: one sentence.
        scale: physical value of one count.
        clock: ``leader``, ``follower``, ``node`` or empty when the field is not a time.
        count: number of elements; more than one makes a fixed array.
    """

    name: str
    type: str
    unit: str
    meaning: str
    scale: float = 1.0
    clock: str = ""
    count: int = 1

    @property
    def size(self) -> int:
        return TYPE_SIZES[self.type] * self.count


@dataclass(frozen=True)
class Group:
    """Rows that repeat at the end of a message; ``count_field`` says how many follow."""

    name: str
    count_field: str
    max_count: int
    fields: tuple[Field, ...]

    @property
    def size(self) -> int:
        return sum(f.size for f in self.fields)


@dataclass(frozen=True)
class Message:
    """One message type. ``group`` is absent for messages of fixed size."""

    name: str
    id: int
    meaning: str
    fields: tuple[Field, ...]
    group: Group | None = None

    @property
    def fixed_size(self) -> int:
        return sum(f.size for f in self.fields)

    @property
    def max_size(self) -> int:
        return self.fixed_size + (self.group.size * self.group.max_count if self.group else 0)


SUBTICK: Final = 1.0 / 256.0
SKEW_LSB: Final = 1e-12

ROLES: Final[Mapping[str, int]] = {"leader": 0, "follower": 1}
TARGETS: Final[Mapping[str, int]] = {"sim": 0, "nrf52840dk": 1}
SYNC_STATES: Final[Mapping[str, int]] = {"unsynced": 0, "converging": 1, "locked": 2, "holdover": 3}
PULSE_FLAGS: Final[Mapping[str, int]] = {"late": 1, "captured": 2}
IMU_FLAGS: Final[Mapping[str, int]] = {
    "hardware_time": 1,
    "overrun_before": 2,
    "clipped": 4,
    "uncorrected": 8,
}
CAL_ORIGINS: Final[Mapping[str, int]] = {"defaults": 0, "stored": 1}
CAL_REASONS: Final[Mapping[str, int]] = {
    "none": 0,
    "absent": 1,
    "corrupt": 2,
    "version": 3,
    "other_device": 4,
    "flash": 5,
}
BOOT_CHECKS: Final[Mapping[str, int]] = {
    "pending": 0,
    "applied": 1,
    "warned": 2,
    "refused": 3,
    "moving": 4,
}
NODE_COMMANDS: Final[Mapping[str, int]] = {
    "cal_read": 1,
    "cal_erase": 2,
    "raw_on": 3,
    "raw_off": 4,
    "reboot": 5,
    "fail_fatal": 240,
    "fail_stack": 241,
    "fail_hang": 242,
}
"""From 240 on: only of test builds, with BV_FAULT_COMMANDS."""

LINK_KEY_ORIGINS: Final[Mapping[str, int]] = {"image": 0, "stored": 1}
REP_KINDS: Final[Mapping[str, int]] = {"none": 0, "full": 1, "partial": 2}
REP_FLAGS: Final[Mapping[str, int]] = {
    "correction": 1,
    "lowered": 2,
    "paused": 4,
    "from_floor": 8,
    "follower_lost": 16,
    "clipped": 32,
}
FAULT_CODES: Final[Mapping[str, int]] = {
    "assert": 1,
    "watchdog": 2,
    "stack": 3,
    "imu_who_am_i": 16,
    "imu_bus": 17,
    "imu_no_interrupt": 18,
    "imu_fifo_config": 19,
    "link_bad_payload": 32,
    "ppi_exhausted": 33,
    "command_refused": 34,
    "fusion_overrun": 35,
    "link_stranger": 36,
    "cal_bias_refused": 48,
    "cal_store": 49,
}

MESSAGES: Final[tuple[Message, ...]] = (
    Message(
        "hello",
        1,
        "Who is speaking: sent at boot and every two seconds.",
        (
            Field("protocol_version", "u8", "1", "Version of the framing."),
            Field("role", "u8", "1", "0 leader, 1 follower."),
            Field("target", "u8", "1", "0 simulated radio, 1 nRF52840 DK."),
            Field("schema_hash", "u64", "1", "First eight bytes of the SHA-256 of the table."),
            Field("build_id", "u64", "1", "Build identity given by the build orchestrator."),
            Field("device_id", "u64", "1", "FICR DEVICEID of the chip."),
            Field("reset_reason", "u32", "1", "POWER RESETREAS as found at boot."),
            Field("tick_rate_hz", "u32", "Hz", "Rate of the node's timestamp TIMER."),
            Field("conn_interval_us", "u32", "us", "Connection interval asked for."),
            Field("uptime_ms", "u32", "ms", "Time since boot on the kernel's clock."),
        ),
    ),
    Message(
        "imu_batch",
        2,
        "Consecutive samples of one IMU with the hardware time of the first.",
        (
            Field("source", "u8", "1", "Whose IMU: 0 leader, 1 follower."),
            Field("flags", "u8", "1", "Bits of IMU_FLAGS."),
            Field("accel_fs_g", "u8", "g", "Accelerometer full scale."),
            Field("gyro_fs_dps", "u16", "dps", "Gyroscope full scale."),
            Field("sample_index", "u32", "1", "Index of the first sample since the IMU started."),
            Field("t_first_ticks_node", "u64", "tick", "Time of the first sample.", clock="node"),
            Field("period_ticks", "u32", "tick", "Measured sample period.", SUBTICK, clock="node"),
            Field(
                "t_sigma_ticks",
                "u16",
                "tick",
                "Standard error of the first sample's time; 65535: that or more.",
                SUBTICK,
            ),
            Field("temperature_cdegc", "i16", "degC", "Die temperature.", 0.01),
            Field("count", "u8", "1", "Samples that follow."),
        ),
        Group(
            "samples",
            "count",
            16,
            (
                Field("gyro_lsb", "i16", "LSB", "Angular rate, raw counts, x y z.", count=3),
                Field("accel_lsb", "i16", "LSB", "Specific force, raw counts, x y z.", count=3),
            ),
        ),
    ),
    Message(
        "sync_capture",
        3,
        "This node's own captures of one connection event: end of its TX and of its RX.",
        (
            Field("event", "u32", "1", "Connection event counter, extended to 32 bit."),
            Field("generation", "u8", "1", "Counts connections since boot."),
            Field("tx_end_ticks_node", "u64", "tick", "RADIO END of the first TX.", clock="node"),
            Field("rx_end_ticks_node", "u64", "tick", "RADIO END of the first RX.", clock="node"),
        ),
    ),
    Message(
        "sync_pair",
        4,
        "The leader's pairing of both nodes' captures of one connection event.",
        (
            Field("event", "u32", "1", "Connection event counter, extended to 32 bit."),
            Field("generation", "u8", "1", "Counts connections since boot."),
            Field("flags", "u8", "1", "1: used in the estimate; 0: dropped as an outlier."),
            Field("tx_end_ticks_leader", "u64", "tick", "Leader TX end.", clock="leader"),
            Field("rx_end_ticks_leader", "u64", "tick", "Leader RX end.", clock="leader"),
            Field("tx_end_ticks_follower", "u64", "tick", "Follower TX end.", clock="follower"),
            Field("rx_end_ticks_follower", "u64", "tick", "Follower RX end.", clock="follower"),
        ),
    ),
    Message(
        "sync_state",
        5,
        "Clock model: follower = leader + offset + skew * (leader - t_ref).",
        (
            Field("t_ref_ticks_leader", "u64", "tick", "Reference instant.", clock="leader"),
            Field(
                "offset_ticks",
                "i64",
                "tick",
                "Follower minus leader at the reference instant.",
                SUBTICK,
            ),
            Field("skew", "i32", "1", "Follower rate over leader rate, minus one.", SKEW_LSB),
            Field("residual_rms_ticks", "u32", "tick", "RMS of the fit's residuals.", SUBTICK),
            Field("offset_sigma_ticks", "u32", "tick", "Standard error of offset.", SUBTICK),
            Field("window_us", "u32", "us", "Length of the window of pairs."),
            Field("pairs_used", "u16", "1", "Pairs in the window."),
            Field("pairs_dropped", "u32", "1", "Pairs rejected since boot."),
            Field("state", "u8", "1", "A value of SYNC_STATES."),
            Field("generation", "u8", "1", "Counts connections since boot."),
        ),
    ),
    Message(
        "pulse",
        6,
        "A pulse emitted by TIMER COMPARE -> GPIOTE at an instant of the leader's clock.",
        (
            Field("index", "u32", "1", "Pulse number on the leader's schedule; equal on both."),
            Field("scheduled_ticks_leader", "u64", "tick", "Agreed instant.", clock="leader"),
            Field("compare_ticks_node", "u64", "tick", "Programmed COMPARE.", clock="node"),
            Field(
                "captured_ticks_node",
                "u64",
                "tick",
                "Capture of the other node's pulse when wired; 0 when not.",
                clock="node",
            ),
            Field("flags", "u8", "1", "Bits of PULSE_FLAGS."),
        ),
    ),
    Message(
        "fifo_stats",
        7,
        "Counters of the IMU FIFO since boot.",
        (
            Field("t_ticks_node", "u64", "tick", "When counted.", clock="node"),
            Field("samples", "u32", "1", "Sample pairs decoded."),
            Field("batches", "u32", "1", "Bursts read."),
            Field("overruns", "u32", "1", "FIFO overruns."),
            Field("tag_gaps", "u32", "1", "Breaks in the tag counter."),
            Field("parity_errors", "u32", "1", "Words with wrong tag parity."),
            Field("config_changes", "u32", "1", "Config-change words."),
            Field("short_reads", "u32", "1", "Bursts shorter than the level said."),
            Field("bus_errors", "u32", "1", "SPI transfers that failed."),
            Field("missed_edges", "u32", "1", "Watermarks found by poll and not by edge."),
            Field("level_max", "u16", "1", "Largest level seen since the last report, words."),
            Field("watermark", "u16", "1", "Watermark programmed, words."),
            Field("bus_busy_us", "u32", "us", "Time in SPI transfers since boot."),
            Field("odr_hz", "f32", "Hz", "Nominal output data rate of the sensor."),
            Field("decimation", "u8", "1", "Samples of the sensor to one of the stream."),
            Field("samples_crc32", "u32", "1", "CRC-32 (IEEE) over all of `samples`, in order."),
            Field(
                "samples_unsettled", "u32", "1", "Pairs dropped before sensor and clock settled."
            ),
            Field("slots_by_time", "u32", "1", "Lost slots that only time could show."),
            Field("edges_refused", "u32", "1", "Edges that do not fit the slots around them."),
            Field("restarts", "u16", "1", "Times the sensor had to be set up anew."),
            Field("wake_ups", "u16", "1", "Times motion ended a rest."),
            Field("wake_to_sample_us", "u32", "us", "Wake-up edge to first sample, last time."),
        ),
    ),
    Message(
        "link_stats",
        8,
        "State of the BLE link.",
        (
            Field("t_ticks_node", "u64", "tick", "When counted.", clock="node"),
            Field("connected", "u8", "1", "1 when connected."),
            Field("phy", "u8", "1", "1: 1M, 2: 2M."),
            Field("rssi_dbm", "i8", "dBm", "Last RSSI; 127 when unknown."),
            Field("mtu", "u16", "B", "ATT MTU."),
            Field("conn_interval_us", "u32", "us", "Interval in use."),
            Field("events", "u32", "1", "Connection events with at least one capture."),
            Field("crc_errors", "u32", "1", "Packets received with a wrong CRC."),
            Field("disconnects", "u16", "1", "Disconnections since boot."),
            Field("batches_sent", "u32", "1", "IMU batches given to the link."),
            Field("batches_received", "u32", "1", "IMU batches received from the link."),
            Field("batches_lost", "u32", "1", "Gaps seen in the peer's sample index."),
            Field("batches_late", "u32", "1", "Batches older than the lateness limit."),
            Field("tx_dropped", "u32", "1", "Messages dropped because the queue was full."),
            Field("bad_payloads", "u32", "1", "GATT payloads refused."),
        ),
    ),
    Message(
        "ekf_state",
        9,
        "State of the estimator after one step.",
        (
            Field("t_ticks_leader", "u64", "tick", "Time of the state.", clock="leader"),
            Field("step", "u32", "1", "Step number."),
            Field("position_m", "f32", "m", "World frame, z up.", count=3),
            Field("velocity_mps", "f32", "m/s", "World frame, z up.", count=3),
            Field("quaternion", "f32", "1", "Body to world, w x y z.", count=4),
            Field("accel_bias_mps2", "f32", "m/s^2", "Body frame.", count=3),
            Field("gyro_bias_radps", "f32", "rad/s", "Body frame.", count=3),
            Field("variance", "f32", "1", "Diagonal of P, 15 error states.", count=15),
            Field("innovation", "f32", "1", "Last innovation.", count=3),
            Field("nis", "f32", "1", "Normalised innovation squared of the last update."),
            Field("gate", "f32", "1", "Gate that NIS was held against."),
            Field("flags", "u16", "1", "Which updates ran and which were gated."),
            Field("centre_velocity_mps", "f32", "m/s", "Of the bar's centre, world.", count=3),
            Field("centre_height_m", "f32", "m", "Of the bar's centre, from the start."),
        ),
    ),
    Message(
        "attitude",
        10,
        "Madgwick baseline beside the EKF.",
        (
            Field("t_ticks_leader", "u64", "tick", "Time of the state.", clock="leader"),
            Field("quaternion", "f32", "1", "Body to world, w x y z.", count=4),
            Field("divergence_rad", "f32", "rad", "Angle between baseline and EKF."),
        ),
    ),
    Message(
        "cal_status",
        11,
        "Which calibration is in force and what the boot check found.",
        (
            Field("t_ticks_node", "u64", "tick", "When decided.", clock="node"),
            Field("origin", "u8", "1", "A value of CAL_ORIGINS."),
            Field("reason", "u8", "1", "Why defaults: a value of CAL_REASONS."),
            Field("boot_check", "u8", "1", "A value of BOOT_CHECKS."),
            Field("boot_attempts", "u8", "1", "Windows of stillness tried; 255: that or more."),
            Field("ready", "u8", "1", "1 once the boot check has decided."),
            Field("raw", "u8", "1", "1 while the host has the correction switched off."),
            Field("record_crc32", "u32", "1", "CRC-32 of the record in force; 0 for defaults."),
            Field("accel_bias_mps2", "f32", "m/s^2", "Bias in force.", count=3),
            Field("accel_matrix", "f32", "1", "Correction in force, row by row.", count=9),
            Field("gyro_bias_radps", "f32", "rad/s", "Bias in force.", count=3),
            Field("boot_delta_dps", "f32", "dps", "Boot bias minus stored bias, magnitude."),
            Field("temperature_cdegc", "i16", "degC", "Die temperature at the check.", 0.01),
        ),
    ),
    Message(
        "system",
        12,
        "Health of the node.",
        (
            Field("t_ticks_node", "u64", "tick", "When measured.", clock="node"),
            Field("cpu_load_permille", "u16", "1", "Non-idle share since the last report.", 1e-3),
            Field("stack_free_min_b", "u16", "B", "Smallest stack headroom of any thread."),
            Field("heap_used_b", "u32", "B", "System heap in use."),
            Field("heap_peak_b", "u32", "B", "System heap high-water mark."),
            Field("uart_dropped", "u32", "1", "Frames dropped because the line was full."),
            Field("timer_wraps", "u32", "1", "Wraps of the 32-bit TIMER."),
        ),
    ),
    Message(
        "fault",
        13,
        "Something is wrong and a person should act.",
        (
            Field("t_ticks_node", "u64", "tick", "When noticed.", clock="node"),
            Field("code", "u16", "1", "A value of FAULT_CODES."),
            Field("argument", "u32", "1", "Depends on the code."),
            Field("detail", "u8", "1", "ASCII, zero padded.", count=48),
        ),
    ),
    Message(
        "imu_setup",
        14,
        "Host to node: start the IMU anew with these settings; 0 leaves one as the image has it.",
        (
            Field("odr_hz", "f32", "Hz", "Output data rate; the nearest one is taken."),
            Field("accel_fs_g", "u8", "g", "Accelerometer full scale: 2, 4, 8, 16."),
            Field("gyro_fs_dps", "u16", "dps", "Gyroscope full scale: 125, 250, 500, 1000, 2000."),
            Field("rest_s", "u16", "s", "Stillness after which the sensor rests; 65535: never."),
        ),
    ),
    Message(
        "link_drop",
        15,
        "Host to node: end the BLE connection; the nodes then connect anew by themselves.",
        (Field("hold_ms", "u16", "ms", "How long this node stays away from the radio first."),),
    ),
    Message(
        "cal_record",
        16,
        "A calibration. Host to node: store it. Node to host: what its store holds.",
        (
            Field("device_id", "u64", "1", "FICR DEVICEID of the node it was measured on."),
            Field("created_unix_s", "u32", "s", "When it was measured, Unix time."),
            Field("temperature_cdegc", "i16", "degC", "Die temperature meanwhile.", 0.01),
            Field("accel_bias_mps2", "f32", "m/s^2", "b in a = M (raw - b).", count=3),
            Field("accel_matrix", "f32", "1", "M in a = M (raw - b), row by row.", count=9),
            Field("gyro_bias_radps", "f32", "rad/s", "Subtracted from the raw rate.", count=3),
        ),
    ),
    Message(
        "node_command",
        17,
        "Host to node: do this now.",
        (Field("command", "u8", "1", "A value of NODE_COMMANDS."),),
    ),
    Message(
        "rep",
        18,
        "One repetition, once it has ended; again, by the same number, when more is known of it.",
        (
            Field("set", "u16", "1", "Sets since boot; a gap in the estimate begins a new one."),
            Field("number", "u16", "1", "Counts the repetitions reported in the set, from 1."),
            Field("kind", "u8", "1", "A value of REP_KINDS; none: it was no repetition after all."),
            Field("flags", "u8", "1", "Bits of REP_FLAGS."),
            Field("phases", "u8", "1", "Concentric phases: more than one in a clean and jerk."),
            Field("full_count", "u16", "1", "Full repetitions of the set up to this one."),
            Field("t_start_ticks_leader", "u64", "tick", "Begins to rise.", clock="leader"),
            Field("t_end_ticks_leader", "u64", "tick", "Has risen.", clock="leader"),
            Field("mean_mps", "f32", "m/s", "Mean velocity, of the fastest phase."),
            Field("peak_mps", "f32", "m/s", "Peak velocity, of the fastest phase."),
            Field("time_to_peak_s", "f32", "s", "From the beginning of that phase to its peak."),
            Field("eccentric_s", "f32", "s", "How long the bar was lowered; NaN: not, or not yet."),
            Field("pause_s", "f32", "s", "From lowered to rising; NaN: not lowered before."),
            Field("range_m", "f32", "m", "From the lowest to the highest point of the lift."),
            Field("tilt_rad", "f32", "rad", "Largest tilt of the bar, leader's end up."),
            Field(
                "velocity_loss",
                "f32",
                "1",
                "Mean velocity against the fastest full one up to it; NaN: partial, or the first.",
            ),
        ),
    ),
    Message(
        "link_key",
        19,
        "Host to node: the key that both nodes prove to each other; zeros: the image's own again.",
        (Field("key", "u8", "1", "128 bits, from a source of randomness.", count=16),),
    ),
    Message(
        "link_security",
        20,
        "How the link is kept to the one peer.",
        (
            Field("t_ticks_node", "u64", "tick", "When counted.", clock="node"),
            Field("key", "u8", "1", "A value of LINK_KEY_ORIGINS: the one in force."),
            Field("secure", "u8", "1", "1: the peer has proved the key, all is encrypted."),
            Field("refused", "u32", "1", "Connections ended as the peer did not prove the key."),
        ),
    ),
    Message(
        "thread",
        21,
        "Stack of one thread; one thread a second, in turn.",
        (
            Field("t_ticks_node", "u64", "tick", "When measured.", clock="node"),
            Field("name", "u8", "1", "ASCII, zero padded.", count=16),
            Field("stack_size_b", "u32", "B", "Size of its stack."),
            Field("stack_free_b", "u32", "B", "Never used since boot; in simulation meaningless."),
        ),
    ),
)

BY_NAME: Final[Mapping[str, Message]] = {m.name: m for m in MESSAGES}


def name_of(names: Mapping[str, int], number: int) -> str:
    """The name of a value of a set such as FAULT_CODES; the number itself where it has none."""
    return next((name for name, known in names.items() if known == number), str(int(number)))


def schema(messages: tuple[Message, ...] = MESSAGES) -> dict[str, Any]:
    """The table as plain data: what a recording embeds and what the hash covers."""
    return {
        "protocol_version": PROTOCOL_VERSION,
        "tick_rate_hz": TICK_RATE_HZ,
        "messages": [asdict(m) for m in messages],
    }


@cache
def schema_hash(messages: tuple[Message, ...] = MESSAGES) -> int:
    """First eight bytes, little-endian, of the SHA-256 of the canonical JSON of the table.

    Prose (``meaning``) is left out, so that wording can improve without breaking a link.
    """

    def strip(node: Any) -> Any:
        if isinstance(node, dict):
            return {k: strip(v) for k, v in node.items() if k != "meaning"}
        if isinstance(node, list | tuple):
            return [strip(v) for v in node]
        return node

    canonical = json.dumps(strip(schema(messages)), sort_keys=True, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(canonical.encode()).digest()[:8], "little")
