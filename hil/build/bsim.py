# SPDX-License-Identifier: Apache-2.0
"""Finding BabbleSim, the radio simulator, and saying how to get what is missing of it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hil.build.workspace import Workspace
from hil.errors import BuildError

PHY = "bs_2G4_phy_v1"
BINARIES = (
    f"bin/{PHY}",
    "lib/lib_2G4Channel_NtNcable.so",
    "lib/lib_2G4Channel_multiatt.so",
    "lib/lib_2G4Modem_Magic.so",
    "lib/lib_2G4Modem_BLE_simple.so",
    "lib/libUtilv1.32.a",
    "lib/libPhyComv1.32.a",
    "lib/lib2G4PhyComv1.32.a",
    "lib/libRandv2.32.a",
)
"""What the images link and what a simulation loads, below the output folder."""


@dataclass(frozen=True)
class BabbleSim:
    """An installed BabbleSim.

    Attributes:
        output: ``BSIM_OUT_PATH``: holds ``bin`` and ``lib``.
        components: ``BSIM_COMPONENTS_PATH``: the sources.
    """

    output: Path
    components: Path

    @property
    def environment(self) -> dict[str, str]:
        return {
            "BSIM_OUT_PATH": str(self.output),
            "BSIM_COMPONENTS_PATH": str(self.components),
        }

    @property
    def phy(self) -> Path:
        return self.output / "bin" / PHY

    def version(self) -> str:
        """Version of the simulator of the physical layer; ``unknown`` when it does not say."""
        file = self.components / "ext_2G4_phy_v1" / "version"
        return file.read_text(encoding="utf-8").strip() if file.is_file() else "unknown"


def find_babblesim(workspace: Workspace, env: Mapping[str, str] | None = None) -> BabbleSim:
    """The BabbleSim at ``BSIM_OUT_PATH``, else the one in ``tools/bsim`` of the workspace.

    Raises:
        BuildError: its sources or its binaries are not there.
    """
    env = os.environ if env is None else env
    named = env.get("BSIM_OUT_PATH")
    output = Path(named) if named else workspace.path / "tools" / "bsim"
    components = Path(env.get("BSIM_COMPONENTS_PATH") or output / "components")
    if not components.is_dir():
        raise BuildError(
            f"the radio simulator BabbleSim is not at {output}",
            f"fetch it: cd {workspace.path} && "
            "west config manifest.group-filter -- +babblesim && west update\n"
            f"then build it: make -C {output} everything -j2",
        )
    missing = [name for name in BINARIES if not (output / name).is_file()]
    if missing:
        raise BuildError(
            f"BabbleSim at {output} is not built: {missing[0]} is missing",
            f"make -C {output} everything -j2\n"
            "its 32-bit libraries need: apt-get install gcc-multilib g++-multilib",
        )
    return BabbleSim(output, components)
