# SPDX-License-Identifier: Apache-2.0
"""An upper bound on a step's stack, from the compiler's own call graph.

GCC writes, for each source, who calls whom and how large each frame is (``-fcallgraph-info=su``).
The estimator has no recursion, no calls through pointers and no arrays of variable length, so the
deepest path through the graph is a bound for every input, where a run only shows what it reached.
Frames of interrupts come on top: 104 bytes each when the FPU is in use (ARMv7-M, B1.5.7).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from hil.errors import RigError

STEP_SYMBOL: Final = re.compile(r"_ZN2bv9EstimatorIfE4step")
LIBRARY_FRAME_BYTES: Final = 64
"""Allowance for a function of the C or compiler library, of which the graph knows only the name:
memcpy, memset, sqrtf and conversions of 64-bit integers, which save a few registers."""

_NODE: Final = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE: Final = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_FRAME: Final = re.compile(r"(\d+) bytes \((\w+)")


def step_bound_bytes(folder: Path) -> int:
    """Deepest stack of a step below its caller, bytes.

    Args:
        folder: of a build, :attr:`hil.pil.image.Image.elf`'s.

    Raises:
        RigError: the graph is missing, has a cycle, or a frame of unknown size.
    """
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for path in sorted(folder.glob("*.ci")):
        text = path.read_text(encoding="utf-8")
        for title, label in _NODE.findall(text):
            if found := _FRAME.search(label):
                if found[2] == "dynamic":
                    raise RigError(f"the frame of {title} has no fixed size")
                name = _bare(title)
                frames[name] = max(int(found[1]), frames.get(name, 0))
        for caller, called in _EDGE.findall(text):
            calls.setdefault(_bare(caller), set()).add(_bare(called))
    steps = [name for name in frames if STEP_SYMBOL.match(name)]
    if len(steps) != 1:
        raise RigError(f"{folder} has no call graph of the step", f"rm -r {folder}")
    return _deepest(steps[0], frames, calls, {}, ())


def _bare(title: str) -> str:
    """Without the file, which a template's title has where it is made and not where it is called.

    Functions of one name in several files become one, with the largest frame and all calls.
    """
    return title.rpartition(":")[2]


def _deepest(
    name: str,
    frames: Mapping[str, int],
    calls: Mapping[str, set[str]],
    known: dict[str, int],
    path: tuple[str, ...],
) -> int:
    if name in path:
        raise RigError(f"{name} calls itself: its stack has no bound")
    if name == "__indirect_call":
        raise RigError(f"{path[-1]} calls through a pointer: its stack has no bound")
    if name not in frames and name.startswith("_Z"):
        raise RigError(f"the call graph knows no frame of {name}")
    if name not in known:
        below = [
            _deepest(called, frames, calls, known, (*path, name))
            for called in sorted(calls.get(name, ()))
        ]
        known[name] = frames.get(name, LIBRARY_FRAME_BYTES) + max(below, default=0)
    return known[name]
