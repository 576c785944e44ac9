# SPDX-License-Identifier: Apache-2.0
"""A hex file: what it would write where, and whether that can be firmware for an nRF52840.

Memory map: nRF52840 PS v1.7, section 4.2; vector table: ARMv7-M ARM, section B1.5.3.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hil.bench.errors import BadImageError, HexChangedError, WrongRoleError, WrongTargetError

if TYPE_CHECKING:
    from hil.build import Manifest

FLASH: Final = range(0x0000_0000, 0x0010_0000)
RAM: Final = range(0x2000_0000, 0x2004_0000)
UICR: Final = range(0x1000_1000, 0x1000_2000)
TARGET: Final = "nrf52840dk"
SIZE_LIMIT_B: Final = 4 * 1024 * 1024
"""A megabyte of flash is 2.9 MB of hex."""


@dataclass(frozen=True)
class Segment:
    """Consecutive bytes at an address."""

    address: int
    data: bytes

    @property
    def end(self) -> int:
        return self.address + len(self.data)


@dataclass(frozen=True)
class Image:
    """What a hex file holds.

    Attributes:
        path: the file.
        sha256: of the file, as its manifest has it.
        segments: in the order of their addresses, none touching the next.
        initial_sp: first word of the vector table, or None when nothing is at its place.
        reset_vector: second word.
    """

    path: Path
    sha256: str
    segments: tuple[Segment, ...]
    initial_sp: int | None
    reset_vector: int | None

    @property
    def size(self) -> int:
        """Bytes that it writes."""
        return sum(len(segment.data) for segment in self.segments)


def load(path: Path) -> Image:
    """Read a hex file.

    Raises:
        BadImageError: it is missing, too large or no Intel HEX; the message names the line.
    """
    from intelhex import IntelHex, IntelHexError  # noqa: PLC0415 (only with hardware)

    mend = "build it again: hil build --target nrf52840dk"
    try:
        with path.open("rb") as file:
            content = file.read(SIZE_LIMIT_B + 1)
        if len(content) > SIZE_LIMIT_B:
            raise BadImageError(f"{path}: larger than {SIZE_LIMIT_B >> 20} MiB of hex", mend)
        memory = IntelHex(str(path))
    except (OSError, IntelHexError, UnicodeDecodeError, ValueError) as error:
        raise BadImageError(f"{path} cannot be read as Intel HEX: {error}", mend) from error
    segments = tuple(
        Segment(start, memory.tobinstr(start=start, end=end - 1))
        for start, end in memory.segments()
    )
    first = next((s for s in segments if s.address == FLASH.start and len(s.data) >= 8), None)
    initial_sp, reset_vector = struct.unpack("<II", first.data[:8]) if first else (None, None)
    digest = hashlib.sha256(content).hexdigest()
    return Image(path, digest, segments, initial_sp, reset_vector)


def problems(image: Image) -> list[str]:
    """Why this cannot be firmware for an nRF52840; empty when it can."""
    found = []
    if not image.segments:
        return ["it holds no data"]
    for segment in image.segments:
        span = f"0x{segment.address:08x} to 0x{segment.end - 1:08x}"
        if segment.address < UICR.stop and segment.end > UICR.start:
            found.append(f"it writes UICR ({span}), which can lock the debugger out")
        elif not (FLASH.start <= segment.address and segment.end <= FLASH.stop):
            found.append(f"it writes {span}, where an nRF52840 has no flash")
    if image.initial_sp is None or image.reset_vector is None:
        found.append("it has no vector table at address 0")
        return found
    if not (RAM.start < image.initial_sp <= RAM.stop and image.initial_sp % 4 == 0):
        found.append(f"its initial stack pointer 0x{image.initial_sp:08x} is not in RAM")
    target = image.reset_vector & ~1
    inside = any(s.address <= target < s.end for s in image.segments)
    if target not in FLASH or not inside or not image.reset_vector & 1:
        found.append(f"its reset vector 0x{image.reset_vector:08x} is no code of this image")
    return found


def check(manifest: Manifest, role: str) -> Image:
    """The image of a manifest, proven to be the one that was built, and for this role and chip.

    Raises:
        WrongRoleError, WrongTargetError, HexChangedError, BadImageError: each when it says so.
    """
    build = f"hil build --role {role} --target {TARGET}"
    if manifest.target != TARGET:
        raise WrongTargetError(
            f"the image is built for '{manifest.target}', not for the {TARGET}", build
        )
    if manifest.role != role:
        raise WrongRoleError(
            f"the image is the {manifest.role}'s, and this board is the {role}",
            f"{build}\nor exchange the two probes in the bench file",
        )
    if "hex" not in manifest.files:
        raise BadImageError(f"the manifest in {manifest.folder} names no hex file", build)
    image = load(manifest.file("hex"))
    expected = manifest.files["hex"].sha256
    if image.sha256 != expected:
        raise HexChangedError(
            f"{image.path} has changed since it was built: "
            f"sha256 {image.sha256[:16]}..., built {expected[:16]}...",
            build,
        )
    if found := problems(image):
        raise BadImageError(
            f"{image.path} is no firmware for this chip: " + "; ".join(found), build
        )
    return image
