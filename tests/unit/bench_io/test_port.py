# SPDX-License-Identifier: Apache-2.0
"""A serial port over pseudo-terminals: full speed, unplugged, replugged, taken by another."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.bench import port as port_module
from hil.bench.port import Chunk, SerialPort, holders
from hil.errors import RigError
from tests.unit.fake_line import Board, until


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    made = Board(tmp_path / "tty")
    yield made
    if made.master >= 0:
        os.close(made.master)


def take(port: SerialPort, count: int, limit_s: float = 60.0) -> bytes:
    got = bytearray()
    deadline_s = time.monotonic() + limit_s
    while len(got) < count and time.monotonic() < deadline_s:
        got += port.read_bytes(0.2)
    return bytes(got)


FEEDER = """
import hashlib, os, random, sys
fd, count = int(sys.argv[1]), int(sys.argv[2])
source = random.Random(1)
digest = hashlib.sha256()
while count:
    data = source.randbytes(min(count, 997))
    digest.update(data)
    count -= len(data)
    while data:
        data = data[os.write(fd, data):]
print(digest.hexdigest())
"""


def test_no_byte_is_lost_at_full_speed(board: Board, tmp_path: Path) -> None:
    """4 MB as fast as another process can write, which is faster than 1 Mbaud's 100 kB/s."""
    count = 4_000_000
    log = tmp_path / "log"
    with SerialPort(board.link, log=log) as port:
        begin_s = time.monotonic()
        with subprocess.Popen(
            [sys.executable, "-c", FEEDER, str(board.master), str(count)],
            pass_fds=[board.master],
            stdout=subprocess.PIPE,
            text=True,
        ) as feeder:
            got = take(port, count)
            assert feeder.stdout is not None
            expected = feeder.stdout.read().strip()
        rate = count / (time.monotonic() - begin_s)
    assert hashlib.sha256(got).hexdigest() == expected
    assert log.read_bytes() == got
    assert rate > 200_000
    assert port.gaps == []


def test_what_the_line_is_set_to(board: Board) -> None:
    with SerialPort(board.link):
        attributes = termios.tcgetattr(board.master)
        assert attributes[4] == attributes[5] == termios.B1000000
        assert attributes[2] & termios.CSIZE == termios.CS8
        assert not attributes[2] & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
        assert not attributes[0] & (termios.IXON | termios.IXOFF)


def test_chunks_carry_the_time_they_were_read(board: Board) -> None:
    with SerialPort(board.link) as port:
        assert port.read(0.05) == []
        before_ns = time.monotonic_ns()
        os.write(board.master, b"one")
        chunks: list[Chunk] = []
        until(lambda: chunks.extend(port.read(0.1)) or sum(len(c.data) for c in chunks) == 3)
        after_ns = time.monotonic_ns()
        assert b"".join(chunk.data for chunk in chunks) == b"one"
        times = [chunk.t_ns_host for chunk in chunks]
        assert [before_ns, *times, after_ns] == sorted([before_ns, *times, after_ns])


def test_bytes_go_the_other_way_unchanged(board: Board) -> None:
    with SerialPort(board.link) as port:
        port.write(bytes(range(256)))
        got = b""
        while len(got) < 256:
            got += os.read(board.master, 256)
        assert got == bytes(range(256))


def test_a_port_that_comes_back_goes_on_and_the_gap_is_recorded(board: Board) -> None:
    with SerialPort(board.link, resolve=board.resolve) as port:
        os.write(board.master, b"before")
        assert take(port, 6) == b"before"
        unplugged_ns = time.monotonic_ns()
        board.unplug()
        time.sleep(0.3)
        board.plug_in()
        plugged_ns = time.monotonic_ns()
        until(lambda: port.gaps)
        os.write(board.master, b"after")
        assert take(port, 5) == b"after"
        (gap,) = port.gaps
        assert unplugged_ns <= gap.t_lost_ns < gap.t_back_ns
        assert gap.t_back_ns >= plugged_ns
        # And once more.
        board.unplug()
        board.plug_in()
        until(lambda: len(port.gaps) == 2)
        os.write(board.master, b"again")
        assert take(port, 5) == b"again"


def test_a_port_that_moves_is_followed_by_what_it_is(board: Board, tmp_path: Path) -> None:
    """Back under another path, while its old path is another board's."""
    where = {"path": str(board.link)}
    with SerialPort(board.link, resolve=lambda: where["path"]) as port:
        mine = Board(tmp_path / "tty2")
        where["path"] = str(mine.link)
        board.unplug()
        stranger = Board(board.link)
        until(lambda: port.gaps)
        os.write(stranger.master, b"stranger")
        os.write(mine.master, b"mine")
        assert take(port, 4) == b"mine"
        assert port.read(0.2) == []
        assert port.path == str(mine.link)
        stranger.unplug()
        mine.unplug()


def test_a_name_given_anew_while_opening_is_not_believed(board: Board, tmp_path: Path) -> None:
    """The path is another board's by the time that it is open."""
    other = Board(tmp_path / "tty2")
    answers = iter([str(other.link), str(board.link)])
    last = str(board.link)
    with SerialPort(board.link, resolve=lambda: next(answers, last)) as port:
        board.unplug()
        board.plug_in()
        until(lambda: port.gaps)
        assert port.path == str(board.link)
        os.write(other.master, b"other")
        os.write(board.master, b"board")
        assert take(port, 5) == b"board"
    other.unplug()


def test_a_port_that_stays_away_is_an_error(board: Board) -> None:
    with SerialPort(board.link, resolve=board.resolve, replug_limit_s=0.3) as port:
        os.write(board.master, b"last")
        until(lambda: port._waiting_bytes == len(b"last"))
        board.unplug()
        until(lambda: port._failure)
        assert port.read_bytes(1.0) == b"last"
        with pytest.raises(RigError, match=r"did not come back within 0\.3 s"):
            port.read(1.0)
        with pytest.raises(RigError, match="could not be sent"):
            port.write(b"x")


def test_a_port_that_nobody_can_find_again_is_an_error_at_once(board: Board) -> None:
    with SerialPort(board.link) as port:
        board.unplug()
        board.plug_in()
        with pytest.raises(RigError, match="the port was lost") as caught:
            port.read(5.0)
        assert "serial number" in caught.value.mend


@pytest.mark.parametrize(
    "error",
    [OSError(errno.EIO, "I/O error"), termios.error(errno.EIO, "I/O error")],
    ids=["EIO", "termios"],
)
def test_every_kind_of_unplugging_is_caught(
    board: Board, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """Which of them comes depends on what the reader was doing just then."""
    import serial  # noqa: PLC0415

    real = serial.Serial.in_waiting.fget
    raised: list[Exception] = []

    def in_waiting(self: serial.Serial) -> int:
        if not raised:
            raised.append(error)
            raise error
        return int(real(self))

    monkeypatch.setattr(serial.Serial, "in_waiting", property(in_waiting))
    with SerialPort(board.link, resolve=board.resolve) as port:
        until(lambda: port.gaps)
        os.write(board.master, b"on")
        assert take(port, 2) == b"on"


def test_nobody_reading_is_an_error_not_a_full_memory(board: Board) -> None:
    with SerialPort(board.link, queue_bytes_max=1000) as port:
        os.write(board.master, bytes(900))
        until(lambda: port._waiting_bytes == 900)
        os.write(board.master, bytes(200))
        until(lambda: port._failure)
        assert 900 <= len(port.read_bytes(1.0)) <= 1000
        with pytest.raises(RigError, match="1000 bytes wait and nobody takes them"):
            port.read(1.0)


def test_a_log_that_cannot_be_written(board: Board, tmp_path: Path) -> None:
    with pytest.raises(RigError, match="log cannot be written"):
        SerialPort(board.link, log=tmp_path / "no" / "log")
    full = Path("/dev/full")
    with SerialPort(board.link, log=full) as port:
        os.write(board.master, b"x")
        with pytest.raises(RigError, match="/dev/full: cannot be written"):
            port.read(5.0)


def test_a_missing_port() -> None:
    with pytest.raises(RigError, match="there is no such serial port"):
        SerialPort("/dev/ttyACM99")


def test_no_serial_port_at_all(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    with pytest.raises(RigError, match="cannot be opened as a serial port"):
        SerialPort(path)


def test_a_port_in_use_names_who_has_it(board: Board) -> None:
    code = (
        "import fcntl, sys, time; f = open(sys.argv[1], 'rb', 0);"
        "fcntl.flock(f, fcntl.LOCK_EX); print('locked', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(board.link)], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        assert any(f"({other.pid})" in who for who in holders(str(board.link)))
        with pytest.raises(RigError, match=rf"in use by .*\({other.pid}\)"):
            SerialPort(board.link)
        other.kill()


def test_an_open_port_is_locked(board: Board) -> None:
    with SerialPort(board.link):
        fd = os.open(board.link, os.O_RDWR | os.O_NOCTTY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(fd)


def test_a_port_without_permission(monkeypatch: pytest.MonkeyPatch, board: Board) -> None:
    """Played, because the tests may run as root, who may open everything."""

    def refuse(path: str, flags: int, *rest: object) -> int:
        raise OSError(errno.EACCES, "Permission denied", path)

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(RigError, match="permission denied") as caught:
        port_module.open_serial(str(board.link), 1_000_000)
    assert "dialout" in caught.value.mend


def test_closing_twice_is_no_harm_and_frees_the_port(board: Board) -> None:
    port = SerialPort(board.link)
    port.close()
    port.close()
    with SerialPort(board.link):
        pass
