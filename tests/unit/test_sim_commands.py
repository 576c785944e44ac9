# SPDX-License-Identifier: Apache-2.0
"""What the host says to a simulated node, and what the simulated chip feels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil import scenario
from hil.errors import ScenarioError
from hil.motion import motion_file
from hil.motion.bar import GRAVITY_MPS2
from hil.recording import ClockModel
from hil.simulator import commands, motion
from hil.wire.codec import decode

NODE = {"drift_ppm": 100.0, "start_offset_us": 5000}


def plan(**keys: object) -> scenario.Scenario:
    return scenario.from_mapping({"name": "x", **keys}, "test")


def sent(path: Path) -> list[tuple[int, bytes]]:
    lines = path.read_text().splitlines()
    return [(int(t), bytes.fromhex(data)) for t, data in (line.split(",") for line in lines)]


def test_settings_and_drops_are_sent_at_the_nodes_own_time(tmp_path: Path) -> None:
    imu = {"odr_hz": 1667, "gyro_fs_dps": 500}
    drops = [{"at_s": 30.0, "hold_ms": 400}, {"at_s": 10.0}]
    wanted = plan(nodes={"leader": {**NODE, "imu": imu}}, link_drops=drops)
    path = tmp_path / "leader.commands"
    assert commands.write(path, wanted, "leader", ClockModel.from_mapping(NODE))
    times = [t for t, _ in sent(path)]
    # 100 ppm fast and 5 ms late: 10 s are 10,001,000 us less 5,000.
    assert times == [20_000, 9_996_000, 29_998_000]
    decoded = decode(b"".join(data for _, data in sent(path))).messages
    setup = decoded["imu_setup"][0]
    assert (setup["odr_hz"], setup["accel_fs_g"], setup["gyro_fs_dps"]) == (1667, 0, 500)
    assert decoded["link_drop"]["hold_ms"].tolist() == [0, 400]


def test_a_node_that_needs_no_command_gets_no_file(tmp_path: Path) -> None:
    wanted = plan(link_drops=[{"at_s": 1.0}])
    path = tmp_path / "follower.commands"
    assert not commands.write(path, wanted, "follower", ClockModel())
    assert not path.exists()


def test_both_chips_feel_one_bar_and_have_errors_of_their_own(tmp_path: Path) -> None:
    wanted = plan(motion={"lift": "bench", "start_s": 2.0})
    tables = {}
    for role in ("leader", "follower"):
        motion.write(tmp_path / role, wanted, role)
        tables[role] = motion_file.read(tmp_path / role)
    leader, follower = tables["leader"], tables["follower"]
    assert leader[0, 0] == follower[0, 0] == 2.0
    assert leader.shape == follower.shape
    for table in tables.values():
        assert np.linalg.norm(table[0, 1:4]) == pytest.approx(GRAVITY_MPS2, abs=0.1)
    assert not np.array_equal(leader[0, 1:4], follower[0, 1:4])


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"lift": "cartwheel"}, "no lift 'cartwheel'"),
        ({"lift": "snatch", "rests": True}, "no variant with rests"),
    ],
)
def test_motions_that_do_not_exist(settings: dict[str, object], says: str) -> None:
    wanted = plan(motion=settings).motion
    assert wanted is not None
    with pytest.raises(ScenarioError, match=says):
        motion.lift(wanted)


def test_a_chip_without_noise() -> None:
    quiet = plan(nodes={"leader": {"imu": {"noise": False}}}).node("leader").imu
    assert motion.noise(quiet) == (0.0, 0.0)
