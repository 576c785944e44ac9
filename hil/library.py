# SPDX-License-Identifier: Apache-2.0
"""The folder of recordings: where they lie, what each says of itself, how a new one is added.

A recording is a folder ``<name>/`` with ``recording.mcap`` and a ``README.md`` that says plainly
where it came from.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hil.atomic import write_whole
from hil.errors import RecordingError
from hil.faults import in_words
from hil.recording import Recording, load

FILE_NAME = "recording.mcap"

SOURCE_LABELS: Mapping[str, str] = {
    "sim": "simulated radio, real firmware",
    "bench": "two boards on the bench",
    "synthetic": "synthetic: computed, no firmware ran",
    "import": "imported from foreign data",
}


def resolve(path: Path) -> Path:
    """The ``.mcap`` file meant by ``path``: the file itself, or the one in a recording's folder.

    Raises:
        RecordingError: there is no such file.
    """
    file = path / FILE_NAME if path.is_dir() else path
    if not file.is_file():
        raise RecordingError(
            f"no recording at {path}",
            f"name an .mcap file or a folder that holds {FILE_NAME}\n"
            "make one: hil record fixtures/scenarios/clean-7ms5.toml -o my-run",
        )
    return file


def find(folder: Path) -> list[Path]:
    """All recordings directly below ``folder``, by name."""
    return sorted(folder.glob(f"*/{FILE_NAME}"))


def find_expected_to_pass(folder: Path) -> Iterator[Path]:
    """The recordings that were not made to fail, nor injected: those a default run judges."""
    for path in find(folder):
        provenance = load(path).provenance
        if not provenance.scenario.get("expect_fail") and not provenance.injected:
            yield path


def target(folder: Path, name: str) -> Path:
    """Where a new recording called ``name`` goes.

    Raises:
        RecordingError: the name is not a plain file name, or it is taken.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        raise RecordingError(
            f"{name!r} cannot be a recording's name",
            "use letters, digits, dots, dashes and underscores, e.g. clean-7ms5",
        )
    path = folder / name / FILE_NAME
    if path.exists():
        raise RecordingError(
            f"there is a recording at {path} already",
            "choose another name, or delete that folder first",
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def write_readme(recording: Recording, path: Path) -> None:
    """Write the README beside the recording at ``path``: what ran, on what, from which build."""
    provenance = recording.provenance
    scenario = provenance.scenario
    expect_fail = scenario.get("expect_fail") or []
    size_mb = path.stat().st_size / 1e6
    length = f"{scenario.get('duration_s', '?')} s, {size_mb:.1f} MB"
    lines = [
        f"# {scenario.get('name', path.parent.name)}",
        "",
        f"**{SOURCE_LABELS[provenance.source].capitalize()}.** "
        + ("Nothing here was measured on silicon." if provenance.source != "bench" else ""),
        "",
        str(scenario.get("description", "")).strip(),
        "",
    ]
    if expect_fail:
        lines += [
            "This run was made with a fault built in; these checks must fail on it: "
            + ", ".join(f"`{name}`" for name in expect_fail)
            + ".",
            "",
        ]
    if provenance.injected:
        lines += [
            f"**Not a clean run: {in_words(scenario)}.** It says nothing of the product.",
            "",
        ]
    lines += [
        f"- recorded {provenance.created_utc}, {length}",
        f"- wire schema `{provenance.schema_hash}`",
        *(_image_line(role, manifest) for role, manifest in sorted(provenance.manifests.items())),
        *(f"- {tool}: {version}" for tool, version in sorted(provenance.tools.items())),
        "",
        f"Look at it with `hil replay {path.parent}`.",
        "",
    ]
    write_whole(path.parent / "README.md", "\n".join(lines).encode("utf-8"))


def _image_line(role: str, manifest: Mapping[str, Any]) -> str:
    kconfig = manifest.get("kconfig") or {}
    options = ", ".join(f"`{key}={value}`" for key, value in sorted(kconfig.items()))
    return f"- {role} image: build id `{manifest.get('build_id', '?')}`" + (
        f", with {options}" if options else ""
    )
