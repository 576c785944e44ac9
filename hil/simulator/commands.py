# SPDX-License-Identifier: Apache-2.0
"""What the host says to a simulated node, and when: the file that ``-hil_commands`` takes."""

from __future__ import annotations

from pathlib import Path

from hil.recording import ClockModel
from hil.scenario import ImuScenario, Scenario
from hil.wire.codec import encode

BOOTED_US = 20_000
"""Node's time at which its receiver is on and its IMU has not yet made a sample."""


def write(path: Path, scenario: Scenario, role: str, clock: ClockModel) -> bool:
    """Write the commands of ``role``; False, and no file, when there are none."""
    due: list[tuple[float, str, dict[str, float]]] = []
    imu = scenario.node(role).imu
    if (setup := imu_setup(imu)) is not None:
        due.append((BOOTED_US, "imu_setup", setup))
    if role == "leader":
        due += [
            (float(clock.local_us(drop.at_s * 1e6)), "link_drop", {"hold_ms": drop.hold_ms})
            for drop in scenario.link_drops
        ]
    if not due:
        return False
    lines = [
        f"{round(local_us)},{encode(name, values, seq).hex()}\n"
        for seq, (local_us, name, values) in enumerate(sorted(due, key=lambda c: c[0]))
    ]
    path.write_text("".join(lines), encoding="ascii")
    return True


def imu_setup(imu: ImuScenario) -> dict[str, float] | None:
    """The settings to send, or None when the image's own are wanted."""
    if not (imu.odr_hz or imu.accel_fs_g or imu.gyro_fs_dps or imu.rest_s):
        return None
    return {
        "odr_hz": imu.odr_hz,
        "accel_fs_g": imu.accel_fs_g,
        "gyro_fs_dps": imu.gyro_fs_dps,
        "rest_s": imu.rest_s,
    }
