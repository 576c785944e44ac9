# SPDX-License-Identifier: Apache-2.0
"""``hil sbom``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hil.sbom.parts import Part


def sbom(
    images: Annotated[
        list[Path] | None,
        typer.Argument(help="Build folders (default: both roles for nrf52840dk, as last built)."),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write.")] = Path(
        "sbom.cdx.json"
    ),
    workspace: Annotated[Path | None, typer.Option(help="Zephyr workspace.")] = None,
) -> None:
    """Write the bill of materials of images that were built: CycloneDX 1.6, JSON.

    Hashes of the images, revisions and licences of Zephyr and its modules, the toolchain, and the
    Python packages of the rig.

    Example: [bold]hil sbom -o build/sbom.cdx.json[/bold]
    """
    from hil import build  # noqa: PLC0415 (start-up time of --help)
    from hil.atomic import write_whole  # noqa: PLC0415
    from hil.build import sources  # noqa: PLC0415
    from hil.errors import HilError  # noqa: PLC0415
    from hil.sbom import packages, parts  # noqa: PLC0415
    from hil.wire.messages import ROLES  # noqa: PLC0415

    try:
        from hil.sbom import document  # noqa: PLC0415
    except ImportError as error:
        raise HilError("hil sbom needs cyclonedx-python-lib", "pip install 'hil[sbom]'") from error
    built = sources.project_root() / "build" / "firmware" / "nrf52840dk"
    folders = images or [built / role for role in ROLES]
    found = [parts.manifest_of(folder) for folder in folders]
    place = build.find_workspace(workspace)
    linked: dict[str, Part] = {}
    for folder, image in zip(folders, found, strict=True):
        for part in parts.linked(folder, place.zephyr_base, image["zephyr_commit"]):
            linked[part.name] = part
    text = document.render(found, linked, packages.needed(extras=("build",)))
    write_whole(output, text.encode("utf-8"))
    typer.echo(f"{output}: {len(found)} images, {len(linked)} parts of the firmware")
