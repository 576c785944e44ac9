# SPDX-License-Identifier: Apache-2.0
"""The parts that are linked into the images, and the tools that make them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hil.errors import BuildError
from hil.process import capture

LICENCES: Final[Mapping[str, str]] = {
    "zephyr": "Apache-2.0",
    "cmsis": "Apache-2.0",
    "cmsis_6": "Apache-2.0",
    "hal_nordic": "BSD-3-Clause AND Apache-2.0",
    "hal_st": "BSD-3-Clause",
    "mbedtls": "Apache-2.0 OR GPL-2.0-or-later",
    "nrf_hw_models": "Apache-2.0",
    "picolibc": "BSD-3-Clause",
    "segger": "BSD-1-Clause",
    "tinycrypt": "BSD-3-Clause",
}
"""SPDX expressions, of the files that are compiled, as each project's own texts say."""
BABBLESIM: Final = "Apache-2.0"
EIGEN: Final = "MPL-2.0"
OWN: Final = "Apache-2.0"
OURS: Final = "bv_firmware"
"""This project's own Zephyr module."""

_MODULE: Final = re.compile(r'^"([A-Za-z0-9_]+)":"([^"]+)":')
_MODULES_MAX_B: Final = 1 << 16
_COMMIT: Final = re.compile(r"[0-9a-f]{40}")


@dataclass(frozen=True)
class Part:
    """One part.

    Attributes:
        revision: commit or version; empty when unknown.
        found: how the revision is known: ``checkout``, or ``pinned`` by Zephyr's own manifest.
    """

    name: str
    revision: str
    licence: str
    found: str = ""


def linked(build_folder: Path, zephyr_base: Path, zephyr_commit: str = "") -> list[Part]:
    """Zephyr and its modules that a build was configured with.

    Raises:
        BuildError: the folder holds no build, or a module whose licence is not listed.
    """
    listing = build_folder / "zephyr_modules.txt"
    try:
        with listing.open(encoding="utf-8") as file:
            lines = file.read(_MODULES_MAX_B).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BuildError(f"{listing}: cannot be read: {error}", "hil build") from error
    pinned = _pinned(zephyr_base)
    places = {m[1]: Path(m[2]) for line in lines if (m := _MODULE.match(line)) and m[1] != OURS}
    parts = [Part("zephyr", zephyr_commit, LICENCES["zephyr"], "checkout")]
    for name, place in sorted(places.items()):
        if name not in LICENCES:
            raise BuildError(
                f"the licence of the Zephyr module {name} is not known",
                "read it in the module's sources and add it to LICENCES in hil/sbom/parts.py",
            )
        commit = _checked_out(place)
        parts.append(
            Part(name, commit, LICENCES[name], "checkout")
            if commit
            else Part(name, pinned.get(name, ""), LICENCES[name], "pinned")
        )
    return parts


def _checked_out(place: Path) -> str:
    """Commit of the module's own checkout; empty when it is none."""
    if not (place / ".git").exists():
        return ""
    said = capture(["git", "-C", place, "rev-parse", "HEAD"])
    return said if _COMMIT.fullmatch(said) else ""


def _pinned(zephyr_base: Path) -> dict[str, str]:
    """Module -> the revision that Zephyr's manifest names."""
    return dict(_projects(zephyr_base / "west.yml"))


def _projects(manifest: Path) -> Iterator[tuple[str, str]]:
    import yaml  # noqa: PLC0415 (of the build extra)

    try:
        listed = yaml.safe_load(manifest.read_text(encoding="utf-8"))["manifest"]["projects"]
        for project in listed:
            yield str(project["name"]), str(project.get("revision", ""))
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise BuildError(f"{manifest}: cannot be read: {error}", "west update") from error


def manifest_of(folder: Path) -> Mapping[str, Any]:
    """The build manifest in a build folder, whose image must be as it was built.

    Raises:
        BuildError: there is none, or the image was changed.
    """
    from hil.build import manifest  # noqa: PLC0415

    found = manifest.load(folder)
    if found is None:
        raise BuildError(f"there is no image in {folder}", "hil build")
    if not found.is_intact():
        raise BuildError(f"the image in {folder} is not as it was built", "hil build")
    return json.loads(json.dumps(found.to_mapping()))  # type: ignore[no-any-return]
