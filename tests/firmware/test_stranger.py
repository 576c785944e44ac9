# SPDX-License-Identifier: Apache-2.0
"""A third device on the air that says what a follower says, but has not got the pair's key.

It is a real follower's image with another key: whatever it could do wrong, it does not. The radio
simulator's AES is the identity unless its component ext_libCryptov1 is built, and then any key fits
any other: without the component nothing is proved here.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from hil import build
from hil.build import Manifest
from hil.process import Child
from hil.simulator.session import pick_core, shared_folder
from hil.wire.codec import Decoded, decode, encode
from hil.wire.messages import FAULT_CODES, LINK_KEY_ORIGINS, ROLES

DURATION_S = 6.0
LIMIT_S = 240.0


def together(
    folder: Path, executables: Sequence[Path], commands: Mapping[int, Sequence[tuple[int, bytes]]]
) -> list[Decoded]:
    """Run the images as devices 0, 1, … of one simulation; what each said on its line.

    Args:
        commands: device -> what its host says, and at which of its microseconds.
    """
    babblesim = build.find_babblesim(build.find_workspace(None))
    if not (babblesim.output / "lib" / "libCryptov1.so").is_file():
        pytest.skip(
            "keys mean nothing to BabbleSim without its component ext_libCryptov1: "
            f"make -C {babblesim.output} ext_libCryptov1"
        )
    # The nodes, as the channel, load their library from ../lib.
    cwd = babblesim.phy.parent
    sim_id = f"hil-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    core = pick_core()
    phy = [str(babblesim.phy), f"-s={sim_id}", f"-D={len(executables)}", "-rs=1"]
    phy += [f"-sim_length={round(DURATION_S * 1e6)}", "-nodump", "-no-color"]
    with ExitStack() as stack:
        children = [stack.enter_context(Child(phy, name="the radio simulator", cwd=cwd, core=core))]
        for device, executable in enumerate(executables):
            (folder / f"{device}.uart").touch()
            argv = [str(executable), f"-s={sim_id}", f"-d={device}", f"-rs={device + 11}"]
            argv += [
                "-no-color",
                "-RealEncryption=1",
                f"-imu_seed={device}",
                f"-hil_uart={folder / f'{device}.uart'}",
            ]
            if device in commands:
                said = folder / f"{device}.commands"
                said.write_text(
                    "".join(f"{t_us},{data.hex()}\n" for t_us, data in commands[device]), "ascii"
                )
                argv.append(f"-hil_commands={said}")
            name = f"device {device}"
            children.append(stack.enter_context(Child(argv, name=name, cwd=cwd, core=core)))
        for child in children:
            child.wait(LIMIT_S)
            assert not [line for line in child.lines if "disabling real encryption" in line]
    for left in shared_folder(sim_id).glob("*"):
        left.unlink()
    return [decode((folder / f"{n}.uart").read_bytes()) for n in range(len(executables))]


def samples_of_follower(leader: Decoded) -> int:
    """Batches that the leader took from its peer: the same that its estimator gets."""
    batches = leader.messages["imu_batch"]
    return int(np.count_nonzero(batches["source"] == ROLES["follower"]))


def last_security(node: Decoded) -> np.void:
    return np.asarray(node.messages["link_security"])[-1]


def test_the_right_one_is_found_among_strangers(
    images: Mapping[str, Manifest], stranger: Path, tmp_path: Path
) -> None:
    own = {role: images[role].file("exe") for role in ROLES}
    devices = [own["leader"], stranger, own["follower"], stranger]
    leader, one, follower, other = together(tmp_path, devices, {})
    assert last_security(leader)["secure"] == 1
    assert last_security(follower)["secure"] == 1
    assert last_security(leader)["key"] == LINK_KEY_ORIGINS["image"]
    assert samples_of_follower(leader) > 100
    for hostile in (one, other):
        assert not last_security(hostile)["secure"]
        assert hostile.messages["link_stats"]["batches_sent"][-1] == 0
    # Every sample that came is one that the right follower took.
    heard = leader.messages["imu_batch"]
    heard = heard[heard["source"] == ROLES["follower"]]
    taken = follower.messages["imu_batch"]
    assert set(heard["sample_index"].tolist()) <= set(taken["sample_index"].tolist())


def test_a_stranger_alone_feeds_nothing(
    images: Mapping[str, Manifest], stranger: Path, tmp_path: Path
) -> None:
    leader, hostile = together(tmp_path, [images["leader"].file("exe"), stranger], {})
    assert samples_of_follower(leader) == 0
    assert leader.messages["sync_pair"].size == 0
    stats = leader.messages["link_stats"][-1]
    assert stats["batches_received"] == 0
    security = last_security(leader)
    assert security["secure"] == 0
    # Tried again, and each time later: with pauses of 1, 2, 4 s no more fit.
    assert 2 <= security["refused"] <= 4
    assert FAULT_CODES["link_stranger"] in leader.messages["fault"]["code"]
    assert not last_security(hostile)["secure"]
    assert leader.messages["ekf_state"].size > 0


def test_the_key_can_be_stored_on_both(
    images: Mapping[str, Manifest], stranger: Path, tmp_path: Path
) -> None:
    """What keeps them apart is the key alone: told the same one, leader and stranger are a pair."""
    key = encode("link_key", {"key": list(range(1, 17))}, 0)
    told = {0: [(500_000, key)], 1: [(500_000, key)]}
    leader, follower = together(tmp_path, [images["leader"].file("exe"), stranger], told)
    for node in (leader, follower):
        assert last_security(node)["key"] == LINK_KEY_ORIGINS["stored"]
        assert last_security(node)["secure"] == 1
    assert samples_of_follower(leader) > 100


def test_the_pair_works_encrypted(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    """With the same key, ciphered by AES: nothing is lost, refused or spoilt on the link."""
    leader, follower = together(tmp_path, [images[role].file("exe") for role in ROLES], {})
    for node in (leader, follower):
        security = node.messages["link_security"]
        assert security["secure"][-1] == 1
        assert security["refused"][-1] == 0
        stats = node.messages["link_stats"][-1]
        assert (stats["disconnects"], stats["bad_payloads"], stats["tx_dropped"]) == (0, 0, 0)
    assert leader.messages["link_stats"]["batches_lost"][-1] == 0
    assert samples_of_follower(leader) > 100
    assert leader.messages["sync_pair"].size > 100
