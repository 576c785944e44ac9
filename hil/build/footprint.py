# SPDX-License-Identifier: Apache-2.0
"""How much flash and RAM an image takes, read from its ELF file and its configuration."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from hil.errors import BuildError

RAM_START = 0x2000_0000
"""Data RAM on every nRF52 (nRF52840 PS v1.7, section 4.2.3, memory map)."""
RAM_END = 0x4000_0000


@dataclass(frozen=True)
class Footprint:
    """Bytes used and bytes there are."""

    flash_bytes: int
    flash_total_bytes: int
    ram_bytes: int
    ram_total_bytes: int


def measure(elf: Path, config: Path) -> Footprint:
    """Footprint of the image ``elf`` that was built with the configuration file ``config``.

    Flash holds code, constants and the initial values of data. RAM counts what is placed at
    build time: data, zeroed and uninitialised sections, stacks and kernel heaps.

    Raises:
        BuildError: not an ELF file, or a configuration without the sizes of the memories.
    """
    from elftools.common.exceptions import ELFError  # noqa: PLC0415 (needs the build extra)
    from elftools.elf.elffile import ELFFile  # noqa: PLC0415

    flash_end = flash_start = None
    ram_bytes = 0
    try:
        with elf.open("rb") as file:
            image = ELFFile(file)
            for segment in image.iter_segments("PT_LOAD"):
                if segment["p_filesz"] and segment["p_paddr"] < RAM_START:
                    start, end = segment["p_paddr"], segment["p_paddr"] + segment["p_filesz"]
                    flash_start = start if flash_start is None else min(flash_start, start)
                    flash_end = end if flash_end is None else max(flash_end, end)
            ram_end = RAM_START
            for section in image.iter_sections():
                if section["sh_flags"] & 2 and RAM_START <= section["sh_addr"] < RAM_END:
                    ram_end = max(ram_end, section["sh_addr"] + section["sh_size"])
            ram_bytes = ram_end - RAM_START
    except (OSError, ELFError) as error:
        raise BuildError(f"{elf}: not an ELF file: {error}") from error
    flash_total, ram_total = _config_kib(config, "FLASH_SIZE"), _config_kib(config, "SRAM_SIZE")
    return Footprint((flash_end or 0) - (flash_start or 0), flash_total, ram_bytes, ram_total)


def _config_kib(config: Path, name: str) -> int:
    found = re.search(rf"^CONFIG_{name}=(\d+)$", config.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise BuildError(f"{config} does not set CONFIG_{name}")
    return int(found[1]) * 1024
