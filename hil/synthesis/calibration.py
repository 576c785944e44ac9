# SPDX-License-Identifier: Apache-2.0
"""The boot check of a synthetic run, and its faults: no stored record, chips without errors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from hil.synthesis.clock import Clock
from hil.synthesis.draft import Draft
from hil.synthesis.imu import FIRST_SAMPLE_S
from hil.synthesis.plan import Plan
from hil.wire.messages import BOOT_CHECKS, CAL_REASONS, IMU_FLAGS, ROLES

WINDOW_S: Final = 1.0
LATE_S: Final = 2.0


def calibration(plan: Plan, out: Draft, clocks: dict[str, Clock]) -> None:
    """CAL status each second; samples of the first still second leave uncorrected."""
    for role in ROLES:
        decided_us = 1e6 * (FIRST_SAMPLE_S + WINDOW_S)
        _flag(out, role, float(clocks[role].ticks(decided_us)))
        for second in range(1, int(plan.duration_s)):
            ready = 1e6 * second >= decided_us
            out.add(
                role,
                1e9 * second + 3e6,
                "cal_status",
                t_ticks_node=int(clocks[role].ticks(min(1e6 * second, decided_us))),
                origin=0,
                reason=CAL_REASONS["absent"],
                boot_check=BOOT_CHECKS["applied" if ready else "pending"],
                boot_attempts=int(ready),
                ready=int(ready),
                raw=0,
                record_crc32=0,
                accel_bias_mps2=[0.0] * 3,
                accel_matrix=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                gyro_bias_radps=[0.0] * 3,
                boot_delta_dps=0.0,
                temperature_cdegc=2500,
            )


def _flag(out: Draft, role: str, until_ticks: float) -> None:
    """Mark as uncorrected what ``role`` sampled before that instant."""
    for frame in out.of(role, "imu_batch"):
        own = frame.values["source"] == ROLES[role]
        if own and frame.values["t_first_ticks_node"] < until_ticks:
            frame.values["flags"] |= IMU_FLAGS["uncorrected"]


def _decided_late(out: Draft) -> None:
    for role in ROLES:
        own = [f for f in out.of(role, "imu_batch") if f.values["source"] == ROLES[role]]
        begun = own[0].values["t_first_ticks_node"]
        _flag(out, role, begun + 16e6 * (WINDOW_S + LATE_S))


def _never_decided(out: Draft) -> None:
    for role in ROLES:
        _flag(out, role, float("inf"))
        for frame in out.of(role, "cal_status"):
            frame.values.update(ready=0, boot_check=BOOT_CHECKS["moving"])


def _says(**values: object) -> Callable[[Draft], None]:
    def change(out: Draft) -> None:
        for role in ROLES:
            for frame in out.of(role, "cal_status"):
                if frame.values["ready"]:
                    frame.values.update(values)

    return change


CALIBRATION_FAULTS: Final[dict[str, tuple[str, Callable[[Draft], None]]]] = {
    "cal_late": ("samples leave uncorrected for two seconds too long", _decided_late),
    "cal_never": ("the boot check never finds a still second", _never_decided),
    "cal_branch": (
        "the bias is refused though it has hardly moved, and nobody is told",
        _says(boot_check=BOOT_CHECKS["refused"]),
    ),
    "cal_bias": (
        "the bias in force is not the chip's",
        _says(gyro_bias_radps=[0.0, 0.001, 0.0]),
    ),
    "cal_delta": ("the reported change of the bias is wrong", _says(boot_delta_dps=0.1)),
}
