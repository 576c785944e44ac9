# SPDX-License-Identifier: Apache-2.0
"""Sources: a recording at a pace, a port that is pulled out, and the command from start to end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
import tty
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer.testing

from hil.cli import app
from hil.errors import RigError
from hil.live.page import Page
from hil.live.sources import Bytes, Feed, Port, Replay, named_ports
from hil.recording import Recording
from tests.unit.live.conftest import LIMIT_S, RECORDINGS, until


class Cable:
    """A serial port at ``link`` that can be pulled out and put back."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.plug_in()

    def plug_in(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(slave)
        self.link.symlink_to(os.ttyname(slave))
        os.close(slave)

    def unplug(self) -> None:
        self.link.unlink()
        os.close(self.master)
        self.master = -1

    def say(self, data: bytes) -> None:
        while data:
            data = data[os.write(self.master, data[:2048]) :]


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    made = Cable(tmp_path / "ttyACM7")
    yield made
    if made.master >= 0:
        os.close(made.master)


def test_a_replay_gives_every_byte_in_order(clean: Recording) -> None:
    got = {"leader": b"", "follower": b""}
    for event in Replay(clean, 0.0).events(threading.Event()):
        if isinstance(event, Bytes):
            got[event.role] += event.data
    assert {role: bytes(s.data) for role, s in clean.serial.items()} == got


def test_a_replay_keeps_its_pace(clean: Recording) -> None:
    """Twenty times: one second of this one is twenty of the recording."""
    leaving, sent = threading.Event(), 0
    begin_s = time.monotonic()
    for event in Replay(clean, 20.0).events(leaving):
        if isinstance(event, Bytes) and event.role == "leader":
            sent += len(event.data)
        if time.monotonic() - begin_s > 1.0:
            break
    taken_s = time.monotonic() - begin_s
    stream = clean.serial["leader"]
    seen_s = float(stream.t_ns_bench([sent - 1])[0] - stream.block_t_ns_bench[0]) * 1e-9
    assert seen_s <= 20.0 * taken_s + 0.01
    assert seen_s > 20.0 * (taken_s - 0.5)


def test_a_replay_can_be_left(clean: Recording) -> None:
    page = Page((source := Replay(clean, 0.01)).about)
    with Feed(source, page):
        time.sleep(0.2)
    assert page.ended == "the recording has come to its end"


def test_a_port_that_is_pulled_out_and_put_back(clean: Recording, cable: Cable) -> None:
    data = bytes(clean.serial["leader"].data[:200_000])
    source = named_ports({"leader": str(cable.link)})
    page = Page(source.about)
    told: list[str] = []

    def port() -> str:
        page.refresh(time.monotonic())
        return str(page._shown["health"]["port"])

    with Feed(source, page, told.append):
        until(lambda: port() == "open", "open")
        cable.say(data[:100_000])
        first_s = until(lambda: page._t_s > 1.0 and page._t_s, "the first half")
        cable.unplug()
        until(lambda: port() == "lost", "known to be lost")
        assert page._shown["health"]["level"] == "bad"
        time.sleep(0.7)
        cable.plug_in()
        until(lambda: port() == "open", "back")
        cable.say(data[100_000:])
        until(lambda: page._t_s > first_s + 1.0, "the second half")
    assert [line.split(": ")[1] for line in told][:1] == ["connected"]
    assert "connected" in told[-1]
    assert any("no such serial port" in line or "lost" in line for line in told)


def test_a_port_that_is_not_there_yet_is_waited_for(tmp_path: Path) -> None:
    source = named_ports({"leader": str(tmp_path / "nothing")})
    leaving = threading.Event()
    first = next(iter(source.events(leaving)))
    assert isinstance(first, Port)
    assert first.state == "lost"
    assert "no such serial port" in first.why
    with pytest.raises(RigError, match="leader's port is not named"):
        named_ports({"follower": "/dev/null"})


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "name one source"),
        (["x", "--board", "sim"], "name one source"),
        (["--port", "leader"], "leader=PATH or follower=PATH"),
        (["--port", "leader=a", "--port", "leader=b"], "each once"),
    ],
)
def test_wrong_arguments_are_refused(arguments: list[str], said: str) -> None:
    result = typer.testing.CliRunner().invoke(app, ["live", *arguments])
    assert result.exit_code == 2
    assert said in " ".join(re.sub("[│\n]", " ", result.output).split())


def test_the_command_serves_and_ends_cleanly_with_ctrl_c() -> None:
    arguments = ["live", str(RECORDINGS / "clean-7ms5"), "--http-port", "0", "--no-open"]
    with subprocess.Popen(
        [sys.executable, "-u", "-c", "from hil.cli import main; main()", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        assert "REPLAY: clean-7ms5" in process.stdout.readline()
        url = process.stdout.readline().strip()
        with urllib.request.urlopen(url, timeout=LIMIT_S) as answer:
            assert b"<h2" in answer.read()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
        assert process.wait(LIMIT_S) == 0
    assert rest.splitlines()[-1] == "ended"
    assert "Traceback" not in rest
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
