# SPDX-License-Identifier: Apache-2.0
"""The rig that judges: which code, on which machine, with which packages."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from hil.process import git

_PACKAGE: Final = Path(__file__).resolve().parents[1]
_JUDGING: Final = ("numpy", "mcap")
"""Packages whose version can change a figure."""


def describe() -> dict[str, Any]:
    """What ``report.json`` says of the rig under ``rig``."""
    return {
        "git": dict(git_state(_PACKAGE)),
        "host": {
            "name": platform.node(),
            "system": f"{platform.system()} {platform.release()}",
            "machine": platform.machine(),
        },
        "packages": {name: package_version(name) for name in _JUDGING},
    }


@cache
def git_state(package: Path) -> tuple[tuple[str, str], tuple[str, str]]:
    """Commit of the checkout that ``package`` lies in, and whether the package differs from it.

    ``commit`` is empty and ``state`` is ``unknown`` when the package is in no checkout, also when
    it is installed below somebody else's.
    """
    commit, state = git.state(package, ".", tracked="__init__.py")
    return ("commit", commit), ("state", state)


def package_version(name: str) -> str:
    """Version of an installed package, or ``unknown``."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
