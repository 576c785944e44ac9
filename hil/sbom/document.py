# SPDX-License-Identifier: Apache-2.0
"""The bill of materials as CycloneDX 1.6 (ECMA-424), JSON."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib import metadata
from typing import Any

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL

from hil.sbom import parts
from hil.sbom.packages import Package
from hil.sbom.parts import Part

_NAMESPACE = uuid.UUID("6f1c9a52-6d1e-5b0a-9a52-0d1f6a3f1b60")


def render(
    images: Sequence[Mapping[str, Any]],
    linked: Mapping[str, Part],
    packages: Sequence[Package],
) -> str:
    """The document as text; equal inputs give equal text.

    Args:
        images: build manifests, as ``hil-manifest.json`` holds them.
        linked: name -> part, of all images together.
        packages: Python packages of the rig.
    """
    bom = Bom()
    newest = max(datetime.fromisoformat(image["created_utc"]) for image in images)
    bom.metadata.timestamp = newest
    identity = "".join(sorted(image["build_id"] + image["target"] for image in images))
    bom.serial_number = uuid.uuid5(_NAMESPACE, identity)
    project = Component(
        name="hil",
        version=metadata.version("hil"),
        type=ComponentType.APPLICATION,
        bom_ref="hil",
        licenses=_licence(parts.OWN),
    )
    bom.metadata.component = project
    libraries = [_part(part) for part in linked.values()]
    eigen = _named(packages, "cmeel-eigen")
    if eigen is not None:
        libraries.append(_part(Part("eigen", eigen.version, parts.EIGEN)))
    for image in images:
        made = _image(image)
        bom.components.add(made)
        bom.register_dependency(made, libraries)
    toolchains = {
        name: Component(name=name, type=ComponentType.APPLICATION, bom_ref=f"toolchain:{name}")
        for name in sorted({image["toolchain"] for image in images})
    }
    for tool in toolchains.values():
        bom.metadata.tools.components.add(tool)
    python = [_package(package) for package in packages]
    for component in (*libraries, *python):
        bom.components.add(component)
    bom.register_dependency(project, [*python, *(c for c in bom.components if _is_image(c))])
    return JsonV1Dot6(bom).output_as_string(indent=2) + "\n"


def _image(image: Mapping[str, Any]) -> Component:
    name = f"{image['role']} for {image['target']}"
    facts = {
        "build_id": image["build_id"],
        "inputs_sha256": image["inputs_sha256"],
        "board": image["board"],
        "commit": image["git"]["commit"],
        "state": image["git"]["state"],
        "estimator_sha256": image["estimator_sha256"],
    }
    made = Component(
        name=name,
        version=image["build_id"],
        type=ComponentType.FIRMWARE,
        bom_ref=f"image:{image['target']}:{image['role']}",
        licenses=_licence(parts.OWN),
        properties=[Property(name=f"hil:{key}", value=str(value)) for key, value in facts.items()],
    )
    for kind, file in image["files"].items():
        made.components.add(
            Component(
                name=file["path"],
                type=ComponentType.FILE,
                bom_ref=f"file:{image['target']}:{image['role']}:{kind}",
                hashes=[HashType(alg=HashAlgorithm.SHA_256, content=file["sha256"])],
            )
        )
    return made


def _is_image(component: Component) -> bool:
    return component.type is ComponentType.FIRMWARE


def _part(part: Part) -> Component:
    found = [Property(name="hil:revision_from", value=part.found)] if part.found else []
    return Component(
        name=part.name,
        version=part.revision or None,
        type=ComponentType.LIBRARY,
        bom_ref=f"firmware:{part.name}",
        licenses=_licence(part.licence),
        properties=found,
    )


def _package(package: Package) -> Component:
    return Component(
        name=package.name,
        version=package.version,
        type=ComponentType.LIBRARY,
        bom_ref=f"pypi:{package.name}",
        purl=PackageURL("pypi", name=package.name, version=package.version),
        licenses=_licence(package.licence),
    )


def _licence(text: str) -> list[Any]:
    return [LicenseFactory().make_from_string(text)]


def _named(packages: Sequence[Package], name: str) -> Package | None:
    return next((package for package in packages if package.name == name), None)
