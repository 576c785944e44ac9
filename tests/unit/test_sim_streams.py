# SPDX-License-Identifier: Apache-2.0
"""The host's end of serial lines and pins: nothing lost, every byte and edge at its time."""

from __future__ import annotations

import os
import random
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hil.errors import RigError
from hil.recording import EDGE_CHANNELS, ClockModel, WanderTerm
from hil.simulator.pins import PinLog
from hil.simulator.serial_line import SerialLine
from hil.simulator.tail import Tail

CLOCK = ClockModel(drift=13.7e-6, start_offset_us=12345, wander=(WanderTerm(2e-7, 37.0, 0.5),))


@pytest.fixture
def line(tmp_path: Path) -> Iterator[SerialLine]:
    made = SerialLine(tmp_path / "times")
    yield made
    made.close()


def log(folder: Path, *records: tuple[int, int]) -> None:
    with (folder / "times").open("ab") as file:
        for record in records:
            file.write(struct.pack("<QQ", *record))


def send(line: SerialLine, data: bytes) -> None:
    fd = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
    while data:
        data = data[os.write(fd, data) :]
    os.close(fd)


def test_bursts_carry_their_times(line: SerialLine, tmp_path: Path) -> None:
    send(line, b"firstsecond")
    log(tmp_path, (5, 1000), (11, 2000))
    assert [(b.local_us, b.data) for b in line.bursts()] == [(1000, b"first"), (2000, b"second")]
    assert line.undelivered == 0
    assert list(line.bursts()) == []


def test_a_burst_waits_for_its_bytes_and_for_its_time(line: SerialLine, tmp_path: Path) -> None:
    send(line, b"abc")
    assert list(line.bursts()) == []
    log(tmp_path, (5, 1000))
    assert list(line.bursts()) == []
    assert line.undelivered == 5
    send(line, b"de")
    assert [b.data for b in line.bursts()] == [b"abcde"]


def test_a_record_that_is_half_written_waits(line: SerialLine, tmp_path: Path) -> None:
    send(line, b"abc")
    whole = struct.pack("<QQ", 3, 77)
    with (tmp_path / "times").open("ab") as file:
        file.write(whole[:9])
        file.flush()
        assert list(line.bursts()) == []
        file.write(whole[9:])
        file.flush()
        assert [(b.local_us, b.data) for b in line.bursts()] == [(77, b"abc")]


def test_signs_of_life_move_the_time_and_bring_no_bytes(line: SerialLine, tmp_path: Path) -> None:
    log(tmp_path, (0, 100_000), (0, 200_000))
    assert list(line.bursts()) == []
    assert line.local_us == 200_000
    assert line.undelivered == 0


def test_no_byte_value_is_changed_on_the_way(line: SerialLine, tmp_path: Path) -> None:
    """Terminals translate, echo and swallow some values unless told not to."""
    every = bytes(range(256)) * 3
    send(line, every)
    log(tmp_path, (len(every), 1))
    assert [b.data for b in line.bursts()] == [every]


def test_nothing_is_lost_at_full_speed(line: SerialLine, tmp_path: Path) -> None:
    """More than any buffer holds, so that the writer has to wait for the reader."""
    data = random.Random(1).randbytes(400_000)
    writer = threading.Thread(target=send, args=(line, data))
    writer.start()
    got = b""
    n = 0
    while len(got) < len(data):
        n = min(n + 3001, len(data))
        log(tmp_path, (n, n * 10))
        got += b"".join(b.data for b in line.bursts())
    writer.join()
    assert got == data


def pin_log(tmp_path: Path, role: str = "leader", clock: ClockModel = CLOCK) -> PinLog:
    return PinLog(tmp_path / "pins.csv", role, clock)


def test_pins_become_edges_on_the_bench_clock(tmp_path: Path) -> None:
    reader = pin_log(tmp_path, "follower")
    (tmp_path / "pins.csv").write_text(
        "time(microsecond),port,pin,level\n0,0,6,1\n1000000,1,2,1\n2000000,1,3,1\n2000500,1,3,0\n"
    )
    t_ns, channel, level = reader.changes()
    assert [EDGE_CHANNELS[c] for c in channel] == [
        "follower.radio_end",
        "follower.pulse",
        "follower.pulse",
    ]
    assert level.tolist() == [1, 1, 0]
    assert t_ns.dtype == np.int64
    # By hand: (2e6 + 12345) / (1 + 13.7e-6) us, less the 249 ns that the wander is ahead by then.
    assert t_ns[1] == pytest.approx((2_012_317.431 - 0.249) * 1e3, abs=2)
    np.testing.assert_allclose(CLOCK.local_us(t_ns * 1e-3), [1e6, 2e6, 2_000_500], atol=1e-3)


def test_a_line_that_is_half_written_waits(tmp_path: Path) -> None:
    reader = pin_log(tmp_path)
    path = tmp_path / "pins.csv"
    path.write_text("time(microsecond),port,pin,level\n100,1,3,1\n20")
    assert len(reader.changes()[0]) == 1
    with path.open("a") as file:
        file.write("0,1,3,0\n")
    assert reader.changes()[2].tolist() == [0]
    assert [part.tolist() for part in reader.changes()] == [[], [], []]
    reader.close()


def test_a_line_that_is_no_pin_change_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "pins.csv").write_text("100,1,three,1\n")
    with pytest.raises(RigError, match="three"):
        pin_log(tmp_path).changes()


def test_a_file_that_is_not_there_yet(tmp_path: Path) -> None:
    tail = Tail(tmp_path / "later")
    assert tail.read() == b""
    (tmp_path / "later").write_bytes(b"now")
    assert tail.read() == b"now"
    assert tail.read() == b""
    tail.close()
