# SPDX-License-Identifier: Apache-2.0
"""Hex files: images not built here, and files that must not reach a board."""

from __future__ import annotations

import hashlib
import struct
from importlib.resources import files
from pathlib import Path

import pytest

from hil.bench import image
from hil.bench.errors import BadImageError
from tests.bench.fakes import images


def foreign(package: str, name: str) -> Path:
    pytest.importorskip(package)
    return Path(str(files(package) / name))


def parsed_by_hand(path: Path) -> dict[int, int]:
    """Address -> byte, straight from the format's definition."""
    memory, base = {}, 0
    for line in path.read_text(encoding="ascii").split():
        record = bytes.fromhex(line[1:])
        assert sum(record) & 0xFF == 0
        offset, kind, data = int.from_bytes(record[1:3], "big"), record[3], record[4:-1]
        if kind == 4:
            base = int.from_bytes(data, "big") << 16
        elif kind == 2:
            base = int.from_bytes(data, "big") << 4
        elif kind == 0:
            memory.update({base + offset + n: byte for n, byte in enumerate(data)})
    return memory


FOREIGN = [
    ("zephyr_4_4_0_hci_usb_nrf52840dk_default", "firmware.hex"),
    ("pynrfjprog", "examples/hex_files/nrf52840_dk_blinky.hex"),
]


@pytest.mark.parametrize(("package", "name"), FOREIGN)
def test_firmware_that_others_built_for_this_chip_is_sound(package: str, name: str) -> None:
    path = foreign(package, name)
    found = image.load(path)
    assert image.problems(found) == []
    memory = parsed_by_hand(path)
    assert found.size == len(memory)
    for segment in found.segments:
        assert segment.data == bytes(memory[segment.address + n] for n in range(len(segment.data)))
    vectors = struct.unpack("<II", bytes(memory[n] for n in range(8)))
    assert (found.initial_sp, found.reset_vector) == vectors
    assert found.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_an_application_that_needs_a_bootloader_is_told() -> None:
    """The hex of Nordic's Thingy:91 firmware update begins at 0xC000, behind a bootloader."""
    name = "examples/hex_files/nrf9160_pca20035_firmware_upgrade_app_0.1.0.hex"
    found = image.load(foreign("pynrfjprog", name))
    assert image.problems(found) == ["it has no vector table at address 0"]


def problems_of(tmp_path: Path, data: bytes, address: int = 0) -> list[str]:
    images.write_hex(tmp_path / "x.hex", data, address)
    return image.problems(image.load(tmp_path / "x.hex"))


def test_a_sound_image_has_no_problems(tmp_path: Path) -> None:
    assert problems_of(tmp_path, images.content()) == []
    # The stack may begin at the very end of RAM: it grows down.
    assert problems_of(tmp_path, images.content(initial_sp=0x2004_0000)) == []


@pytest.mark.parametrize(
    ("initial_sp", "reset", "said"),
    [
        (0x2004_0004, 0x101, "stack pointer 0x20040004 is not in RAM"),
        (0x2000_0000, 0x101, "stack pointer 0x20000000 is not in RAM"),
        (0x2000_4002, 0x101, "stack pointer 0x20004002 is not in RAM"),
        (0xFFFF_FFFF, 0x101, "stack pointer 0xffffffff is not in RAM"),
        (0x2000_4000, 0x100, "reset vector 0x00000100 is no code"),
        (0x2000_4000, 0x8000_0001, "reset vector 0x80000001 is no code"),
        (0x2000_4000, images.SIZE | 1, "is no code of this image"),
    ],
)
def test_a_wrong_vector_table_is_told(
    tmp_path: Path, initial_sp: int, reset: int, said: str
) -> None:
    assert any(said in p for p in problems_of(tmp_path, images.content(1, initial_sp, reset)))


@pytest.mark.parametrize(
    ("address", "said"),
    [
        (0x1000_1208, "writes UICR (0x10001208 to"),
        (0x000F_FFFC, "where an nRF52840 has no flash"),
        (0x2000_0000, "where an nRF52840 has no flash"),
        (0x1200_0000, "where an nRF52840 has no flash"),
    ],
)
def test_writing_outside_flash_is_told(tmp_path: Path, address: int, said: str) -> None:
    assert any(said in problem for problem in problems_of(tmp_path, bytes(64), address))


def test_an_application_without_its_bootloader_is_told(tmp_path: Path) -> None:
    assert "it has no vector table at address 0" in problems_of(tmp_path, images.content(), 0xC000)


@pytest.mark.parametrize(
    "content",
    [
        b":10000000FFFF\n",
        b":020000040000FB\n:00000001FE\n",
        b"\x7fELF\x01\x01\x01",
        b":04000000000000\xff\xff00FC\n",
        b"hello\n",
    ],
)
def test_files_that_are_no_hex_are_one_clear_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.hex").write_bytes(content)
    with pytest.raises(BadImageError, match=r"x\.hex cannot be read as Intel HEX"):
        image.load(tmp_path / "x.hex")


def test_the_wrong_line_is_named(tmp_path: Path) -> None:
    images.write_hex(tmp_path / "x.hex", bytes(64))
    lines = (tmp_path / "x.hex").read_text().splitlines()
    lines[2] = lines[2][:-1] + ("0" if lines[2][-1] != "0" else "1")
    (tmp_path / "x.hex").write_text("\n".join(lines))
    with pytest.raises(BadImageError, match="line 3"):
        image.load(tmp_path / "x.hex")


def test_an_empty_and_a_missing_and_a_huge_file(tmp_path: Path) -> None:
    (tmp_path / "empty.hex").write_bytes(b":00000001FF\n")
    assert image.problems(image.load(tmp_path / "empty.hex")) == ["it holds no data"]
    with pytest.raises(BadImageError, match="No such file"):
        image.load(tmp_path / "none.hex")
    with (tmp_path / "huge.hex").open("wb") as file:
        file.truncate(image.SIZE_LIMIT_B + 1)
    with pytest.raises(BadImageError, match="larger than 4 MiB"):
        image.load(tmp_path / "huge.hex")
