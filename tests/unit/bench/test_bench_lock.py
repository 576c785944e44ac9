# SPDX-License-Identifier: Apache-2.0
"""One run at a time, with real processes; and a place of a labgrid coordinator."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.bench import lock, place
from hil.bench.errors import BenchBusyError
from hil.bench.inventory import Place
from tests.bench.fakes.programs import Programs, programs_on_path

HOLDER = """
import sys, time
from pathlib import Path
from hil.bench import lock
with lock.hold(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""

RACER = """
import os, sys, time
from pathlib import Path
from hil.bench import lock
from hil.bench.errors import BenchBusyError
bench, log = Path(sys.argv[1]), sys.argv[2]
while time.time() < float(sys.argv[3]):
    pass
for _ in range(60):
    try:
        with lock.hold(bench, wait_s=0.05):
            fd = os.open(log, os.O_WRONLY | os.O_APPEND)
            os.write(fd, f"in {os.getpid()}\\n".encode())
            time.sleep(0.001)
            os.write(fd, f"out {os.getpid()}\\n".encode())
            os.close(fd)
    except BenchBusyError:
        pass
"""


def start(code: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return tmp_path / "bench.toml"


@pytest.fixture
def holder(bench: Path):  # type: ignore[no-untyped-def]
    process = start(HOLDER, bench)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()


def test_two_processes_are_never_in_at_the_same_time(bench: Path, tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.touch()
    begin_s = time.time() + 1.5
    racers = [start(RACER, bench, log, begin_s) for _ in range(2)]
    for racer in racers:
        racer.communicate(timeout=60)
        assert racer.returncode == 0
    lines = [line.split() for line in log.read_text().splitlines()]
    # Strictly in, out, in, out, each pair by one process.
    assert [what for what, _ in lines] == ["in", "out"] * (len(lines) // 2)
    assert all(a[1] == b[1] for a, b in zip(lines[::2], lines[1::2], strict=True))
    # It was a race: both took turns.
    assert len({pid for _, pid in lines}) == 2


def test_a_second_run_is_told_who_has_the_bench(bench: Path, holder: subprocess.Popen[str]) -> None:
    with pytest.raises(BenchBusyError) as caught, lock.hold(bench):
        pass
    assert f"(pid {holder.pid}, " in caught.value.message
    assert os.uname().nodename in caught.value.message
    assert "for 0 s" in caught.value.message or "for 1 s" in caught.value.message
    assert f"kill {holder.pid}" in caught.value.mend


def test_waiting_ends_when_the_owner_does(bench: Path, holder: subprocess.Popen[str]) -> None:
    assert holder.stdin is not None
    said: list[str] = []

    def waiting(text: str) -> None:
        said.append(text)
        assert holder.stdin is not None
        holder.stdin.write("\n")
        holder.stdin.flush()

    with lock.hold(bench, wait_s=20, waiting=waiting):
        pass
    assert len(said) == 1
    assert f"pid {holder.pid}" in said[0]
    assert "up to 20 s" in said[0]


def test_waiting_has_a_limit(bench: Path, holder: subprocess.Popen[str]) -> None:
    start_s = time.monotonic()
    with pytest.raises(BenchBusyError), lock.hold(bench, wait_s=0.5):
        pass
    assert 0.4 < time.monotonic() - start_s < 5


def test_a_run_that_was_killed_holds_nothing(bench: Path, holder: subprocess.Popen[str]) -> None:
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert lock.lock_path(bench).exists()
    assert lock.owner_of(bench) is None
    with lock.hold(bench):
        owner = lock.owner_of(bench)
        assert owner is not None
        assert owner.pid == os.getpid()
    assert not lock.lock_path(bench).exists()


def test_a_file_that_its_owner_deletes_meanwhile_is_not_the_lock(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between opening and locking the owner before may end: what was opened has no name then."""
    opened = os.open
    late = []

    def open_then_lose(path: object, *arguments: int) -> int:
        fd = opened(path, *arguments)  # type: ignore[arg-type]
        if not late:
            late.append(path)
            lock.lock_path(bench).unlink()
        return fd

    monkeypatch.setattr(lock.os, "open", open_then_lose)
    with lock.hold(bench, wait_s=5):
        assert late
        owner = lock.owner_of(bench)
        assert owner is not None
        assert owner.pid == os.getpid()


def test_the_lock_ends_with_an_exception(bench: Path) -> None:
    with pytest.raises(KeyError), lock.hold(bench):
        raise KeyError
    assert lock.owner_of(bench) is None


@pytest.mark.parametrize("content", [b"", b"{", b'{"pid": "x"}', b"[1]", b"\xff" * 9000])
def test_a_damaged_lock_file_neither_blocks_nor_breaks(bench: Path, content: bytes) -> None:
    lock.lock_path(bench).write_bytes(content)
    assert lock.owner_of(bench) is None
    with lock.hold(bench):
        lock.lock_path(bench).write_bytes(content)
        owner = lock.owner_of(bench)
        assert owner is not None
        assert owner.user == "somebody"


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(BenchBusyError, match="cannot be written"), lock.hold(tmp_path / "no/b"):
        pass


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.9, "59 s"), (61, "1 min 1 s"), (7325, "2 h 2 min")]
)
def test_durations_are_read_at_a_glance(seconds: float, text: str) -> None:
    assert lock.duration(seconds) == text


# labgrid


@pytest.fixture
def labgrid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Programs:
    programs = programs_on_path(tmp_path / "bin", monkeypatch)
    programs.install("labgrid-client")
    return programs


def test_a_place_is_acquired_and_released(labgrid: Programs) -> None:
    with place.acquired(Place("desk")):
        assert labgrid.calls() == [["labgrid-client", "-p", "desk", "acquire"]]
    assert labgrid.calls()[1:] == [["labgrid-client", "-p", "desk", "release"]]


def test_a_place_is_released_after_an_exception(labgrid: Programs) -> None:
    with pytest.raises(KeyError), place.acquired(Place("desk")):
        raise KeyError
    assert labgrid.calls()[-1][-1] == "release"


def test_a_place_that_another_user_has_is_not_released(labgrid: Programs) -> None:
    said = "Error: Place desk is already acquired by other/h."
    labgrid.answer("labgrid-client", "acquire", said + "\n", status=1)
    with pytest.raises(BenchBusyError) as caught, place.acquired(Place("desk")):
        pass
    assert said in caught.value.message
    assert "labgrid-client who" in caught.value.mend
    assert len(labgrid.calls()) == 1


def test_the_client_may_lie_anywhere(labgrid: Programs, tmp_path: Path) -> None:
    other = Programs(tmp_path)
    other.install("my-client")
    with place.acquired(Place("desk", str(tmp_path / "my-client"))):
        pass
    assert [call[-1] for call in other.calls()] == ["acquire", "release"]
    assert labgrid.calls() == []


def test_a_missing_client_says_how_to_install_it(tmp_path: Path) -> None:
    with (
        pytest.raises(BenchBusyError, match="pip install labgrid"),
        place.acquired(Place("desk", str(tmp_path / "none"))),
    ):
        pass


def test_a_bench_of_this_machine_asks_nobody(labgrid: Programs) -> None:
    with place.acquired(None):
        pass
    assert labgrid.calls() == []


def test_the_owner_is_plain_json(bench: Path) -> None:
    with lock.hold(bench):
        data = json.loads(lock.lock_path(bench).read_text())
    assert data["pid"] == os.getpid()
