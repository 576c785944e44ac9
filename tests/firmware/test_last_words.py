# SPDX-License-Identifier: Apache-2.0
"""A node that fails reboots by itself and says why: a unit on the desk, made to fail by command."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from hil import build
from hil.bench.port import SerialPort
from hil.build import Manifest
from hil.motion.imu_model import IDEAL, draw_errors
from hil.simulator.desk import Desk
from hil.wire.codec import encode
from hil.wire.live import LiveStream
from hil.wire.messages import FAULT_CODES, NODE_COMMANDS

LIMIT_S = 90.0


@pytest.mark.parametrize(
    ("command", "code", "detail"),
    [
        ("fail_fatal", "assert", "rebooted: error 4 in sysworkq"),
        ("fail_stack", "stack", "rebooted: error 2 in sysworkq"),
        ("fail_hang", "watchdog", "rebooted: sensor stuck in lsm6dsox"),
    ],
)
def test_after_the_reboot_it_says_why(stranger: Path, command: str, code: str, detail: str) -> None:
    babblesim = build.find_babblesim(build.find_workspace(None))
    still = draw_errors(np.random.default_rng(0), IDEAL)
    with Desk(babblesim, stranger, still) as desk, SerialPort(desk.port) as port:
        stream = LiveStream()
        said: list[tuple[int, str]] = []
        threads: set[str] = set()
        hellos = 0

        def listen() -> None:
            nonlocal hellos
            messages = stream.feed(port.read_bytes(0.1)).messages
            hellos += messages["hello"].size
            for fault in messages["fault"]:
                text = bytes(fault["detail"]).rstrip(b"\0").decode("ascii")
                said.append((int(fault["code"]), text))
            for thread in messages["thread"]:
                threads.add(bytes(thread["name"]).rstrip(b"\0").decode("ascii"))
                assert thread["stack_free_b"] <= thread["stack_size_b"]

        def until(condition: Callable[[], bool]) -> None:
            deadline_s = time.monotonic() + LIMIT_S
            while not condition():
                desk.check()
                assert time.monotonic() < deadline_s, (said, desk.boots)
                listen()

        until(lambda: hellos >= 2)
        assert said == []
        assert desk.boots == 1
        port.write(encode("node_command", {"command": NODE_COMMANDS[command]}, 0))
        until(lambda: bool(said))
        assert desk.boots == 2
        assert said[0][0] == FAULT_CODES[code]
        assert said[0][1].startswith(detail)
        # Once, and only by the boot that follows.
        heard = hellos
        until(lambda: hellos >= heard + 2)
        assert len(said) == 1


def test_an_image_as_delivered_refuses_to_fail(images: Mapping[str, Manifest]) -> None:
    babblesim = build.find_babblesim(build.find_workspace(None))
    still = draw_errors(np.random.default_rng(0), IDEAL)
    executable = images["follower"].file("exe")
    with Desk(babblesim, executable, still) as desk, SerialPort(desk.port) as port:
        stream = LiveStream()
        codes: list[int] = []
        deadline_s = time.monotonic() + LIMIT_S
        told = False
        while not codes:
            desk.check()
            assert time.monotonic() < deadline_s
            messages = stream.feed(port.read_bytes(0.1)).messages
            codes += messages["fault"]["code"].tolist()
            if messages["hello"].size and not told:
                told = True
                port.write(encode("node_command", {"command": NODE_COMMANDS["fail_fatal"]}, 0))
        assert codes == [FAULT_CODES["command_refused"]]
        assert desk.boots == 1
