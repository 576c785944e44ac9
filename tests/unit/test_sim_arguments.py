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
            },
            "follower": {"drift_ppm": -31.1},
        },
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
        Path("/b/zephyr.exe"), role, plan, sim_id="id", serial="/dev/pts/3", folder=Path("/t")
    )


def test_a_node_with_everything() -> None:
    assert node("leader", FULL) == [
        *("/b/zephyr.exe", "-s=id", "-d=0", "-rs=7", "-no-color"),
        "-xo_drift=1.37e-05",
        "-start_offset=12345",
        "-xo_wander=2e-07:37.0:0.5,-1e-07:5:0.0",
        "-hil_uart=/dev/pts/3",
        "-hil_uart_times=/t/leader.times",
        "-gpio_out_file=/t/leader.pins.csv",
    ]


def test_a_node_with_nothing() -> None:
    assert node("follower", PLAIN) == [
        *("/b/zephyr.exe", "-s=id", "-d=1", "-rs=16", "-no-color"),
        *("-xo_drift=0.0", "-start_offset=0"),
        "-hil_uart=/dev/pts/3",
        "-hil_uart_times=/t/follower.times",
        "-gpio_out_file=/t/follower.pins.csv",
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
    assert plan.duration_s >= 60
    drifts = {role: plan.node(role).drift_ppm for role in arguments.DEVICES}
    assert drifts == {"leader": 13.7, "follower": -31.1}
    offsets = {plan.node(role).start_offset_us for role in arguments.DEVICES}
    assert len(offsets) == 2
    assert arguments.phy(BABBLESIM, "id", plan)
    assert node("leader", plan)
