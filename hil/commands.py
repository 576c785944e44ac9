# SPDX-License-Identifier: Apache-2.0
"""What the host says to the nodes during a scenario: the same to simulated nodes and to boards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hil.faults import nodes
from hil.scenario import ImuScenario, Scenario


@dataclass(frozen=True)
class Command:
    """One message to a node.

    Attributes:
        at_s: since the start of the run; None as soon as the node has booted.
        name: of the message in the protocol table.
        values: its fields, raw.
        injected: it makes a fault, which no check may excuse.
    """

    at_s: float | None
    name: str
    values: Mapping[str, float]
    injected: bool = False


def planned(scenario: Scenario, role: str) -> list[Command]:
    """The commands of ``role``, in the order of sending."""
    commands = []
    if (setup := imu_setup(scenario.node(role).imu)) is not None:
        commands.append(Command(None, "imu_setup", setup))
    if role == "leader":
        commands += [
            Command(drop.at_s, "link_drop", {"hold_ms": drop.hold_ms})
            for drop in scenario.link_drops
        ]
        commands += [
            Command(at_s, "link_drop", {"hold_ms": 0}, injected=True)
            for at_s in nodes.drops_s(scenario.inject)
        ]
    return sorted(commands, key=lambda command: command.at_s or 0.0)


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
