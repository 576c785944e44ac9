# SPDX-License-Identifier: Apache-2.0
"""Which compiler is used: chosen from fake installations, no compiler needed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hil.build import toolchain
from hil.errors import BuildError

SAYS_VERSION = "#!/bin/sh\necho 'gcc (Fake 12.2) 12.2.0'\necho more\n"
WITHOUT_32_BIT = "#!/bin/sh\necho 'bits/libc-header-start.h: No such file or directory'\nexit 1\n"


def program(folder: Path, name: str, text: str = SAYS_VERSION) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text)
    path.chmod(0o755)
    return path


def sdk(folder: Path, version: str, with_arm: bool = True) -> Path:
    path = folder / f"zephyr-sdk-{version}"
    path.mkdir(parents=True)
    (path / "sdk_version").write_text(version + "\n")
    if with_arm:
        (path / "arm-zephyr-eabi").mkdir()
    return path


@pytest.fixture
def env(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """An empty machine: nothing on PATH, nothing at home, no SDK in the system's folders."""
    monkeypatch.setattr(toolchain, "SDK_PLACES", ("~", "~/.local"))
    return {"PATH": str(tmp_path / "bin"), "HOME": str(tmp_path / "home")}


def test_debian_compiler(tmp_path: Path, env: dict[str, str]) -> None:
    gcc = program(tmp_path / "bin", "arm-none-eabi-gcc")
    chosen = toolchain.choose("nrf52840dk", env)
    assert chosen.environment == {
        "ZEPHYR_TOOLCHAIN_VARIANT": "cross-compile",
        "CROSS_COMPILE": str(gcc).removesuffix("gcc"),
    }
    assert chosen.version == "gcc (Fake 12.2) 12.2.0"


def test_the_newest_sdk_with_arm_wins_over_debian(tmp_path: Path, env: dict[str, str]) -> None:
    program(tmp_path / "bin", "arm-none-eabi-gcc")
    sdk(tmp_path / "home", "0.9.5")
    newest = sdk(tmp_path / "home" / ".local", "0.17.0")
    sdk(tmp_path / "home", "0.18.0", with_arm=False)
    chosen = toolchain.choose("nrf52840dk", env)
    assert chosen.environment == {
        "ZEPHYR_TOOLCHAIN_VARIANT": "zephyr",
        "ZEPHYR_SDK_INSTALL_DIR": str(newest),
    }
    assert chosen.version == "Zephyr SDK 0.17.0"


def test_the_user_decides_for_the_board(tmp_path: Path, env: dict[str, str]) -> None:
    gcc = program(tmp_path / "bin", "arm-none-eabi-gcc")
    sdk(tmp_path / "home", "0.17.0")
    env["ZEPHYR_TOOLCHAIN_VARIANT"] = "cross-compile"
    assert toolchain.choose("nrf52840dk", env).environment["CROSS_COMPILE"] == str(
        gcc
    ).removesuffix("gcc")
    env["CROSS_COMPILE"] = str(program(tmp_path / "mine", "arm-gcc")).removesuffix("gcc")
    assert toolchain.choose("nrf52840dk", env).environment["CROSS_COMPILE"].endswith("mine/arm-")
    env["ZEPHYR_TOOLCHAIN_VARIANT"] = "gnuarmemb"
    assert toolchain.choose("nrf52840dk", env).environment == {
        "ZEPHYR_TOOLCHAIN_VARIANT": "gnuarmemb"
    }


def test_a_host_variant_does_not_break_the_board(tmp_path: Path, env: dict[str, str]) -> None:
    program(tmp_path / "bin", "arm-none-eabi-gcc")
    env["ZEPHYR_TOOLCHAIN_VARIANT"] = "host"
    assert toolchain.choose("nrf52840dk", env).variant == "cross-compile"


@pytest.mark.parametrize(
    ("user", "compiler", "variant"),
    [("", "gcc", "host"), ("zephyr", "gcc", "host"), ("llvm", "clang", "llvm")],
)
def test_the_simulated_board_takes_a_host_compiler(
    tmp_path: Path, env: dict[str, str], user: str, compiler: str, variant: str
) -> None:
    program(tmp_path / "bin", compiler)
    chosen = toolchain.choose("sim", {**env, "ZEPHYR_TOOLCHAIN_VARIANT": user})
    assert chosen.environment == {"ZEPHYR_TOOLCHAIN_VARIANT": variant}


def test_no_compiler_for_the_board(env: dict[str, str]) -> None:
    with pytest.raises(BuildError) as caught:
        toolchain.choose("nrf52840dk", env)
    assert "apt-get install gcc-arm-none-eabi" in caught.value.mend
    assert "west sdk install" in caught.value.mend


def test_no_sdk_where_the_user_wants_one(env: dict[str, str]) -> None:
    with pytest.raises(BuildError, match="no Zephyr SDK is installed"):
        toolchain.choose("nrf52840dk", {**env, "ZEPHYR_TOOLCHAIN_VARIANT": "zephyr"})


def test_a_wrong_prefix_is_named(env: dict[str, str]) -> None:
    wrong = {"ZEPHYR_TOOLCHAIN_VARIANT": "cross-compile", "CROSS_COMPILE": "/nowhere/arm-"}
    with pytest.raises(BuildError, match="/nowhere/arm-gcc"):
        toolchain.choose("nrf52840dk", {**env, **wrong})


def test_no_host_compiler(env: dict[str, str]) -> None:
    with pytest.raises(BuildError) as caught:
        toolchain.choose("sim", env)
    assert "apt-get install gcc-multilib" in caught.value.mend


def test_no_32_bit_host_library(tmp_path: Path, env: dict[str, str]) -> None:
    program(tmp_path / "bin", "gcc", WITHOUT_32_BIT)
    with pytest.raises(BuildError, match="libc-header-start") as caught:
        toolchain.choose("sim", {**env, "PATH": f"{env['PATH']}{os.pathsep}/bin"})
    assert "apt-get install gcc-multilib" in caught.value.mend
