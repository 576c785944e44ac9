# SPDX-License-Identifier: Apache-2.0
"""Exact command lines of the simulation's programs, from scenarios."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil import scenario
from hil.build import BabbleSim
from hil.recording import ClockModel
from hil.scenario import Scenario
from hil.simulator import arguments

ROOT = Path(__file__).parents[2]
BABBLESIM = BabbleSim(Path("/ws/tools/bsim"), Path("/ws/tools/bsim/components"))

PLAIN = scenario.from_mapping({"name": "plain", "duration_s": 2.5, "seed": 7}, "test")
FULL = scenario.from_mapping(
    {
        "name": "full",
        "duration_s": 60,
        "seed": 3,
        "nodes": {
            "leader": {
                "drift_ppm": 13.7,
                "start_offset_us": 12345,
                "wander": [
                    {"amplitude_ppm": 0.2, "period_s": 37.0, "phase_rad": 0.5},
                    {"amplitude_ppm": -0.1, "period_s": 5},
                ],
                "imu": {
                    "odr_hz": 1667,
                    "accel_fs_g": 4,
                    "odr_error": -0.068,
                    "odr_drift_per_s": 1e-6,
                    "temperature_degc": 31,
                    "temperature_ramp_degc_per_s": 0.5,
                    "faults": [
                        {"kind": "missing_int", "at_s": 2},
                        {"kind": "stuck_bus", "at_s": 4, "duration_s": 0.5},
                        {"kind": "bit_errors", "at_s": 6.5, "rate": 1e-4},
                    ],
                },
            },
            "follower": {"drift_ppm": -31.1},
        },
        "motion": {"lift": "bench", "seed": 2},
        "channel": {"kind": "multiatt", "attenuation_db": 91.5},
    },
    "test",
)


def test_the_radio_simulator_on_an_ideal_channel() -> None:
    assert arguments.phy(BABBLESIM, "id", PLAIN) == [
        "/ws/tools/bsim/bin/bs_2G4_phy_v1",
        *("-s=id", "-D=2", "-sim_length=2500000", "-rs=7", "-nodump", "-no-color"),
    ]


def test_the_radio_simulator_on_a_lossy_channel() -> None:
    assert arguments.phy(BABBLESIM, "id", FULL) == [
        "/ws/tools/bsim/bin/bs_2G4_phy_v1",
        *("-s=id", "-D=2", "-sim_length=60000000", "-rs=3", "-nodump", "-no-color"),
        *("-defmodem=BLE_simple", "-channel=multiatt", "-argschannel", "-at=91.5"),
    ]


def node(role: str, plan: Scenario) -> list[str]:
    return arguments.node(
        Path("/b/zephyr.exe"),
        role,
        plan,
        sim_id="id",
        serial="/dev/pts/3",
        folder=Path("/t"),
        commands=plan is FULL,
    )


def test_a_node_with_everything() -> None:
    assert node("leader", FULL) == [
        *("/b/zephyr.exe", "-s=id", "-d=0", "-rs=7", "-no-color"),
        "-xo_drift=1.37e-05",
        "-start_offset=12345",
        "-xo_wander=2e-07:37.0:0.5,-1e-07:5:0.0",
        *("-imu_rate_error=-0.068", "-imu_rate_drift=1e-06"),
        *("-imu_temperature=31", "-imu_temperature_ramp=0.5"),
        # 75 ug/rtHz at 4 g and 3.8 mdps/rtHz, over half of 1667 Hz.
        *("-imu_noise=0.0212341:0.00191476", "-imu_seed=7"),
        "-imu_fault=missing_int:2:0.0",
        "-imu_fault=stuck_bus:4:0.5",
        "-imu_fault=bit_errors:6.5:0.0:0.0001",
        "-hil_uart=/dev/pts/3",
        "-hil_uart_times=/t/leader.times",
        "-gpio_out_file=/t/leader.pins.csv",
        *("-imu_truth=/t/leader.truth", "-imu_edges=/t/leader.int1.csv"),
        "-hil_commands=/t/leader.commands",
        "-imu_motion=/t/leader.motion",
    ]


def test_a_node_with_nothing() -> None:
    assert node("follower", PLAIN) == [
        *("/b/zephyr.exe", "-s=id", "-d=1", "-rs=16", "-no-color"),
        *("-xo_drift=0.0", "-start_offset=0"),
        *("-imu_rate_error=0.0", "-imu_rate_drift=0.0"),
        *("-imu_temperature=25.0", "-imu_temperature_ramp=0.0"),
        # 110 ug/rtHz at 16 g, over half of 417 Hz.
        *("-imu_noise=0.0155764:0.000957666", "-imu_seed=16"),
        "-hil_uart=/dev/pts/3",
        "-hil_uart_times=/t/follower.times",
        "-gpio_out_file=/t/follower.pins.csv",
        *("-imu_truth=/t/follower.truth", "-imu_edges=/t/follower.int1.csv"),
    ]


def test_the_simulator_gets_the_very_numbers_of_the_clock_model() -> None:
    """Text on the command line, read back, equals what the checks compute with, to the last bit."""
    mapping = scenario.to_mapping(FULL)["nodes"]["leader"]
    clock = ClockModel.from_mapping(mapping)
    drift, offset, wander = arguments.crystal(FULL.node("leader"))
    assert float(drift.partition("=")[2]) == clock.drift
    assert float(offset.partition("=")[2]) == clock.start_offset_us
    terms = [tuple(map(float, t.split(":"))) for t in wander.partition("=")[2].split(",")]
    assert terms == [(t.amplitude, t.period_s, t.phase_rad) for t in clock.wander]


@pytest.mark.parametrize("path", sorted((ROOT / "fixtures" / "scenarios").glob("*.toml")))
def test_every_scenario_of_this_project_can_be_run(path: Path) -> None:
    plan = scenario.load(path)
    assert plan.name == path.stem
    assert plan.duration_s >= 20, "the clocks settle within 5 s, and the rest is judged"
    drifts = {role: plan.node(role).drift_ppm for role in arguments.DEVICES}
    assert drifts == {"leader": 13.7, "follower": -31.1}
    offsets = {plan.node(role).start_offset_us for role in arguments.DEVICES}
    assert len(offsets) == 2
    assert arguments.phy(BABBLESIM, "id", plan)
    assert node("leader", plan)
