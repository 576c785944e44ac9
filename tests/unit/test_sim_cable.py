# SPDX-License-Identifier: Apache-2.0
"""A cable between two terminals: all bytes, both ways, whoever is slow."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import stat
import threading
import time
from collections.abc import Iterator

import pytest

from hil.bench.port import SerialPort
from hil.simulator.cable import Cable

LIMIT_S = 60.0


@pytest.fixture
def cable() -> Iterator[Cable]:
    made = Cable()
    yield made
    made.close()


def send(path: str, data: bytes) -> threading.Thread:
    def run() -> None:
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        try:
            left = memoryview(data)
            # The cable may be closed before all is sent.
            with contextlib.suppress(OSError):
                while left:
                    left = left[os.write(fd, left[:5000]) :]
        finally:
            os.close(fd)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def receive(path: str, count: int, pause_s: float = 0.0) -> bytes:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    got = bytearray()
    deadline_s = time.monotonic() + LIMIT_S
    try:
        while len(got) < count and time.monotonic() < deadline_s:
            with contextlib.suppress(BlockingIOError):
                got += os.read(fd, 65536)
            time.sleep(pause_s)
    finally:
        os.close(fd)
    return bytes(got)


@pytest.mark.parametrize("way", ["in", "out"])
def test_all_bytes_pass_as_they_are(cable: Cable, way: str) -> None:
    """Every value, control characters of terminals among them."""
    near, far = (cable.outer, cable.inner) if way == "in" else (cable.inner, cable.outer)
    data = bytes(range(256)) * 40
    sender = send(near, data)
    assert receive(far, len(data)) == data
    sender.join(5.0)


def test_nothing_is_lost_with_a_slow_reader(cable: Cable) -> None:
    data = random.Random(1).randbytes(3_000_000)
    sender = send(cable.inner, data)
    time.sleep(0.3)
    # What nobody reads makes the sender wait.
    assert sender.is_alive()
    assert receive(cable.outer, len(data), pause_s=0.0002) == data
    sender.join(5.0)
    assert not sender.is_alive()


def test_both_ways_at_once(cable: Cable) -> None:
    there, back = random.Random(2).randbytes(500_000), random.Random(3).randbytes(400_000)
    got: dict[str, bytes] = {}
    readers = [
        threading.Thread(target=lambda: got.update(outer=receive(cable.outer, len(there)))),
        threading.Thread(target=lambda: got.update(inner=receive(cable.inner, len(back)))),
    ]
    for thread in readers:
        thread.start()
    for sender in (send(cable.inner, there), send(cable.outer, back)):
        sender.join(LIMIT_S)
    for thread in readers:
        thread.join(LIMIT_S)
    assert got == {"outer": there, "inner": back}


def test_one_way_blocked_does_not_block_the_other(cable: Cable) -> None:
    send(cable.inner, bytes(1_000_000))
    time.sleep(0.3)
    send(cable.outer, b"command")
    assert receive(cable.inner, 7) == b"command"


def test_users_come_and_go(cable: Cable) -> None:
    """As a board resets behind a debugger's port, and as a tool is started twice."""
    for number in range(3):
        data = f"boot {number}".encode()
        send(cable.inner, data).join(5.0)
        assert receive(cable.outer, len(data)) == data


def test_the_rigs_own_port_opens_it(cable: Cable) -> None:
    with SerialPort(cable.outer) as port:
        send(cable.inner, b"\x00\x01\x0d\x0a\x04\x00").join(5.0)
        got = b""
        deadline_s = time.monotonic() + 5.0
        while len(got) < 6 and time.monotonic() < deadline_s:
            got += port.read_bytes(0.2)
        assert got == b"\x00\x01\x0d\x0a\x04\x00"
        port.write(b"\x00\x11\x13\x03\x00")
        assert receive(cable.inner, 5) == b"\x00\x11\x13\x03\x00"


def test_an_idle_and_a_blocked_cable_use_no_processor(cable: Cable) -> None:
    for block in (False, True):
        if block:
            send(cable.inner, bytes(1_000_000))
            time.sleep(0.3)
        before = resource.getrusage(resource.RUSAGE_SELF)
        time.sleep(1.0)
        after = resource.getrusage(resource.RUSAGE_SELF)
        used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        assert used_s < 0.2, f"blocked: {block}"


def test_closing_leaves_nothing_even_when_blocked() -> None:
    made = Cable()
    fd = os.open(made.inner, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(fd, bytes(4096))
    # Two terminals have four ends; all are open, and the thread runs.
    assert [stat.S_ISCHR(os.fstat(end).st_mode) for end in made._fds] == [True] * 4
    assert made._thread.is_alive()
    begun_s = time.monotonic()
    made.close()
    assert time.monotonic() - begun_s < 2.0
    os.close(fd)
    assert not made._thread.is_alive()
    for end in made._fds:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(end)
