# SPDX-License-Identifier: Apache-2.0
"""Command lines of the radio simulator and of the nodes. Pure: a scenario in, arguments out."""

from __future__ import annotations

from pathlib import Path

from hil.build import BabbleSim
from hil.faults import nodes
from hil.scenario import Channel, ImuScenario, NodeScenario, Scenario
from hil.simulator import motion

DEVICES = ("leader", "follower")
"""Role of each device number."""


def started(scenario: Scenario) -> tuple[str, ...]:
    """The roles that take part; a fault may leave the follower out."""
    return tuple(role for role in DEVICES if not nodes.is_absent(scenario.inject, role))


def phy(babblesim: BabbleSim, sim_id: str, scenario: Scenario) -> list[str]:
    """The radio simulator, which ends the run after the scenario's duration."""
    return [
        str(babblesim.phy),
        f"-s={sim_id}",
        f"-D={len(started(scenario))}",
        f"-sim_length={round(scenario.duration_s * 1e6)}",
        f"-rs={scenario.seed}",
        *("-nodump", "-no-color"),
        *channel(scenario.channel),
    ]


def channel(settings: Channel) -> list[str]:
    """The radio channel and the modem; the ideal channel needs no arguments."""
    if settings.kind == "ideal":
        return []
    # Only this modem makes bit errors from noise; the default one receives everything.
    return [
        "-defmodem=BLE_simple",
        "-channel=multiatt",
        *("-argschannel", f"-at={settings.attenuation_db!r}"),
    ]


def node(
    executable: Path,
    role: str,
    scenario: Scenario,
    *,
    sim_id: str,
    serial: str,
    folder: Path,
    commands: bool = False,
    flash: Path | None = None,
    speed: float = 0.0,
) -> list[str]:
    """One node's image.

    Args:
        serial: path of the pseudoterminal for its UART.
        folder: where its logs go, and its motion and commands come from.
        commands: there is a file of commands.
        flash: what its flash holds; empty without.
        speed: at most so many times as fast as real time; 0 for as fast as it goes.
    """
    device = DEVICES.index(role)
    seed = node_seed(scenario, role)
    return [
        str(executable),
        f"-s={sim_id}",
        f"-d={device}",
        f"-rs={seed}",
        "-no-color",
        *crystal(scenario.node(role)),
        *chip(scenario.node(role).imu, seed),
        f"-hil_uart={serial}",
        f"-hil_uart_times={times_file(folder, role)}",
        f"-gpio_out_file={pins_file(folder, role)}",
        f"-imu_truth={truth_file(folder, role)}",
        f"-imu_edges={int1_file(folder, role)}",
        *([f"-hil_commands={commands_file(folder, role)}"] if commands else []),
        *([f"-imu_motion={motion_file(folder, role)}"] if scenario.motion else []),
        *([f"-flash={flash}"] if flash else []),
        *([f"-hil_speed={speed!r}"] if speed else []),
    ]


def node_seed(scenario: Scenario, role: str) -> int:
    """Nodes with equal seeds would draw equal addresses and equal back-off delays."""
    return scenario.seed * len(DEVICES) + DEVICES.index(role) + 1


def crystal(settings: NodeScenario) -> list[str]:
    """Drift, start offset and wander, as :class:`hil.recording.ClockModel` reads them."""
    options = [
        f"-xo_drift={settings.drift_ppm * 1e-6!r}",
        f"-start_offset={settings.start_offset_us}",
    ]
    if settings.wander:
        terms = (
            f"{term.amplitude_ppm * 1e-6!r}:{term.period_s!r}:{term.phase_rad!r}"
            for term in settings.wander
        )
        options.append("-xo_wander=" + ",".join(terms))
    return options


def chip(settings: ImuScenario, seed: int) -> list[str]:
    """The simulated LSM6DSOX: clock, temperature, noise and faults (docs/lsm6dsox.md)."""
    accel_mps2, gyro_radps = motion.noise(settings)
    options = [
        f"-imu_rate_error={settings.odr_error!r}",
        f"-imu_rate_drift={settings.odr_drift_per_s!r}",
        f"-imu_temperature={settings.temperature_degc!r}",
        f"-imu_temperature_ramp={settings.temperature_ramp_degc_per_s!r}",
        f"-imu_noise={accel_mps2:.6g}:{gyro_radps:.6g}",
        f"-imu_seed={seed}",
    ]
    for fault in settings.faults:
        # A duration of 0 is one without end.
        parts = [fault.kind, repr(fault.at_s), repr(fault.duration_s or 0.0)]
        if fault.rate is not None:
            parts.append(repr(fault.rate))
        options.append("-imu_fault=" + ":".join(parts))
    return options


def times_file(folder: Path, role: str) -> Path:
    """Log of when the bytes left the UART."""
    return folder / f"{role}.times"


def pins_file(folder: Path, role: str) -> Path:
    """Log of the changes of the output pins."""
    return folder / f"{role}.pins.csv"


def int1_file(folder: Path, role: str) -> Path:
    """Log of the changes of the sensor's interrupt pin, in the same format."""
    return folder / f"{role}.int1.csv"


def truth_file(folder: Path, role: str) -> Path:
    """What the sensor sampled, and when (docs/lsm6dsox.md, section 6)."""
    return folder / f"{role}.truth"


def motion_file(folder: Path, role: str) -> Path:
    """What the sensor feels."""
    return folder / f"{role}.motion"


def commands_file(folder: Path, role: str) -> Path:
    """What the host sends, and when."""
    return folder / f"{role}.commands"
