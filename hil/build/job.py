# SPDX-License-Identifier: Apache-2.0
"""One image to be built: everything that decides what will come out, before anything runs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hil.build import sources, toolchain, west
from hil.build.sources import KconfigValue
from hil.build.toolchain import Toolchain
from hil.build.workspace import Workspace, find_workspace
from hil.errors import BuildError
from hil.wire.messages import ROLES


@dataclass(frozen=True)
class Job:
    """One image to be built, of ``role`` for ``target``, from the checkout ``root``.

    ``build_id`` is what the firmware will say in HELLO; ``inputs_sha256`` also covers what it is
    built with, and decides whether there is anything to do.
    """

    role: str
    target: str
    kconfig: Mapping[str, KconfigValue]
    root: Path
    workspace: Workspace
    toolchain: Toolchain
    zephyr_commit: str
    build_id: int
    inputs_sha256: str

    @property
    def title(self) -> str:
        return f"{self.role} for {self.target}"

    @property
    def source(self) -> Path:
        return self.root / "firmware" / "apps" / self.role

    @property
    def folder(self) -> Path:
        """Build folder: one per role, target and set of overrides."""
        name = folder_name(self.role, self.kconfig)
        return self.root / "build" / "firmware" / self.target / name

    def needs_fresh_folder(self) -> bool:
        """True when the build folder was configured for another Zephyr or another compiler."""
        cache = self.folder / "CMakeCache.txt"
        if not cache.is_file():
            return False
        text = cache.read_text(encoding="utf-8", errors="replace")
        expected = {
            "ZEPHYR_BASE": str(self.workspace.zephyr_base),
            "ZEPHYR_TOOLCHAIN_VARIANT": self.toolchain.variant,
        }
        for name, value in expected.items():
            found = re.search(rf"^{name}:[A-Z]+=(.*)$", text, re.MULTILINE)
            if found and found[1] != value:
                return True
        return False


def plan(
    role: str,
    target: str,
    kconfig: Mapping[str, KconfigValue],
    workspace: Path | None,
    root: Path | None,
) -> Job:
    """Find workspace and toolchain, and hash the inputs.

    Raises:
        BuildError: no such image, no workspace, or no toolchain.
    """
    if role not in ROLES or target not in west.BOARDS:
        raise BuildError(
            f"there is no image '{role}' for '{target}'",
            f"roles: {', '.join(ROLES)}\ntargets: {', '.join(west.BOARDS)}",
        )
    root = root or sources.project_root()
    if not (root / "firmware" / "apps" / role / "CMakeLists.txt").is_file():
        raise BuildError(f"there is no application at {root / 'firmware' / 'apps' / role}")
    found = find_workspace(workspace)
    chosen = toolchain.choose(target)
    commit = found.zephyr_commit()
    build_id = sources.build_id(root, kconfig, found.version)
    return Job(
        role=role,
        target=target,
        kconfig=dict(kconfig),
        root=root,
        workspace=found,
        toolchain=chosen,
        zephyr_commit=commit,
        build_id=build_id,
        inputs_sha256=sources.inputs_hash(
            build_id,
            role=role,
            target=target,
            zephyr_base=str(found.zephyr_base),
            zephyr_commit=commit,
            toolchain=f"{chosen.variant} {chosen.version}",
        ),
    )


def folder_name(role: str, kconfig: Mapping[str, KconfigValue]) -> str:
    """``leader``, or ``leader-`` and a short hash of the overrides."""
    if not kconfig:
        return role
    text = json.dumps({k: west.kconfig_text(v) for k, v in kconfig.items()}, sort_keys=True)
    return f"{role}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
