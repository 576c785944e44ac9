# SPDX-License-Identifier: Apache-2.0
"""Flash and verify on fake chips: each refusal on its fault, nothing written when refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from hil.bench import flash
from hil.bench.errors import (
    BadImageError,
    ChipProtectedError,
    HexChangedError,
    PairError,
    ProbeLostError,
    ProbeMissingError,
    ReadbackError,
    WrongBoardError,
    WrongChipError,
    WrongRoleError,
    WrongTargetError,
)
from hil.bench.inventory import Board, Inventory
from hil.build import Manifest
from hil.errors import RigError
from tests.bench.fakes import images
from tests.bench.fakes.chip import FakeChip, FakeProbe, FakeRunner

LEADER = Board("leader", "683000001")
ERASED = b"\xff" * images.SIZE


@pytest.fixture
def leader(tmp_path: Path) -> Manifest:
    return images.built(tmp_path / "leader")


def pair(
    leader: FakeProbe, follower: FakeProbe, path: Path = Path("bench.toml")
) -> flash.BoardPair:
    boards = {
        "leader": Board("leader", leader.serial),
        "follower": Board("follower", follower.serial),
    }
    return flash.BoardPair(Inventory(path, boards), FakeRunner(leader, follower))


@pytest.fixture
def both(tmp_path: Path) -> dict[str, Manifest]:
    return {
        "leader": images.built(tmp_path / "leader"),
        "follower": images.built(tmp_path / "follower", "follower", seed=2),
    }


def test_an_empty_chip_is_written_verified_and_left_halted(leader: Manifest) -> None:
    chip = FakeChip()
    probe = FakeProbe("683000001", chip)
    done = flash.ensure(probe, LEADER, leader)
    assert bytes(chip.flash[: images.SIZE]) == images.content()
    assert done.programmed
    assert not chip.running
    assert "reset system" not in probe.log
    assert done.bytes_verified == images.SIZE
    # DEVICEID[1] above DEVICEID[0], as the firmware says it in HELLO.
    assert done.device_id == "0123456789abcdef"
    assert done.chip == "nRF52840 AAD0"
    assert json.loads(json.dumps(done.to_mapping()))["hex_sha256"] == leader.files["hex"].sha256


def test_what_is_there_already_is_proven_by_readback_and_not_written(leader: Manifest) -> None:
    chip = FakeChip()
    flash.ensure(FakeProbe("683000001", chip), LEADER, leader)
    again = FakeProbe("683000001", chip)
    assert not flash.ensure(again, LEADER, leader).programmed
    assert "program" not in again.log
    assert sum(line.startswith("read 0x0000") for line in again.log) == 1


def test_one_wrong_bit_anywhere_is_written_anew(leader: Manifest) -> None:
    chip = FakeChip()
    flash.ensure(FakeProbe("683000001", chip), LEADER, leader)
    chip.flash[images.SIZE - 1] ^= 0x10
    assert flash.ensure(FakeProbe("683000001", chip), LEADER, leader).programmed
    assert bytes(chip.flash[: images.SIZE]) == images.content()


def test_always_writes_what_is_there_already(leader: Manifest) -> None:
    chip = FakeChip()
    flash.ensure(FakeProbe("683000001", chip), LEADER, leader)
    assert flash.ensure(FakeProbe("683000001", chip), LEADER, leader, always=True).programmed


def test_what_lies_outside_the_image_survives(leader: Manifest) -> None:
    """The calibration store has pages of its own."""
    chip = FakeChip()
    chip.flash[0xF8000:0xF8010] = b"calibration data"
    flash.ensure(FakeProbe("683000001", chip), LEADER, leader)
    assert chip.flash[0xF8000:0xF8010] == b"calibration data"


def refused(
    error: type[RigError], chip: FakeChip, manifest: Manifest, board: Board = LEADER
) -> RigError:
    probe = FakeProbe("683000001", chip)
    with pytest.raises(error) as caught:
        flash.ensure(probe, board, manifest)
    assert "program" not in probe.log
    assert bytes(chip.flash[: images.SIZE]) == ERASED
    assert caught.value.mend
    return caught.value


def test_a_protected_chip_is_refused_and_nothing_else_touches_it(leader: Manifest) -> None:
    chip = FakeChip(protected=True)
    error = refused(ChipProtectedError, chip, leader)
    assert "APPROTECT" in error.message
    assert "hil bench recover leader" in error.mend
    assert "erases" in error.mend


def test_another_chip_is_refused_by_name(leader: Manifest) -> None:
    error = refused(WrongChipError, FakeChip(part=0x52832), leader)
    assert "nRF52832 AAD0" in error.message


def test_another_board_than_the_bench_files_is_refused(leader: Manifest) -> None:
    board = Board("leader", "683000001", device_id=0x1111)
    error = refused(WrongBoardError, FakeChip(), leader, board)
    assert "0x0000000000001111" in error.message
    assert "0x0123456789abcdef" in error.message


def test_the_right_board_of_the_bench_file_is_taken(leader: Manifest) -> None:
    board = Board("leader", "683000001", device_id=0x0123456789ABCDEF)
    assert flash.ensure(FakeProbe("683000001", FakeChip()), board, leader).programmed


def test_the_other_roles_image_is_refused(tmp_path: Path) -> None:
    error = refused(WrongRoleError, FakeChip(), images.built(tmp_path, "follower"))
    assert "follower's" in error.message


def test_an_image_for_the_simulation_is_refused(tmp_path: Path) -> None:
    error = refused(WrongTargetError, FakeChip(), images.built(tmp_path, target="sim"))
    assert "'sim'" in error.message
    assert "hil build --role leader --target nrf52840dk" in error.mend


def test_a_hex_file_that_changed_since_it_was_built_is_refused(leader: Manifest) -> None:
    images.write_hex(leader.file("hex"), images.content(seed=9))
    refused(HexChangedError, FakeChip(), leader)


def test_a_file_that_is_no_firmware_is_refused(tmp_path: Path) -> None:
    manifest = images.built(tmp_path)
    path = manifest.file("hex")
    images.write_hex(path, images.content(initial_sp=0x1234))
    import hashlib  # noqa: PLC0415

    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    files = {"hex": dataclasses.replace(manifest.files["hex"], sha256=digest)}
    error = refused(BadImageError, FakeChip(), dataclasses.replace(manifest, files=files))
    assert "stack pointer 0x00001234" in error.message


@pytest.mark.parametrize("address", [0, 4097, images.SIZE - 1])
def test_a_cell_that_does_not_program_is_found_at_its_address(
    leader: Manifest, address: int
) -> None:
    wanted = images.content()[address]
    chip = FakeChip(stuck={address: ~wanted & 0xFF})
    with pytest.raises(ReadbackError, match=f"from 0x{address:08x} on"):
        flash.ensure(FakeProbe("683000001", chip), LEADER, leader)


def test_a_readback_that_is_cut_short_is_a_difference(leader: Manifest) -> None:
    class Short(FakeProbe):
        def read_memory(self, address: int, size: int) -> bytes:
            data = super().read_memory(address, size)
            return data[:100] if address < 0x1000_0000 else data

    with pytest.raises(ReadbackError, match="from 0x00000064 on"):
        flash.ensure(Short("683000001", FakeChip()), LEADER, leader)


@pytest.mark.parametrize("where", [0, 4096, 8192])
def test_a_probe_lost_while_writing_says_that_the_board_is_half_written(
    leader: Manifest, where: int
) -> None:
    probe = FakeProbe("683000001", FakeChip(), {"program": where})
    with pytest.raises(ProbeLostError, match="lost while writing") as caught:
        flash.ensure(probe, LEADER, leader)
    assert "no whole image" in caught.value.message
    assert "the USB device is gone" in caught.value.message


def test_after_a_loss_the_next_run_writes_everything_anew(leader: Manifest) -> None:
    chip = FakeChip()
    with pytest.raises(ProbeLostError):
        flash.ensure(FakeProbe("683000001", chip, {"program": 8192}), LEADER, leader)
    assert flash.ensure(FakeProbe("683000001", chip), LEADER, leader).programmed
    assert bytes(chip.flash[: images.SIZE]) == images.content()


def test_both_boards_get_their_own_image(both: dict[str, Manifest]) -> None:
    first, second = FakeChip(), FakeChip((1, 2))
    boards = pair(FakeProbe("1", first), FakeProbe("2", second))
    done = boards.prepare(both)
    assert bytes(first.flash[: images.SIZE]) == images.content(1)
    assert bytes(second.flash[: images.SIZE]) == images.content(2)
    assert (done["leader"].probe, done["follower"].probe) == ("1", "2")
    assert not first.running
    assert not second.running
    boards.reset()
    assert first.running
    assert second.running


def test_one_boards_error_does_not_leave_the_other_half_written(both: dict[str, Manifest]) -> None:
    bad, good = FakeChip(protected=True), FakeChip()
    with pytest.raises(PairError) as caught:
        pair(FakeProbe("1", bad), FakeProbe("2", good)).prepare(both)
    assert list(caught.value.errors) == ["leader"]
    assert bytes(good.flash[: images.SIZE]) == images.content(2)


def test_both_errors_are_told(both: dict[str, Manifest]) -> None:
    probes = (FakeProbe("1", FakeChip(protected=True)), FakeProbe("2", FakeChip(part=0x52833)))
    with pytest.raises(PairError) as caught:
        pair(*probes).prepare(both)
    assert isinstance(caught.value.errors["leader"], ChipProtectedError)
    assert isinstance(caught.value.errors["follower"], WrongChipError)
    assert "leader: the chip at probe 1" in str(caught.value)
    assert "follower: the chip at probe 2" in str(caught.value)


def test_both_boards_are_worked_on_at_the_same_time(both: dict[str, Manifest]) -> None:
    """Each program waits for the other's: one after the other they would wait for ever."""
    import threading  # noqa: PLC0415

    meeting = threading.Barrier(2, timeout=10)

    class Meeting(FakeProbe):
        def program(self, image: Path) -> None:
            meeting.wait()
            super().program(image)

    pair(Meeting("1", FakeChip()), Meeting("2", FakeChip())).prepare(both)


def test_after_a_failure_both_boards_are_reset_through_the_pin_first(
    both: dict[str, Manifest],
) -> None:
    probes = FakeProbe("1", FakeChip()), FakeProbe("2", FakeChip())
    boards = pair(*probes)
    boards.prepare(both, after_failure=True)
    assert all(probe.log[0] == "reset pin" for probe in probes)
    for probe in probes:
        probe.log.clear()
    boards.prepare(both)
    assert all("reset pin" not in probe.log for probe in probes)


def test_a_probe_that_is_not_connected_is_named_with_those_that_are() -> None:
    boards = {"leader": Board("leader", "1"), "follower": Board("follower", "3")}
    runner = FakeRunner(FakeProbe("1", FakeChip()), FakeProbe("2", FakeChip()))
    with pytest.raises(ProbeMissingError, match=r"follower's probe 3 is not .*connected: 1, 2"):
        flash.BoardPair(Inventory(Path("bench.toml"), boards), runner)


def test_recover_ends_the_protection(both: dict[str, Manifest]) -> None:
    chip = FakeChip(protected=True)
    boards = pair(FakeProbe("1", chip), FakeProbe("2", FakeChip()))
    boards.recover("leader")
    assert boards.prepare(both)["leader"].programmed
