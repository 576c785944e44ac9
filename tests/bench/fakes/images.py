# SPDX-License-Identifier: Apache-2.0
"""Small images with a manifest, as a build leaves them."""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path

from hil.build import GitState, Manifest, OutputFile

SIZE = 3 * 4096 + 100


def content(seed: int = 1, initial_sp: int = 0x2000_4000, reset: int = 0x101) -> bytes:
    """Flash content from address 0: vector table, then bytes that differ from place to place."""
    body = bytes((n * 7 + (n >> 8) + seed) & 0xFF for n in range(SIZE - 8))
    return struct.pack("<II", initial_sp, reset) + body


def write_hex(path: Path, data: bytes, address: int = 0) -> None:
    """Intel HEX, 16 bytes to a line, written from the format's definition (Intel, 1988)."""

    def record(kind: int, offset: int, payload: bytes) -> str:
        line = bytes((len(payload), offset >> 8, offset & 0xFF, kind)) + payload
        return f":{line.hex().upper()}{-sum(line) & 0xFF:02X}"

    lines, upper = [], None
    for start in range(0, len(data), 16):
        at = address + start
        if at >> 16 != upper:
            upper = at >> 16
            lines.append(record(4, 0, struct.pack(">H", upper)))
        lines.append(record(0, at & 0xFFFF, data[start : start + 16]))
    path.write_text("\n".join([*lines, ":00000001FF", ""]), encoding="ascii")


def built(
    folder: Path, role: str = "leader", target: str = "nrf52840dk", seed: int = 1
) -> Manifest:
    """A build folder with an image of ``role``, and its manifest."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "zephyr.hex"
    write_hex(path, content(seed))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Manifest(
        role=role,
        target=target,
        board="nrf52840dk/nrf52840",
        build_id="00112233445566aa",
        inputs_sha256="",
        created_utc="2026-01-01T00:00:00+00:00",
        files={"hex": OutputFile("zephyr.hex", digest, path.stat().st_size)},
        zephyr_version="4.1.0",
        toolchain="gcc",
        git=GitState("", "unknown"),
        folder=folder,
    )
