# SPDX-License-Identifier: Apache-2.0
"""What of a scenario two real boards can do; the rest only a simulation can."""

from __future__ import annotations

from dataclasses import replace

from hil.scenario import Channel, ImuScenario, NodeScenario, Scenario

SETTINGS = ("odr_hz", "accel_fs_g", "gyro_fs_dps", "rest_s")
"""Keys of a scenario's IMU that are commands to the node; the others describe a simulated chip."""


def applied(scenario: Scenario) -> tuple[Scenario, list[str]]:
    """The scenario as it runs on a bench, and what was left out, in words.

    A recording keeps the first: a channel that was never lossy must not relax a limit.
    """
    left_out = []
    if any(node.drift_ppm or node.start_offset_us or node.wander for node in _nodes(scenario)):
        left_out.append("the crystals")
    if scenario.motion is not None:
        left_out.append(f"the motion '{scenario.motion.lift}'")
    if scenario.channel != Channel():
        left_out.append(f"the channel '{scenario.channel.kind}'")
    if any(node.imu.faults for node in _nodes(scenario)):
        left_out.append("the sensor's faults")
    if any(
        replace(_settings(node.imu), faults=node.imu.faults) != node.imu
        for node in _nodes(scenario)
    ):
        left_out.append("the sensor's clock, noise and temperature")
    if any(node.calibration for node in _nodes(scenario)):
        left_out.append("the calibration in flash")
    nodes = {role: NodeScenario(imu=_settings(node.imu)) for role, node in scenario.nodes.items()}
    return replace(scenario, nodes=nodes, motion=None, channel=Channel()), left_out


def sentence(left_out: list[str]) -> str:
    """What a reader of the recording should know; empty when all was applied."""
    if not left_out:
        return ""
    return "Only a simulation can do these parts of the scenario: " + ", ".join(left_out) + "."


def _nodes(scenario: Scenario) -> list[NodeScenario]:
    return list(scenario.nodes.values())


def _settings(imu: ImuScenario) -> ImuScenario:
    return ImuScenario(**{name: getattr(imu, name) for name in SETTINGS})
