# SPDX-License-Identifier: Apache-2.0
"""The manifest of an image: what it is, what it was made from, how much room it takes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from hil.atomic import write_whole

MANIFEST_NAME = "hil-manifest.json"
FORMAT = 1


@dataclass(frozen=True)
class OutputFile:
    """One file that a build produced; ``path`` is relative to the build folder."""

    path: str
    sha256: str
    size: int


@dataclass(frozen=True)
class GitState:
    """``commit`` is empty when there is none; ``state`` is clean, dirty or unknown."""

    commit: str
    state: str


@dataclass(frozen=True)
class Manifest:
    """One image.

    Attributes:
        role: ``leader`` or ``follower``.
        target: ``sim`` or ``nrf52840dk``.
        board: Zephyr's name of the board.
        build_id: 16 hex digits, the same number that the firmware says in HELLO.
        inputs_sha256: hash of all that the build depends on.
        created_utc: when it was built, ISO 8601.
        files: kind (``hex``, ``elf``, ``exe``) -> file.
        flash_bytes: flash used; None on a target that has none.
        flash_total_bytes: flash there is.
        ram_bytes: RAM used statically.
        ram_total_bytes: RAM there is.
        zephyr_version: e.g. ``4.1.0``.
        zephyr_commit: of Zephyr's checkout, or empty.
        toolchain: what the compiler says of itself.
        estimator_sha256: of the estimator's sources, as the host's core knows its own.
        kconfig: overrides beside the defaults of the sources, without ``CONFIG_``.
        git: state of the checkout.
        warnings: compiler warnings in this project's own sources, one line each.
        folder: build folder; not part of the saved manifest.
        unchanged: this call had nothing to build; not part of the saved manifest.
    """

    role: str
    target: str
    board: str
    build_id: str
    inputs_sha256: str
    created_utc: str
    files: Mapping[str, OutputFile]
    zephyr_version: str
    toolchain: str
    git: GitState
    flash_bytes: int | None = None
    flash_total_bytes: int | None = None
    ram_bytes: int | None = None
    ram_total_bytes: int | None = None
    zephyr_commit: str = ""
    estimator_sha256: str = ""
    kconfig: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    folder: Path = Path()
    unchanged: bool = False

    def file(self, kind: str) -> Path:
        """Absolute path of an output file.

        Raises:
            KeyError: this target has no file of that kind.
        """
        return self.folder / self.files[kind].path

    def to_mapping(self) -> dict[str, Any]:
        """Plain data for a recording's provenance and for the file beside the image."""
        data = asdict(self)
        del data["folder"], data["unchanged"]
        data["kconfig"] = dict(self.kconfig)
        data["warnings"] = list(self.warnings)
        return {"format": FORMAT, **data}

    def is_intact(self, *kinds: str) -> bool:
        """True when the output files, all or those of ``kinds``, are as they were built."""
        wanted = kinds or tuple(self.files)
        try:
            return all(describe(self.folder, self.file(k)) == self.files[k] for k in wanted)
        except OSError:
            return False

    def save(self) -> None:
        """Write the manifest into its build folder, whole or not at all."""
        text = json.dumps(self.to_mapping(), indent=2) + "\n"
        write_whole(self.folder / MANIFEST_NAME, text.encode("utf-8"))


def describe(folder: Path, path: Path) -> OutputFile:
    """Hash and size of an output file.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return OutputFile(path.relative_to(folder).as_posix(), digest, path.stat().st_size)


def load(folder: Path) -> Manifest | None:
    """The manifest in a build folder; None when there is none that this version understands."""
    try:
        data = json.loads((folder / MANIFEST_NAME).read_text(encoding="utf-8"))
        if data.pop("format") != FORMAT:
            return None
        files = {kind: OutputFile(**file) for kind, file in data.pop("files").items()}
        git = GitState(**data.pop("git"))
        warnings = tuple(data.pop("warnings"))
        manifest = Manifest(files=files, git=git, warnings=warnings, **data)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        # Missing, cut short by a crash, or of another version: the image is simply built again.
        return None
    return replace(manifest, folder=folder)
