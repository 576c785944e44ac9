# SPDX-License-Identifier: Apache-2.0
"""Images that were built before, perhaps on another machine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hil.build import Manifest
from hil.build.manifest import MANIFEST_NAME, load
from hil.errors import BuildError
from hil.scenario import Scenario
from hil.wire.messages import ROLES


def images(folder: Path) -> dict[str, Manifest]:
    """Role -> manifest of the image in ``folder/<role>``.

    Raises:
        BuildError: a manifest is missing or cannot be read.
    """
    found = {}
    for role in ROLES:
        manifest = load(folder / role)
        if manifest is None:
            raise BuildError(
                f"no image of the {role}: {folder / role / MANIFEST_NAME} is missing or broken",
                "name the folder that holds leader/ and follower/, such as "
                "build/firmware/nrf52840dk\nbuild them: hil build --target nrf52840dk",
            )
        found[role] = manifest
    return found


def check_kconfig(manifests: Mapping[str, Manifest], scenario: Scenario) -> None:
    """See that the images are the ones that a scenario wants.

    Raises:
        BuildError: one was built with other options.
    """
    for role, manifest in manifests.items():
        wanted = dict(scenario.kconfig.get(role, {}))
        if dict(manifest.kconfig) != wanted:
            raise BuildError(
                f"scenario '{scenario.name}' wants the {role} built with {wanted or 'no option'}, "
                f"the image given was built with {dict(manifest.kconfig) or 'none'}",
                "name a scenario of these images with --scenario\n"
                "or leave --images out, to build what the scenario wants",
            )
