# SPDX-License-Identifier: Apache-2.0
"""Which workspace is used, and what is said when there is none or the wrong one."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from hil.build import find_babblesim, find_workspace
from hil.build.bsim import BINARIES
from hil.errors import BuildError

ROOT = Path(__file__).parents[2]


def make_zephyr(folder: Path, version: str = "4.1.0") -> Path:
    major, minor, patch = version.split(".")
    (folder / "cmake").mkdir(parents=True)
    (folder / "VERSION").write_text(
        f"VERSION_MAJOR = {major}\nVERSION_MINOR = {minor}\nPATCHLEVEL = {patch}\n"
        "VERSION_TWEAK = 0\nEXTRAVERSION =\n"
    )
    return folder


def make_workspace(top: Path, version: str = "4.1.0", zephyr: str = "zephyr") -> Path:
    make_zephyr(top / zephyr, version)
    (top / ".west").mkdir()
    (top / ".west" / "config").write_text(
        f"[manifest]\npath = {zephyr}\nfile = west.yml\n\n[zephyr]\nbase = {zephyr}\n"
    )
    return top


def make_babblesim(folder: Path) -> Path:
    for name in BINARIES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    (folder / "components" / "ext_2G4_phy_v1").mkdir(parents=True)
    (folder / "components" / "ext_2G4_phy_v1" / "version").write_text("2.5\n")
    return folder


def test_the_order_of_the_places(tmp_path: Path) -> None:
    """Each place is found once those before it are taken away."""
    explicit = make_workspace(tmp_path / "explicit")
    from_env = make_workspace(tmp_path / "env")
    around = make_workspace(tmp_path / "around")
    inside = around / "some" / "project"
    inside.mkdir(parents=True)
    home = tmp_path / "home"
    at_home = make_workspace(home / "zephyrproject")
    everything = {"ZEPHYR_BASE": str(from_env / "zephyr"), "HOME": str(home)}
    only_home = {"HOME": str(home)}

    found = [
        find_workspace(explicit, env=everything, start=inside),
        find_workspace(None, env=everything, start=inside),
        find_workspace(None, env=only_home, start=inside),
        find_workspace(None, env=only_home, start=tmp_path),
    ]
    assert [w.path for w in found] == [explicit, from_env, around, at_home]
    assert [w.zephyr_base for w in found] == [p.path / "zephyr" for p in found]
    assert [w.found_by for w in found] == [
        "--workspace",
        "ZEPHYR_BASE",
        "the enclosing west workspace",
        "~/zephyrproject",
    ]
    assert {w.version for w in found} == {"4.1.0"}


def test_the_workspace_may_be_named_by_its_zephyr_folder(tmp_path: Path) -> None:
    top = make_workspace(tmp_path / "ws")
    assert find_workspace(top / "zephyr", env={}).path == top


def test_zephyr_may_lie_where_the_config_says(tmp_path: Path) -> None:
    top = make_workspace(tmp_path / "ws", zephyr="deps/zephyr")
    assert find_workspace(top, env={}).zephyr_base == top / "deps" / "zephyr"


def test_a_workspace_without_config_is_enough(tmp_path: Path) -> None:
    make_zephyr(tmp_path / "ws" / "zephyr")
    assert find_workspace(tmp_path / "ws", env={}).path == tmp_path / "ws"


def test_none_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(BuildError) as caught:
        find_workspace(None, env={"HOME": str(tmp_path)}, start=tmp_path)
    assert caught.value.message == "no Zephyr workspace was found"
    assert "west init -l firmware && west update" in caught.value.mend
    assert "--workspace" in caught.value.mend


@pytest.mark.parametrize("place", ["--workspace", "ZEPHYR_BASE"])
def test_a_named_place_that_is_wrong_is_not_passed_over(tmp_path: Path, place: str) -> None:
    make_workspace(tmp_path / "zephyrproject")
    env = {"HOME": str(tmp_path)}
    explicit = None
    if place == "--workspace":
        explicit = tmp_path / "empty"
    else:
        env["ZEPHYR_BASE"] = str(tmp_path / "empty")
    with pytest.raises(BuildError, match="empty") as caught:
        find_workspace(explicit, env=env, start=tmp_path)
    assert place in caught.value.message


@pytest.mark.parametrize("version", ["3.7.1", "4.0.0", "4.2.0"])
def test_another_zephyr_is_refused_with_the_mend(tmp_path: Path, version: str) -> None:
    top = make_workspace(tmp_path / "ws", version)
    with pytest.raises(BuildError) as caught:
        find_workspace(top, env={})
    assert f"holds Zephyr {version}; the firmware is written for Zephyr 4.1" in caught.value.message
    assert "checkout v4.1.0 && west update" in caught.value.mend


@pytest.mark.parametrize("damage", ["VERSION", "config"])
def test_damaged_files_are_named(tmp_path: Path, damage: str) -> None:
    top = make_workspace(tmp_path / "ws")
    if damage == "VERSION":
        (top / "zephyr" / "VERSION").write_text("VERSION_MAJOR = four\n")
    else:
        (top / ".west" / "config").write_text("no section\n")
    with pytest.raises(BuildError, match=damage):
        find_workspace(top, env={})


def test_babblesim_in_the_workspace(tmp_path: Path) -> None:
    top = make_workspace(tmp_path / "ws")
    folder = make_babblesim(top / "tools" / "bsim")
    found = find_babblesim(find_workspace(top, env={}), env={})
    assert found.phy == folder / "bin" / "bs_2G4_phy_v1"
    assert found.version() == "2.5"
    assert found.environment == {
        "BSIM_OUT_PATH": str(folder),
        "BSIM_COMPONENTS_PATH": str(folder / "components"),
    }


def test_babblesim_named_in_the_environment_wins(tmp_path: Path) -> None:
    top = make_workspace(tmp_path / "ws")
    make_babblesim(top / "tools" / "bsim")
    other = make_babblesim(tmp_path / "other")
    env = {"BSIM_OUT_PATH": str(other)}
    assert find_babblesim(find_workspace(top, env={}), env=env).output == other


def test_babblesim_not_fetched(tmp_path: Path) -> None:
    top = make_workspace(tmp_path / "ws")
    with pytest.raises(BuildError) as caught:
        find_babblesim(find_workspace(top, env={}), env={})
    assert "group-filter -- +babblesim && west update" in caught.value.mend


@pytest.mark.parametrize("name", BINARIES)
def test_babblesim_not_built(tmp_path: Path, name: str) -> None:
    top = make_workspace(tmp_path / "ws")
    folder = make_babblesim(top / "tools" / "bsim")
    (folder / name).unlink()
    with pytest.raises(BuildError, match=name) as caught:
        find_babblesim(find_workspace(top, env={}), env={})
    assert f"make -C {folder} everything" in caught.value.mend


def test_the_manifest_pins_the_release_that_is_required() -> None:
    yaml = pytest.importorskip("yaml", reason="python -m pip install -e '.[build]'")
    data = yaml.safe_load((ROOT / "firmware" / "west.yml").read_text(encoding="utf-8"))
    (zephyr,) = data["manifest"]["projects"]
    assert zephyr["name"] == "zephyr"
    assert zephyr["revision"] == "v4.1.0"
    assert "+babblesim" in data["manifest"]["group-filter"]
    wanted = set(zephyr["import"]["name-allowlist"])
    assert {"hal_nordic", "nrf_hw_models", "bsim", "babblesim_base"} <= wanted


def test_zephyr_commit_of_a_git_checkout(tmp_path: Path) -> None:
    top = make_workspace(tmp_path / "ws")
    assert find_workspace(top, env={}).zephyr_commit() == ""
    git = ["git", "-C", str(top / "zephyr"), "-c", "user.name=x", "-c", "user.email=x@x"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    assert len(find_workspace(top, env={}).zephyr_commit()) == 40
