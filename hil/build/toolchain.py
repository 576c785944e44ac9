# SPDX-License-Identifier: Apache-2.0
"""Choosing the compiler: the Zephyr SDK or Debian's for the board, the host's for the simulation.

``ZEPHYR_TOOLCHAIN_VARIANT``, when the user has set it, decides for the board. A simulated image
is a program of this machine, so there it only counts when it names a host compiler.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hil.errors import BuildError
from hil.process import capture, run

CROSS_PREFIX = "arm-none-eabi-"
HOST_VARIANTS = ("host", "llvm")
SDK_PLACES = ("/usr", "/usr/local", "/opt", "~", "~/.local", "~/.local/opt", "~/bin")
"""Where Zephyr's own CMake code looks for its SDK."""

MEND_CROSS = (
    "Debian's compiler: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi "
    "libstdc++-arm-none-eabi-newlib\n"
    "or the Zephyr SDK: west sdk install -t arm-zephyr-eabi"
)
MEND_HOST = "apt-get install gcc-multilib g++-multilib"


@dataclass(frozen=True)
class Toolchain:
    """A compiler for one target.

    Attributes:
        variant: as Zephyr calls it: ``zephyr``, ``cross-compile``, ``host`` ...
        version: first line of what the compiler says of itself, or the SDK's version.
        environment: variables that make Zephyr use it.
    """

    variant: str
    version: str
    environment: Mapping[str, str] = field(default_factory=dict)


def choose(target: str, env: Mapping[str, str] | None = None) -> Toolchain:
    """The toolchain for ``target`` (``sim`` or ``nrf52840dk``).

    Raises:
        BuildError: none is installed.
    """
    env = os.environ if env is None else env
    wanted = env.get("ZEPHYR_TOOLCHAIN_VARIANT", "")
    if target == "sim":
        return _host(wanted if wanted in HOST_VARIANTS else "host", env)
    if wanted and wanted not in HOST_VARIANTS:
        return _named(wanted, env)
    sdk = _find_sdk(env)
    if sdk is not None:
        return _sdk(sdk)
    cross = shutil.which(f"{CROSS_PREFIX}gcc", path=env.get("PATH"))
    if cross is None:
        raise BuildError("no compiler for the nRF52840 was found", MEND_CROSS)
    return _cross(cross.removesuffix("gcc"))


def _host(variant: str, env: Mapping[str, str]) -> Toolchain:
    name = "clang" if variant == "llvm" else "gcc"
    compiler = shutil.which(name, path=env.get("PATH"))
    if compiler is None:
        raise BuildError(f"no host compiler: there is no '{name}'", MEND_HOST)
    # The simulated board is a 32-bit program, which needs the 32-bit C library's headers.
    run(
        [compiler, "-m32", "-E", "-x", "c", "-include", "stdio.h", os.devnull],
        name=f"{name} -m32",
        timeout_s=20,
        error=BuildError,
        mend=MEND_HOST,
    )
    return Toolchain(variant, _version(compiler), {"ZEPHYR_TOOLCHAIN_VARIANT": variant})


def _named(variant: str, env: Mapping[str, str]) -> Toolchain:
    """What the user chose is used as it is; only its version is looked up, where that is easy."""
    environment = {"ZEPHYR_TOOLCHAIN_VARIANT": variant}
    if variant == "zephyr":
        sdk = _find_sdk(env)
        if sdk is None:
            raise BuildError(
                "ZEPHYR_TOOLCHAIN_VARIANT=zephyr, but no Zephyr SDK is installed", MEND_CROSS
            )
        return _sdk(sdk)
    if variant == "cross-compile":
        prefix = env.get("CROSS_COMPILE") or shutil.which(
            f"{CROSS_PREFIX}gcc", path=env.get("PATH")
        )
        if not prefix:
            raise BuildError(
                "ZEPHYR_TOOLCHAIN_VARIANT=cross-compile, but CROSS_COMPILE is not set and there "
                f"is no {CROSS_PREFIX}gcc",
                MEND_CROSS,
            )
        return _cross(prefix.removesuffix("gcc"))
    return Toolchain(variant, variant, environment)


def _cross(prefix: str) -> Toolchain:
    if not Path(f"{prefix}gcc").is_file():
        raise BuildError(f"there is no compiler {prefix}gcc (CROSS_COMPILE)", MEND_CROSS)
    return Toolchain(
        "cross-compile",
        _version(f"{prefix}gcc"),
        {"ZEPHYR_TOOLCHAIN_VARIANT": "cross-compile", "CROSS_COMPILE": prefix},
    )


def _sdk(folder: Path) -> Toolchain:
    version = (folder / "sdk_version").read_text(encoding="utf-8").strip()
    return Toolchain(
        "zephyr",
        f"Zephyr SDK {version}",
        {"ZEPHYR_TOOLCHAIN_VARIANT": "zephyr", "ZEPHYR_SDK_INSTALL_DIR": str(folder)},
    )


def _find_sdk(env: Mapping[str, str]) -> Path | None:
    """The newest SDK that has the compiler for ARM."""
    home = env.get("HOME", "~")
    named = env.get("ZEPHYR_SDK_INSTALL_DIR")
    folders = [Path(named)] if named else []
    for place in () if named else SDK_PLACES:
        folders += Path(place.replace("~", home)).glob("zephyr-sdk-*")
    usable = [
        folder
        for folder in folders
        if (folder / "sdk_version").is_file() and (folder / "arm-zephyr-eabi").is_dir()
    ]
    return max(usable, key=_numbers, default=None)


def _numbers(folder: Path) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", folder.name))


def _version(compiler: str) -> str:
    return capture([compiler, "--version"]).partition("\n")[0] or compiler
