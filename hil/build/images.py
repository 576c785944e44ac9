# SPDX-License-Identifier: Apache-2.0
"""Building images: decide whether there is anything to do, do it, write down what came out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from hil.build import footprint, manifest, sources, west
from hil.build.bsim import find_babblesim
from hil.build.job import Job, plan
from hil.build.manifest import Manifest
from hil.build.sources import KconfigValue
from hil.errors import BuildError
from hil.process import run, scratch, turn
from hil.wire.messages import ROLES

if TYPE_CHECKING:
    from hil.backends import Progress

BUILD_LIMIT_S = 1800.0
RERUNS_MAX = 1
"""West runs CMake first, which leaves ninja at most one reason to; it would go on for a hundred."""
LOG_NAME = "hil-build.log"
OUTPUTS: Mapping[str, Mapping[str, str]] = {
    "sim": {"exe": "zephyr/zephyr.exe", "elf": "zephyr/zephyr.elf"},
    "nrf52840dk": {"hex": "zephyr/zephyr.hex", "elf": "zephyr/zephyr.elf"},
}
"""Target -> kind -> file, relative to the build folder."""


def silent(share: float, what: str) -> None:
    """A progress callback that shows nothing."""


def build(
    role: str,
    target: str,
    kconfig_overrides: Mapping[str, KconfigValue] | None = None,
    progress: Progress = silent,
    *,
    workspace: Path | None = None,
    root: Path | None = None,
) -> Manifest:
    """Build one image, or find that the one there is still good.

    The folder is ``build/firmware/<target>/<role>``; overrides give a folder of their own beside
    it, so that variants do not rebuild each other. Two processes take turns on one folder.

    Args:
        kconfig_overrides: Kconfig name without ``CONFIG_`` -> value.
        workspace: as :func:`hil.build.find_workspace`.
        root: checkout to build; the one this package lies in by default.

    Raises:
        BuildError: no workspace, no toolchain, or the build failed; the last shows the
            compiler's own words.
    """
    progress(0.0, f"{role} for {target}: looking for changes")
    job = plan(role, target, kconfig_overrides or {}, workspace, root)
    with turn(job.folder, lambda: progress(0.0, f"{job.title}: waiting for another build")):
        before = manifest.load(job.folder)
        if before is not None and before.inputs_sha256 == job.inputs_sha256 and before.is_intact():
            image = replace(before, git=sources.git_state(job.root), unchanged=True)
            if image.git != before.git:
                image.save()
            progress(1.0, f"{job.title}: unchanged")
            return image
        image = _describe(job, _west(job, progress), before)
        if sources.build_id(job.root, job.kconfig, job.workspace.version) != job.build_id:
            # Somebody saved a source while the compiler ran: what was built is not what was hashed.
            image = replace(image, inputs_sha256="")
        image.save()
        progress(1.0, f"{job.title}: built")
        return image


def build_images(
    kconfig: Mapping[str, Mapping[str, KconfigValue]],
    target: str,
    workspace: Path | None = None,
    progress: Progress = silent,
    *,
    root: Path | None = None,
) -> dict[str, Manifest]:
    """Build the image of every role.

    Args:
        kconfig: role -> overrides, as a scenario has them.

    Returns:
        role -> manifest.

    Raises:
        BuildError: as :func:`build`.
    """
    images = {}
    for n, role in enumerate(ROLES):

        def part(share: float, what: str, n: int = n) -> None:
            progress((n + share) / len(ROLES), what)

        images[role] = build(
            role, target, kconfig.get(role, {}), part, workspace=workspace, root=root
        )
    return images


def _west(job: Job, progress: Progress) -> tuple[str, ...]:
    """Run west and return what it said.

    Raises:
        BuildError: it failed.
    """
    environment = {
        **os.environ,
        **job.toolchain.environment,
        "ZEPHYR_BASE": str(job.workspace.zephyr_base),
    }
    if job.target == "sim":
        environment |= find_babblesim(job.workspace).environment
    west.check_host_tools(environment.get("PATH"))

    runs = 0

    def show(line: str) -> None:
        nonlocal runs
        runs += west.RERUN in line
        if runs > RERUNS_MAX:
            raise BuildError(
                f"the build of {job.title} runs CMake again and again, as when what CMake writes "
                f"does not reach the disk of {job.folder}",
                f"is it full? df -h {job.root}\nstart afresh: rm -r {job.folder}",
            )
        step = west.progress_of(west.plain(line))
        if step is not None:
            progress(step[0], f"{job.title}: {step[1]}")

    progress(0.01, f"{job.title}: configuring")
    # A compiler that is killed leaves its files where it keeps such.
    with scratch("build") as temporary:
        finished = run(
            west.arguments(
                job.source,
                job.folder,
                job.target,
                job.build_id,
                job.kconfig,
                fresh=job.needs_fresh_folder(),
            ),
            name=f"build of {job.title}",
            timeout_s=BUILD_LIMIT_S,
            cwd=job.workspace.path,
            env=environment | {"TMPDIR": str(temporary)},
            on_line=show,
            check=False,
            error=BuildError,
        )
    lines = tuple(west.plain(line) for line in finished.lines)
    job.folder.mkdir(parents=True, exist_ok=True)
    log = job.folder / LOG_NAME
    log.write_text("\n".join((*lines, "")), encoding="utf-8")
    if finished.status != 0:
        raise BuildError(
            f"the build of {job.title} failed:\n{west.last_words(lines)}",
            f"read all of it: {log}\nstart afresh: rm -r {job.folder}",
        )
    return lines


def _describe(job: Job, lines: tuple[str, ...], before: Manifest | None) -> Manifest:
    """The manifest of what a build left in its folder."""
    folder = job.folder
    image = Manifest(
        role=job.role,
        target=job.target,
        board=west.BOARDS[job.target],
        build_id=f"{job.build_id:016x}",
        inputs_sha256=job.inputs_sha256,
        created_utc=datetime.now(UTC).isoformat(timespec="milliseconds"),
        files={
            kind: manifest.describe(folder, folder / path)
            for kind, path in OUTPUTS[job.target].items()
        },
        zephyr_version=job.workspace.version,
        zephyr_commit=job.zephyr_commit,
        estimator_sha256=sources.estimator_hash(job.root),
        toolchain=job.toolchain.version,
        kconfig=job.kconfig,
        git=sources.git_state(job.root),
        warnings=_warnings(lines, before, job.root),
        folder=folder,
    )
    if job.target == "sim":
        return image
    size = footprint.measure(image.file("elf"), folder / "zephyr" / ".config")
    return replace(
        image,
        flash_bytes=size.flash_bytes,
        flash_total_bytes=size.flash_total_bytes,
        ram_bytes=size.ram_bytes,
        ram_total_bytes=size.ram_total_bytes,
    )


def _warnings(lines: tuple[str, ...], before: Manifest | None, root: Path) -> tuple[str, ...]:
    own = [root / folder for folder in sources.SOURCE_FOLDERS]
    found = west.warnings_in(lines, own, root)
    if before is None:
        return found
    since_s = datetime.fromisoformat(before.created_utc).timestamp()
    kept = (w for w in before.warnings if west.still_valid(w, lines, root, since_s))
    return tuple(dict.fromkeys((*kept, *found)))
