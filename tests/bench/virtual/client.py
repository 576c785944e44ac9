# SPDX-License-Identifier: Apache-2.0
"""The text of a program that does what the virtual bench tells it to: openocd, sigrok-cli."""

from __future__ import annotations

import sys
from pathlib import Path

TEXT = """#!{python} -IS
import json, os, socket, struct, sys, threading
line = socket.socket(socket.AF_UNIX)
line.connect({path!r})
line.sendall(json.dumps([{name!r}, *sys.argv[1:]]).encode() + b"\\n")
def keys():
    while key := os.read(0, 1):
        line.sendall(key)
threading.Thread(target=keys, daemon=True).start()
stream = line.makefile("rb")
while head := stream.read(5):
    kind, size = struct.unpack("<cI", head)
    data = stream.read(size)
    if kind == b"x":
        os._exit(int(data))
    out = sys.stdout if kind == b"o" else sys.stderr
    out.buffer.write(data)
    out.flush()
os._exit(99)
"""


def install(folder: Path, name: str, socket_path: Path) -> None:
    program = folder / name
    text = TEXT.format(python=sys.executable, path=str(socket_path), name=name)
    program.write_text(text, encoding="utf-8")
    program.chmod(0o755)
