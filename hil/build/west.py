# SPDX-License-Identifier: Apache-2.0
"""One west build: its command line, its progress, and what to show when it fails."""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from hil.build.sources import KconfigValue
from hil.errors import BuildError

BOARDS: Mapping[str, str] = {"sim": "nrf52_bsim", "nrf52840dk": "nrf52840dk/nrf52840"}
CONFIGURE_SHARE = 0.15
"""Share of a build's time that CMake takes before the first compilation."""

LAST_WORDS_MAX = 60
LINE_MAX = 200
"""Compilers' command lines run to thousands of characters and hide what matters."""

_STEP = re.compile(r"^\[(\d+)/(\d+)\] (.*)")
_TROUBLE = re.compile(r"^FAILED: |^CMake Error|\berror: |^ERROR: |^FATAL ERROR: |devicetree error")
_COLOUR = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
_WARNING = re.compile(r"^(?P<file>/[^:\n]+):(?P<line>\d+)(?::\d+)?: warning: (?P<text>.*)")


def check_host_tools(path: str | None) -> None:
    """See that what west needs is there; ``path`` is the PATH to look in.

    Raises:
        BuildError: something is missing.
    """
    if importlib.util.find_spec("west") is None:
        raise BuildError(
            "west is not installed in this Python environment",
            f"{sys.executable} -m pip install -e '.[build]'",
        )
    packages = {"cmake": "cmake", "ninja": "ninja-build", "dtc": "device-tree-compiler"}
    missing = [package for tool, package in packages.items() if not shutil.which(tool, path=path)]
    if missing:
        raise BuildError(
            "missing to build firmware: " + ", ".join(missing),
            "apt-get install --no-install-recommends " + " ".join(missing),
        )


RERUN = "Re-running CMake"
"""What ninja says when its own rules are older than what they were made from."""


def arguments(
    source: Path,
    folder: Path,
    target: str,
    build_id: int,
    kconfig: Mapping[str, KconfigValue],
    *,
    fresh: bool = False,
) -> list[str]:
    """Command line that builds the application in ``source`` into ``folder``.

    ``fresh`` throws away what is in the folder.
    """
    return [
        *(sys.executable, "-m", "west", "build"),
        *("--board", BOARDS[target]),
        *("--build-dir", str(folder)),
        *("--pristine", "always" if fresh else "auto"),
        str(source),
        "--",
        f"-DBV_BUILD_ID=0x{build_id:016x}",
        *(f"-DCONFIG_{name}={kconfig_text(value)}" for name, value in sorted(kconfig.items())),
    ]


def kconfig_text(value: KconfigValue) -> str:
    """A Kconfig value as it is written on CMake's command line."""
    if isinstance(value, bool):
        return "y" if value else "n"
    if isinstance(value, int) or value in ("y", "n"):
        return str(value)
    return f'"{value}"'


def progress_of(line: str) -> tuple[float, str] | None:
    """Share done and what is being done, from a line of ninja's output; None for other lines."""
    match = _STEP.match(line)
    if match is None or int(match[2]) == 0:
        return None
    share = int(match[1]) / int(match[2])
    verb, _, rest = match[3].partition(" ")
    # The name of the file says enough; its path would fill the line.
    subject = rest.rsplit("/", 1)[-1].removesuffix(".obj")
    return CONFIGURE_SHARE + (1 - CONFIGURE_SHARE) * share, f"{verb.lower()} {subject}"


def warnings_in(lines: Sequence[str], roots: Sequence[Path], top: Path) -> tuple[str, ...]:
    """Warnings in sources below ``roots``, each once, with paths relative to ``top``."""
    found: dict[str, None] = {}
    for line in lines:
        match = _WARNING.match(line)
        if match and any(Path(match["file"]).is_relative_to(root) for root in roots):
            where = Path(match["file"]).relative_to(top)
            found[f"{where}:{match['line']}: {match['text']}"] = None
    return tuple(found)


def still_valid(warning: str, lines: Sequence[str], top: Path, since_s: float) -> bool:
    """True when a warning of an earlier build still holds: its file was not compiled again.

    A build that compiles only what changed does not repeat the warnings of the rest.

    Args:
        lines: output of the build.
        since_s: when the warning was last seen, seconds since the epoch.
    """
    file = Path(warning.partition(":")[0])
    source = top / file
    compiled = any(f"/{file.name}.obj" in line and _STEP.match(line) for line in lines)
    return not compiled and source.is_file() and source.stat().st_mtime <= since_s


def last_words(lines: Sequence[str]) -> str:
    """The part of a failed build's output that says why, indented for a message."""
    start = next((n for n, line in enumerate(lines) if _TROUBLE.search(line)), None)
    shown = lines[start:] if start is not None else lines[-LAST_WORDS_MAX:]
    chosen = [line for line in shown if line.strip() and not _STEP.match(line)][:LAST_WORDS_MAX]
    return "\n".join(f"    {_clipped(line)}" for line in chosen) or "    (it said nothing)"


def _clipped(line: str) -> str:
    return line if len(line) <= LINE_MAX else f"{line[:LINE_MAX]} ..."


def plain(line: str) -> str:
    """``line`` without the colours that some compilers insist on."""
    return _COLOUR.sub("", line)
