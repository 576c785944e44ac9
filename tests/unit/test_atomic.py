# SPDX-License-Identifier: Apache-2.0
"""A file is there whole or not at all, whatever stops its writer."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil.atomic import write_whole

OLD, NEW = b"old" * 10, b"new" * 1000


def test_it_makes_folders_and_replaces_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "file"
    write_whole(path, OLD)
    assert path.read_bytes() == OLD
    write_whole(path, NEW)
    assert path.read_bytes() == NEW
    assert list(path.parent.iterdir()) == [path]


def test_others_may_read_it_as_the_umask_says(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "file", NEW)
        assert os.umask(0o027) == 0o027
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


@pytest.mark.parametrize("where", ["fsync", "replace"])
@pytest.mark.parametrize("what", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_a_stop_on_the_way_leaves_the_old_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, what: Any
) -> None:
    path = tmp_path / "file"
    path.write_bytes(OLD)

    def stop(*_: object) -> None:
        raise what

    monkeypatch.setattr(os, where, stop)
    with pytest.raises((KeyboardInterrupt, OSError)):
        write_whole(path, NEW)
    assert path.read_bytes() == OLD
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_writer_left_goes_after_an_hour(tmp_path: Path) -> None:
    path = tmp_path / "file"
    names = (".file.0123abcd", ".file.89abcdef", ".file.toml", ".other.01234567")
    for name in names:
        (tmp_path / name).write_bytes(OLD)
        os.utime(tmp_path / name, (time.time() - 3700,) * 2)
    os.utime(tmp_path / names[1])
    write_whole(path, NEW)
    assert {p.name for p in tmp_path.iterdir()} == {"file", *names[1:]}


def test_data_is_on_the_disk_before_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a power cut a name without its data would be half of a file."""
    calls: list[str] = []
    fsync, replace = os.fsync, os.replace

    def note_fsync(fd: int) -> None:
        calls.append("folder" if stat.S_ISDIR(os.fstat(fd).st_mode) else "file")
        assert calls[-1] == "folder" or os.fstat(fd).st_size == len(NEW)
        fsync(fd)

    def note_replace(source: str, target: Path) -> None:
        calls.append("name")
        replace(source, target)

    monkeypatch.setattr(os, "fsync", note_fsync)
    monkeypatch.setattr(os, "replace", note_replace)
    write_whole(tmp_path / "file", NEW)
    assert calls == ["file", "name", "folder"]


def test_no_reader_and_no_kill_finds_half_of_it(tmp_path: Path) -> None:
    path = tmp_path / "file"
    sizes = (1_000_000, 3_000_000)
    code = (
        "import itertools, sys; from pathlib import Path; from hil.atomic import write_whole\n"
        f"for size in itertools.cycle({sizes}): write_whole(Path(sys.argv[1]), bytes(size))"
    )
    writer = subprocess.Popen([sys.executable, "-c", code, str(path)])
    try:
        deadline_s = time.monotonic() + 20.0
        seen = set()
        while len(seen) < 2 and time.monotonic() < deadline_s:
            if path.exists():
                seen.add(len(path.read_bytes()))
        assert seen == set(sizes)
    finally:
        writer.send_signal(signal.SIGKILL)
        writer.wait()
    assert path.stat().st_size in sizes


@pytest.mark.parametrize("kind", ["a folder", "below a file", "name too long"])
def test_what_cannot_be_written_is_an_oserror(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "there"
    if kind == "a folder":
        path.mkdir()
    elif kind == "below a file":
        path.write_bytes(OLD)
        path = path / "file"
    else:
        path = tmp_path / ("n" * 300)
    with pytest.raises(OSError, match=r"."):
        write_whole(path, NEW)
    assert [p.name for p in tmp_path.iterdir()] == ([] if kind == "name too long" else ["there"])


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_file_is_not_replaced(tmp_path: Path, make: Callable[[Path], None]) -> None:
    """As root a rename would put a file in the place of /dev/null."""
    make(tmp_path / "out")
    before = (tmp_path / "out").stat().st_ino
    with pytest.raises(PermissionError, match="no file"):
        write_whole(tmp_path / "out", b"x")
    assert (tmp_path / "out").stat().st_ino == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
