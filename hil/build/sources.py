# SPDX-License-Identifier: Apache-2.0
"""What an image is made from: the source files, their hash, and the build id drawn from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from hil.build.manifest import GitState
from hil.errors import BuildError
from hil.process import git

SOURCE_FOLDERS = ("firmware", "boards")
IGNORED_PARTS = ("tests", "pil", "build", "__pycache__")
IGNORED_SUFFIXES = (".md", ".toml", ".orig", ".rej", ".swp")

KconfigValue = int | str | bool


def project_root() -> Path:
    """The checkout that holds ``firmware/``.

    Raises:
        BuildError: this is an installed package without the sources of the firmware.
    """
    root = Path(__file__).resolve().parents[2]
    if not (root / "firmware" / "apps").is_dir():
        raise BuildError(
            f"the firmware's sources are not at {root / 'firmware'}",
            "run hil from a checkout: git clone, then python -m pip install -e '.[build]'",
        )
    return root


def source_files(root: Path) -> Iterator[Path]:
    """Every file that can change an image, in a fixed order."""
    for folder in SOURCE_FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            relative = path.relative_to(root)
            if (
                path.is_file()
                and path.suffix not in IGNORED_SUFFIXES
                and not any(p in IGNORED_PARTS or p.startswith(".") for p in relative.parts)
            ):
                yield path


def build_id(root: Path, kconfig: Mapping[str, KconfigValue], zephyr_version: str) -> int:
    """Identity of a build: the first eight bytes of a SHA-256, big-endian.

    Covers names and contents of the sources, the Kconfig overrides and Zephyr's version, so that
    equal inputs give equal ids on any machine at any time.
    """
    digest = hashlib.sha256()
    for path in source_files(root):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    digest.update(json.dumps(dict(kconfig), sort_keys=True).encode())
    digest.update(zephyr_version.encode())
    return int.from_bytes(digest.digest()[:8], "big")


def estimator_hash(root: Path) -> str:
    """Hash of the estimator's sources, hexadecimal; ``hil/core/CMakeLists.txt`` has the same."""
    files = sorted((root / "firmware" / "lib" / "estimator").glob("*.?pp"))
    each = "".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
    return hashlib.sha256(each.encode()).hexdigest()


def inputs_hash(build_id: int, **others: str) -> str:
    """Hash of everything a finished build depends on; hexadecimal."""
    text = json.dumps({"build_id": f"{build_id:016x}", **others}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def git_state(root: Path) -> GitState:
    """Commit of the checkout, and whether the firmware's sources differ from it."""
    return GitState(*git.state(root, *SOURCE_FOLDERS))
