# SPDX-License-Identifier: Apache-2.0
"""Finding the Zephyr workspace and checking that it is the release the firmware is written for."""

from __future__ import annotations

import configparser
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from hil.errors import BuildError
from hil.process import capture

REQUIRED_VERSION = (4, 1)
"""Release line of Zephyr: the firmware reads link-layer functions that are not public API."""

MEND_NONE = (
    "make one inside this checkout: west init -l firmware && west update && "
    "make -C tools/bsim everything\n"
    "name one that exists: --workspace DIR, or ZEPHYR_BASE=DIR/zephyr in the environment"
)


@dataclass(frozen=True)
class Workspace:
    """A west workspace.

    Attributes:
        path: its top folder.
        zephyr_base: Zephyr's own folder.
        version: of Zephyr, e.g. ``4.1.0``.
        found_by: which of the places it was found in, for messages.
    """

    path: Path
    zephyr_base: Path
    version: str
    found_by: str

    def zephyr_commit(self) -> str:
        """Commit of Zephyr's checkout; empty when it is not a git checkout."""
        return capture(["git", "-C", self.zephyr_base, "rev-parse", "HEAD"])


def find_workspace(
    explicit: Path | None = None,
    *,
    env: Mapping[str, str] | None = None,
    start: Path | None = None,
) -> Workspace:
    """The workspace to build in: the first of ``explicit``, ``ZEPHYR_BASE``, the west workspace
    around ``start``, and ``~/zephyrproject``.

    A place that was named (the first two) must be right; it is never passed over in silence.

    Args:
        explicit: the workspace's top folder, or Zephyr's folder inside it.
        env: environment; the process's own by default.
        start: where to look for an enclosing workspace; the current folder by default.

    Raises:
        BuildError: there is none, or it holds another release of Zephyr.
    """
    env = os.environ if env is None else env
    for path, found_by, named in _candidates(explicit, env, start or Path.cwd()):
        zephyr_base = _zephyr_base(path)
        if zephyr_base is not None:
            return _checked(path, zephyr_base, found_by)
        if named:
            raise BuildError(f"{path} ({found_by}) holds no Zephyr", MEND_NONE)
    raise BuildError("no Zephyr workspace was found", MEND_NONE)


def _candidates(
    explicit: Path | None, env: Mapping[str, str], start: Path
) -> Iterator[tuple[Path, str, bool]]:
    if explicit is not None:
        yield explicit.expanduser().absolute(), "--workspace", True
        return
    if env.get("ZEPHYR_BASE"):
        yield Path(env["ZEPHYR_BASE"]).expanduser().absolute(), "ZEPHYR_BASE", True
        return
    for folder in (start, *start.parents):
        if (folder / ".west" / "config").is_file():
            yield folder, "the enclosing west workspace", False
            break
    home = Path(env["HOME"]) if env.get("HOME") else Path.home()
    yield home / "zephyrproject", "~/zephyrproject", False


def _zephyr_base(path: Path) -> Path | None:
    """Zephyr's folder in the workspace at ``path``, or ``path`` itself when it is that folder."""
    places = [path, path / "zephyr"]
    config = path / ".west" / "config"
    if config.is_file():
        parser = configparser.ConfigParser(allow_no_value=True, interpolation=None)
        try:
            parser.read(config, encoding="utf-8")
        except (configparser.Error, UnicodeDecodeError) as error:
            raise BuildError(
                f"{config} cannot be read: {str(error).splitlines()[0]}", MEND_NONE
            ) from error
        places.insert(0, path / (parser.get("zephyr", "base", fallback="") or "zephyr"))
    for place in places:
        if (place / "VERSION").is_file() and (place / "cmake").is_dir():
            return place.resolve()
    return None


def _checked(path: Path, zephyr_base: Path, found_by: str) -> Workspace:
    top = zephyr_base.parent if path.resolve() == zephyr_base else path.resolve()
    version = _version(zephyr_base / "VERSION")
    if version[:2] != REQUIRED_VERSION:
        wanted = ".".join(map(str, REQUIRED_VERSION))
        has = ".".join(map(str, version))
        raise BuildError(
            f"the workspace at {top} ({found_by}) holds Zephyr {has}; "
            f"the firmware is written for Zephyr {wanted}",
            f"git -C {zephyr_base} fetch --tags && git -C {zephyr_base} checkout v{wanted}.0 && "
            "west update\n"
            "or leave that workspace alone and make one inside this checkout: "
            "west init -l firmware && west update && make -C tools/bsim everything",
        )
    return Workspace(top, zephyr_base, ".".join(map(str, version)), found_by)


def _version(path: Path) -> tuple[int, int, int]:
    values = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, separator, value = line.partition("=")
        if separator:
            values[name.strip()] = value.strip()
    try:
        major, minor, patch = (
            int(values[name]) for name in ("VERSION_MAJOR", "VERSION_MINOR", "PATCHLEVEL")
        )
    except (KeyError, ValueError) as error:
        raise BuildError(f"{path} does not say which Zephyr this is", MEND_NONE) from error
    return major, minor, patch
