# SPDX-License-Identifier: Apache-2.0
"""What the firmware's tests need: a Zephyr workspace, or a skip that says how to get one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from hil import build
from hil.build import Manifest, find_babblesim, find_workspace, toolchain
from hil.errors import BuildError


@pytest.fixture(scope="session")
def build_environment() -> dict[str, str]:
    """Environment in which west builds for the simulated board."""
    try:
        workspace = find_workspace(None)
        babblesim = find_babblesim(workspace)
        compiler = toolchain.choose("sim")
    except BuildError as error:
        pytest.skip(str(error))
    return {
        **compiler.environment,
        **babblesim.environment,
        "ZEPHYR_BASE": str(workspace.zephyr_base),
    }


@pytest.fixture(scope="session")
def images(build_environment: dict[str, str]) -> Mapping[str, Manifest]:
    """Both nodes' images as they are delivered, for the simulated board."""
    del build_environment
    return build.build_images({}, "sim")


@pytest.fixture(scope="session")
def stranger(images: Mapping[str, Manifest]) -> Path:
    """A follower for the simulated board with another key than the pair's; it fails on command."""
    del images
    options = {"BV_LINK_KEY": "00112233445566778899aabbccddeeff", "BV_FAULT_COMMANDS": True}
    return build.build("follower", "sim", options).file("exe")
