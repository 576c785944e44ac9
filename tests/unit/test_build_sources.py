# SPDX-License-Identifier: Apache-2.0
"""The build id: equal for equal inputs, different for different ones, blind to the rest."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from hil.build import sources

VERSION = "4.1.0"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    root = tmp_path / "checkout"
    for name, text in {
        "firmware/apps/leader/src/main.c": "int main(void) { return 0; }\n",
        "firmware/apps/leader/prj.conf": "CONFIG_BT=y\n",
        "firmware/lib/wire/wire.h": "#define X 1\n",
        "firmware/west.yml": "manifest:\n",
        "boards/pins.dtsi": "/ {};\n",
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def test_equal_sources_elsewhere_and_later_give_the_same_id(tmp_path: Path, checkout: Path) -> None:
    copy = shutil.copytree(checkout, tmp_path / "copy")
    for path in copy.rglob("*"):
        if path.is_file():
            path.touch()
    first = sources.build_id(checkout, {"A": 1, "B": "y"}, VERSION)
    assert sources.build_id(copy, {"B": "y", "A": 1}, VERSION) == first
    assert 0 < first < 2**64


def rename(root: Path) -> None:
    (root / "boards/pins.dtsi").rename(root / "boards/other.dtsi")


def move_a_line(root: Path) -> None:
    """The same bytes in all, but not in the same files."""
    conf, main = root / "firmware/apps/leader/prj.conf", root / "firmware/apps/leader/src/main.c"
    conf.write_text(conf.read_text() + main.read_text())
    main.write_text("")


@pytest.mark.parametrize(
    "change",
    [
        lambda root: (root / "firmware/apps/leader/src/main.c").write_text("int main(void);\n"),
        lambda root: (root / "boards/pins.dtsi").write_text("/ { };\n"),
        lambda root: (root / "firmware/lib/new.c").write_text(""),
        lambda root: (root / "firmware/lib/wire/wire.h").unlink(),
        rename,
        move_a_line,
    ],
)
def test_any_change_of_the_sources_changes_the_id(
    checkout: Path, change: Callable[[Path], object]
) -> None:
    before = sources.build_id(checkout, {}, VERSION)
    change(checkout)
    assert sources.build_id(checkout, {}, VERSION) != before


@pytest.mark.parametrize("other", [{"A": 2}, {"A": 1, "B": 1}, {"A": "1"}, {}])
def test_other_options_change_the_id(checkout: Path, other: dict[str, int]) -> None:
    assert sources.build_id(checkout, {"A": 1}, VERSION) != sources.build_id(
        checkout, other, VERSION
    )


def test_another_zephyr_changes_the_id(checkout: Path) -> None:
    assert sources.build_id(checkout, {}, "4.1.0") != sources.build_id(checkout, {}, "4.1.1")


@pytest.mark.parametrize(
    "name",
    [
        "firmware/README.md",
        "firmware/tests/sync/main.c",
        "firmware/.cache/x.c",
        "firmware/apps/leader/build/x.c",
        "boards/bench.toml",
        "hil/new.py",
    ],
)
def test_what_is_no_source_of_the_image_does_not_count(checkout: Path, name: str) -> None:
    before = sources.build_id(checkout, {}, VERSION)
    (checkout / name).parent.mkdir(parents=True, exist_ok=True)
    (checkout / name).write_text("x")
    assert sources.build_id(checkout, {}, VERSION) == before


def test_git_state_follows_the_firmware(checkout: Path) -> None:
    assert sources.git_state(checkout) == sources.GitState("", "unknown")
    git = ["git", "-C", str(checkout), "-c", "user.name=x", "-c", "user.email=x@x"]
    subprocess.run([*git, "init", "-q"], check=True)
    assert sources.git_state(checkout).state == "dirty"
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-q", "-m", "x"], check=True)
    clean = sources.git_state(checkout)
    assert clean.state == "clean"
    assert len(clean.commit) == 40
    (checkout / "README.md").write_text("beside the firmware")
    assert sources.git_state(checkout) == clean
    (checkout / "firmware" / "west.yml").write_text("changed")
    assert sources.git_state(checkout) == sources.GitState(clean.commit, "dirty")


def test_this_checkout_has_sources() -> None:
    root = sources.project_root()
    names = {path.relative_to(root).as_posix() for path in sources.source_files(root)}
    assert {"firmware/apps/leader/prj.conf", "firmware/lib/wire/wire.h", "boards/pins.dtsi"} <= (
        names
    )
