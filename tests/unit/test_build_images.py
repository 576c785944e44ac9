# SPDX-License-Identifier: Apache-2.0
"""The whole of a build around west: what is run, what is kept, what is not done twice."""

from __future__ import annotations

import hashlib
import json
import shutil
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from hil.build import (
    BabbleSim,
    Workspace,
    build,
    build_images,
    footprint,
    images,
    job,
    manifest,
    toolchain,
    west,
)
from hil.errors import BuildError
from hil.process import Finished


@dataclass
class FakeWest:
    """Stands for the one function that starts programs: notes calls, leaves what a build leaves."""

    status: int = 0
    lines: tuple[str, ...] = (
        "[1/2] Building C object app/CMakeFiles/app.dir/src/main.c.obj",
        "[2/2] Linking C executable zephyr/zephyr.elf",
    )
    calls: list[tuple[list[str], dict[str, Any]]] = field(default_factory=list)

    def __call__(self, argv: Sequence[str], **options: Any) -> Finished:
        self.calls.append((list(argv), options))
        folder = Path(argv[argv.index("--build-dir") + 1])
        (folder / "zephyr").mkdir(parents=True, exist_ok=True)
        for name in ("zephyr.exe", "zephyr.hex"):
            (folder / "zephyr" / name).write_text(f"image {len(self.calls)}")
        (folder / "zephyr" / "zephyr.elf").write_bytes(elf())
        (folder / "zephyr" / ".config").write_text("CONFIG_FLASH_SIZE=1024\nCONFIG_SRAM_SIZE=256\n")
        for line in self.lines:
            options["on_line"](line)
        return Finished(tuple(argv), self.status, self.lines, 0.1)

    @property
    def argv(self) -> list[str]:
        return self.calls[-1][0]


def elf() -> bytes:
    """A 32-bit ELF file: 0x1000 B of code, 0x40 B of data (kept in flash, used in RAM) and
    0x300 B of zeroed memory behind it."""
    code, data = 0x1000, 0x40
    header = struct.pack(
        "<16sHHIIIIIHHHHHH",
        b"\x7fELF\x01\x01\x01".ljust(16, b"\0"),
        *(2, 40, 1, 0, 52, 52 + 64, 0, 52, 32, 2, 40, 4, 3),
    )
    segments = struct.pack("<8I", 1, 0, 0, 0, code, code, 5, 4) + struct.pack(
        "<8I", 1, 0, 0x2000_0000, code, data, data + 0x300, 6, 4
    )
    names = b"\0.text\0.data\0.bss\0.shstrtab\0"
    sections = b"".join(
        [
            bytes(40),
            struct.pack("<10I", 7, 8, 3, 0x2000_0000, 0, data, 0, 0, 4, 0),
            struct.pack("<10I", 13, 8, 3, 0x2000_0000 + data, 0, 0x300, 0, 0, 4, 0),
            struct.pack("<10I", 18, 3, 0, 0, 52 + 64 + 160, len(names), 0, 0, 1, 0),
        ]
    )
    return header + segments + sections + names


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with both applications; workspace, simulator and compiler are found at once."""
    root = tmp_path / "checkout"
    for role in ("leader", "follower"):
        app = root / "firmware" / "apps" / role
        (app / "src").mkdir(parents=True)
        (app / "CMakeLists.txt").write_text("project(x)\n")
        (app / "src" / "main.c").write_text(f"/* {role} */\n")
    top = tmp_path / "ws"
    workspace = Workspace(top, top / "zephyr", "4.1.0", "the test")
    monkeypatch.setattr(job, "find_workspace", lambda explicit: workspace)
    simulator = BabbleSim(top / "tools" / "bsim", top / "tools" / "bsim" / "components")
    monkeypatch.setattr(images, "find_babblesim", lambda found: simulator)
    monkeypatch.setattr(
        toolchain,
        "choose",
        lambda target: toolchain.Toolchain("fake", "fake 1.0", {"VARIANT": "f"}),
    )
    monkeypatch.setattr(west, "check_host_tools", lambda path: None)
    return root


@pytest.fixture
def fake_west(place: Path, monkeypatch: pytest.MonkeyPatch) -> FakeWest:
    fake = FakeWest()
    monkeypatch.setattr(images, "run", fake)
    return fake


def test_what_is_run_and_where(place: Path, fake_west: FakeWest) -> None:
    made = build("leader", "sim", root=place)
    argv, options = fake_west.calls[0]
    folder = place / "build" / "firmware" / "sim" / "leader"
    app = place / "firmware" / "apps" / "leader"
    assert argv == west.arguments(app, folder, "sim", int(made.build_id, 16), {})
    top = place.parent / "ws"
    assert options["cwd"] == top
    environment = options["env"]
    assert environment["ZEPHYR_BASE"] == str(top / "zephyr")
    assert environment["VARIANT"] == "f"
    assert environment["BSIM_OUT_PATH"] == str(top / "tools" / "bsim")


def test_the_manifest_of_a_simulated_image(place: Path, fake_west: FakeWest) -> None:
    made = build("leader", "sim", {"BV_CONN_INTERVAL": 24}, root=place)
    saved = json.loads((made.folder / manifest.MANIFEST_NAME).read_text())
    assert saved == made.to_mapping()
    assert saved["kconfig"] == {"BV_CONN_INTERVAL": 24}
    assert saved["board"] == "nrf52_bsim"
    assert saved["zephyr_version"] == "4.1.0"
    assert saved["toolchain"] == "fake 1.0"
    assert saved["git"]["state"] == "unknown"
    assert saved["flash_bytes"] is None
    assert saved["files"]["exe"] == {
        "path": "zephyr/zephyr.exe",
        "sha256": hashlib.sha256(b"image 1").hexdigest(),
        "size": 7,
    }
    assert made.file("exe").read_text() == "image 1"
    assert str(place) not in json.dumps(saved)


def test_the_manifest_of_a_board_image_has_flash_and_ram(
    place: Path, fake_west: FakeWest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("BSIM_OUT_PATH", raising=False)
    made = build("follower", "nrf52840dk", root=place)
    assert set(made.files) == {"hex", "elf"}
    assert (made.flash_bytes, made.flash_total_bytes) == (0x1040, 1024 * 1024)
    assert (made.ram_bytes, made.ram_total_bytes) == (0x340, 256 * 1024)
    assert "BSIM_OUT_PATH" not in fake_west.calls[0][1]["env"]


def test_what_compilers_keep_for_a_moment_is_gone_after_the_build(
    place: Path, fake_west: FakeWest
) -> None:
    build("leader", "sim", root=place)
    temporary = Path(fake_west.calls[0][1]["env"]["TMPDIR"])
    assert temporary.name.startswith("hil-build-")
    assert not temporary.exists()


def test_a_disk_that_keeps_nothing_of_cmake_ends_the_build(
    place: Path, fake_west: FakeWest
) -> None:
    again = "[0/1] Re-running CMake..."
    fake_west.lines = (again, *fake_west.lines)
    build("leader", "sim", {"A": 1})
    fake_west.lines = (again, again)
    with pytest.raises(BuildError, match="runs CMake again and again") as caught:
        build("leader", "sim", {"A": 2})
    assert "df -h" in caught.value.mend


def test_nothing_changed_is_said_and_quick(place: Path, fake_west: FakeWest) -> None:
    first = build("leader", "sim", root=place)
    said: list[str] = []
    start_s = time.monotonic()
    again = build("leader", "sim", {}, lambda share, what: said.append(what), root=place)
    assert time.monotonic() - start_s < 3
    assert len(fake_west.calls) == 1
    assert again.unchanged
    assert not first.unchanged
    assert said[-1] == "leader for sim: unchanged"
    assert again.to_mapping() == first.to_mapping()


def edit_source(root: Path, folder: Path) -> None:
    (root / "firmware" / "apps" / "leader" / "src" / "main.c").write_text("/* new */\n")


def damage_output(root: Path, folder: Path) -> None:
    (folder / "zephyr" / "zephyr.exe").write_text("image X")


def delete_output(root: Path, folder: Path) -> None:
    (folder / "zephyr" / "zephyr.elf").unlink()


def cut_manifest(root: Path, folder: Path) -> None:
    path = folder / manifest.MANIFEST_NAME
    path.write_text(path.read_text()[:100])


def older_manifest(root: Path, folder: Path) -> None:
    path = folder / manifest.MANIFEST_NAME
    path.write_text(json.dumps({"format": 0}))


@pytest.mark.parametrize(
    "change", [edit_source, damage_output, delete_output, cut_manifest, older_manifest]
)
def test_a_change_is_seen(place: Path, fake_west: FakeWest, change: Any) -> None:
    first = build("leader", "sim", root=place)
    change(place, first.folder)
    again = build("leader", "sim", root=place)
    assert len(fake_west.calls) == 2
    assert not again.unchanged
    assert (again.build_id != first.build_id) == (change is edit_source)


def test_another_compiler_is_seen(
    place: Path, fake_west: FakeWest, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = build("leader", "sim", root=place)
    other = toolchain.Toolchain("fake", "fake 2.0", {})
    monkeypatch.setattr(toolchain, "choose", lambda target: other)
    again = build("leader", "sim", root=place)
    assert not again.unchanged
    assert again.build_id == first.build_id


def test_a_source_saved_while_the_compiler_ran_is_not_taken_for_built(
    place: Path, fake_west: FakeWest, monkeypatch: pytest.MonkeyPatch
) -> None:
    def edited_meanwhile(argv: Sequence[str], **options: Any) -> Finished:
        if not fake_west.calls:
            edit_source(place, Path())
        return fake_west(argv, **options)

    monkeypatch.setattr(images, "run", edited_meanwhile)
    build("leader", "sim", root=place)
    assert not build("leader", "sim", root=place).unchanged
    assert build("leader", "sim", root=place).unchanged


def test_roles_targets_and_variants_do_not_share_a_folder(place: Path, fake_west: FakeWest) -> None:
    variants: list[tuple[str, str, dict[str, Any]]] = [
        ("leader", "sim", {}),
        ("leader", "sim", {"BV_CONN_INTERVAL": 24}),
        ("leader", "sim", {"BV_CONN_INTERVAL": 6}),
        ("leader", "nrf52840dk", {}),
        ("follower", "sim", {}),
    ]
    for role, target, kconfig in variants:
        build(role, target, kconfig, root=place)
    assert all(build(*variant, root=place).unchanged for variant in variants)
    assert len(fake_west.calls) == len(variants)
    assert job.folder_name("leader", {"A": True}) == job.folder_name("leader", {"A": "y"})


def test_a_folder_of_another_zephyr_or_compiler_is_built_afresh(
    place: Path, fake_west: FakeWest
) -> None:
    folder = build("leader", "sim", root=place).folder
    cache = folder / "CMakeCache.txt"
    zephyr = place.parent / "ws" / "zephyr"
    good = f"ZEPHYR_BASE:PATH={zephyr}\nZEPHYR_TOOLCHAIN_VARIANT:STRING=fake\n"
    for text, pristine in {
        good: "auto",
        good.replace(str(zephyr), "/elsewhere"): "always",
        good.replace("=fake", "=host"): "always",
    }.items():
        cache.write_text(text)
        edit_source(place, folder)
        damage_output(place, folder)
        build("leader", "sim", root=place)
        assert fake_west.argv[fake_west.argv.index("--pristine") + 1] == pristine


def test_a_failed_build_shows_the_compiler_and_leaves_no_manifest(
    place: Path, fake_west: FakeWest
) -> None:
    fake_west.status = 1
    fake_west.lines = (
        "-- configuring",
        "FAILED: main.c.obj",
        "main.c:1:1: error: unknown type name 'itn'",
    )
    with pytest.raises(BuildError) as caught:
        build("leader", "sim", root=place)
    assert "unknown type name 'itn'" in caught.value.message
    assert "configuring" not in caught.value.message
    folder = place / "build" / "firmware" / "sim" / "leader"
    assert str(folder / images.LOG_NAME) in caught.value.mend
    assert "configuring" in (folder / images.LOG_NAME).read_text()
    assert manifest.load(folder) is None


def test_progress_rises_to_one(place: Path, fake_west: FakeWest) -> None:
    shares: list[float] = []
    made = build_images({}, "sim", progress=lambda share, what: shares.append(share), root=place)
    assert set(made) == {"leader", "follower"}
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0


def test_each_role_gets_its_own_options(place: Path, fake_west: FakeWest) -> None:
    made = build_images({"leader": {"BV_CONN_INTERVAL": 24}}, "sim", root=place)
    assert made["leader"].kconfig == {"BV_CONN_INTERVAL": 24}
    assert made["follower"].kconfig == {}


def test_warnings_of_files_not_compiled_again_are_kept(place: Path, fake_west: FakeWest) -> None:
    main = place / "firmware" / "apps" / "leader" / "src" / "main.c"
    quiet = fake_west.lines
    fake_west.lines = (*quiet, f"{main}:1:1: warning: unused variable 'x'")
    assert build("leader", "sim", root=place).warnings == (
        "firmware/apps/leader/src/main.c:1: unused variable 'x'",
    )
    fake_west.lines = ("[1/1] Linking C executable zephyr/zephyr.elf",)
    (place / "firmware" / "other.h").write_text("")
    time.sleep(0.01)
    kept = build("leader", "sim", root=place)
    assert len(kept.warnings) == 1
    edit_source(place, kept.folder)
    fake_west.lines = quiet
    assert build("leader", "sim", root=place).warnings == ()


def test_two_builds_of_one_image_take_turns(
    place: Path, fake_west: FakeWest, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = threading.Event()
    go_on = threading.Event()
    said: list[str] = []

    def slow(argv: Sequence[str], **options: Any) -> Finished:
        running.set()
        assert go_on.wait(10)
        return fake_west(argv, **options)

    monkeypatch.setattr(images, "run", slow)
    first = threading.Thread(target=build, args=("leader", "sim"), kwargs={"root": place})
    first.start()
    assert running.wait(10)

    def note(share: float, what: str) -> None:
        said.append(what)
        if "waiting" in what:
            go_on.set()

    second = build("leader", "sim", {}, note, root=place)
    first.join()
    assert "leader for sim: waiting for another build" in said
    assert second.unchanged
    assert len(fake_west.calls) == 1


def test_unknown_images_are_refused(place: Path, fake_west: FakeWest) -> None:
    with pytest.raises(BuildError, match="no image 'referee'"):
        build("referee", "sim", root=place)
    with pytest.raises(BuildError, match="for 'pdp11'"):
        build("leader", "pdp11", root=place)
    shutil.rmtree(place / "firmware" / "apps" / "leader")
    with pytest.raises(BuildError, match="no application"):
        build("leader", "sim", root=place)
    assert fake_west.calls == []


def test_footprint_of_a_file_that_is_no_elf(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("not an elf")
    (tmp_path / ".config").touch()
    with pytest.raises(BuildError, match="not an ELF file"):
        footprint.measure(tmp_path / "x", tmp_path / ".config")
    (tmp_path / "x").write_bytes(elf())
    with pytest.raises(BuildError, match="does not set CONFIG_FLASH_SIZE"):
        footprint.measure(tmp_path / "x", tmp_path / ".config")
