# SPDX-License-Identifier: Apache-2.0
"""Building the firmware: find the workspace, run west, keep a manifest of what came out."""

from hil.build.bsim import BabbleSim, find_babblesim
from hil.build.images import build, build_images
from hil.build.manifest import GitState, Manifest, OutputFile
from hil.build.workspace import Workspace, find_workspace

__all__ = [
    "BabbleSim",
    "GitState",
    "Manifest",
    "OutputFile",
    "Workspace",
    "build",
    "build_images",
    "find_babblesim",
    "find_workspace",
]
