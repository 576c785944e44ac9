# SPDX-License-Identifier: Apache-2.0
"""The golden vectors as C arrays: payload and frame of every message, byte by byte."""

import json
import sys
from pathlib import Path


def c_bytes(data: bytes) -> str:
    return "{" + ", ".join(f"0x{byte:02X}" for byte in data) + "}"


def main(golden: str, output: str) -> None:
    lines = []
    for v in json.loads(Path(golden).read_text(encoding="utf-8"))["messages"]:
        payload = bytes.fromhex("".join(piece for piece, _ in v["payload"]))
        frame = bytes.fromhex(v["frame"])
        lines.append(
            f'{{.name = "{v["name"]}", .type = {v["type"]}, .seq = {v["seq"]}, '
            f".payload_len = {len(payload)}, .frame_len = {len(frame)}, "
            f".payload = {c_bytes(payload)}, .frame = {c_bytes(frame)}}},"
        )
    Path(output).write_text("\n".join(lines) + "\n", encoding="ascii")


if __name__ == "__main__":
    main(*sys.argv[1:])
