# SPDX-License-Identifier: Apache-2.0
"""West's command line, and what is read from its output."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hil.build import west
from hil.errors import BuildError

SOURCE, FOLDER = Path("/src/firmware/apps/leader"), Path("/src/build/firmware/sim/leader")


def test_exact_command_line() -> None:
    kconfig = {
        "BV_CONN_INTERVAL": 24,
        "BV_FAULT_SKEW_SIGN": True,
        "BT_SMP": False,
        "BV_DIAG": "y",
        "BT_DEVICE_NAME": "my leader",
    }
    assert west.arguments(SOURCE, FOLDER, "sim", 0x00AB_CDEF_0123_4567, kconfig) == [
        *(sys.executable, "-m", "west", "build"),
        *("--board", "nrf52_bsim"),
        *("--build-dir", "/src/build/firmware/sim/leader"),
        *("--pristine", "auto"),
        "/src/firmware/apps/leader",
        "--",
        "-DBV_BUILD_ID=0x00abcdef01234567",
        '-DCONFIG_BT_DEVICE_NAME="my leader"',
        "-DCONFIG_BT_SMP=n",
        "-DCONFIG_BV_CONN_INTERVAL=24",
        "-DCONFIG_BV_DIAG=y",
        "-DCONFIG_BV_FAULT_SKEW_SIGN=y",
    ]


def test_the_real_board_and_a_fresh_folder() -> None:
    argv = west.arguments(SOURCE, FOLDER, "nrf52840dk", 1, {}, fresh=True)
    assert argv[argv.index("--board") + 1] == "nrf52840dk/nrf52840"
    assert argv[argv.index("--pristine") + 1] == "always"
    assert argv[-1] == "-DBV_BUILD_ID=0x0000000000000001"


@pytest.mark.parametrize(
    ("line", "share", "what"),
    [
        ("[1/4] Building C object zephyr/a.dir/src/main.c.obj", 0.3625, "building main.c"),
        ("[4/4] Linking C executable zephyr/zephyr.elf", 1.0, "linking zephyr.elf"),
    ],
)
def test_progress_from_ninja(line: str, share: float, what: str) -> None:
    assert west.progress_of(line) == (pytest.approx(share), what)


@pytest.mark.parametrize("line", ["-- Board: nrf52_bsim", "[0/0] x", "see [1/2] Building", ""])
def test_other_lines_are_no_progress(line: str) -> None:
    assert west.progress_of(line) is None


COMPILER_FAILED = """\
-- Board: nrf52_bsim
[1/9] Building C object app/CMakeFiles/app.dir/src/main.c.obj
FAILED: app/CMakeFiles/app.dir/src/main.c.obj
ccache /usr/bin/gcc -c main.c

/src/main.c: In function 'main':
/src/main.c:3:9: error: expected ';' before '}' token
ninja: build stopped: subcommand failed.
FATAL ERROR: command exited with status 1
""".splitlines()


def test_a_failed_compilation_shows_the_compilers_words() -> None:
    words = west.last_words(COMPILER_FAILED)
    assert words.startswith("    FAILED: app/CMakeFiles/app.dir/src/main.c.obj\n")
    assert "/src/main.c:3:9: error: expected ';' before '}' token" in words
    assert "Board:" not in words


def test_endless_command_lines_and_progress_are_left_out() -> None:
    lines = ["FAILED: a.obj", "gcc " + "-I/x " * 1000, "[2/9] Building C object b.obj", "a.c: why"]
    words = west.last_words(lines).splitlines()
    assert [len(line) < 220 for line in words] == [True] * 3
    assert words[1].endswith(" ...")
    assert words[2] == "    a.c: why"


def test_colours_do_not_hide_a_warning() -> None:
    coloured = "\x1b[01m\x1b[K/f/a.c:3:1:\x1b[m\x1b[K \x1b[01;35m\x1b[Kwarning: \x1b[m\x1b[Kx"
    assert west.plain(coloured) == "/f/a.c:3:1: warning: x"


def test_a_failed_configuration_shows_cmakes_words() -> None:
    lines = [*["-- fine"] * 200, "CMake Error at CMakeLists.txt:3 (message):", "  no such board"]
    assert west.last_words(lines).splitlines() == [f"    {line}" for line in lines[-2:]]


def test_an_unknown_failure_shows_the_end() -> None:
    lines = [f"line {n}" for n in range(200)]
    shown = west.last_words(lines).splitlines()
    assert len(shown) == west.LAST_WORDS_MAX
    assert shown[-1] == "    line 199"


def test_warnings_of_our_own_sources_are_counted_once(tmp_path: Path) -> None:
    own, top = tmp_path / "firmware", tmp_path
    lines = [
        f"{own}/lib/a.c:3:1: warning: unused variable 'x' [-Wunused-variable]",
        f"{own}/lib/a.h:9: warning: obsolete",
        f"{own}/lib/a.h:9: warning: obsolete",
        "/zephyr/kernel/sched.c:1:1: warning: not ours",
        f"warning: BV_X (defined at {own}/Kconfig:3) was assigned",
    ]
    assert west.warnings_in(lines, [own], top) == (
        "firmware/lib/a.c:3: unused variable 'x' [-Wunused-variable]",
        "firmware/lib/a.h:9: obsolete",
    )


def test_an_old_warning_holds_until_its_file_is_compiled_or_changed(tmp_path: Path) -> None:
    source = tmp_path / "firmware" / "a.c"
    source.parent.mkdir()
    source.touch()
    since_s = source.stat().st_mtime + 1
    old = "firmware/a.c:3: unused variable"
    other, same = "[1/2] Building C object x/b.c.obj", "[1/2] Building C object x/a.c.obj"
    assert west.still_valid(old, [other], tmp_path, since_s)
    assert not west.still_valid(old, [other, same], tmp_path, since_s)
    assert not west.still_valid(old, [other], tmp_path, since_s - 2)
    source.unlink()
    assert not west.still_valid(old, [other], tmp_path, since_s)


def test_missing_tools_are_named_with_their_packages(tmp_path: Path) -> None:
    (tmp_path / "cmake").touch(mode=0o755)
    with pytest.raises(BuildError) as caught:
        west.check_host_tools(str(tmp_path))
    assert caught.value.mend == (
        "apt-get install --no-install-recommends ninja-build device-tree-compiler"
    )


def test_missing_west_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(BuildError, match="west is not installed") as caught:
        west.check_host_tools(None)
    assert "pip install -e '.[build]'" in caught.value.mend
