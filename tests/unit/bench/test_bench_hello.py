# SPDX-License-Identifier: Apache-2.0
"""What a node says at boot, heard on a line and held against what was flashed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.bench.hello import check_hello
from hil.bench.listen import hear_hello
from hil.wire import frames
from hil.wire.codec import decode
from hil.wire.messages import BY_NAME, schema_hash
from hil.wire.records import Packer
from tests.bench.fakes import images

DEVICE = 0x0123456789ABCDEF
SOUND: dict[str, Any] = {
    "protocol_version": 1,
    "role": 0,
    "target": 1,
    "schema_hash": schema_hash(),
    "build_id": 0x00112233445566AA,
    "device_id": DEVICE,
    "reset_reason": 0,
    "tick_rate_hz": 16_000_000,
    "conn_interval_us": 7500,
    "uptime_ms": 12,
}


def frame(**changes: int) -> bytes:
    message = BY_NAME["hello"]
    return frames.frame(message.id, 0, Packer(message).pack(SOUND | changes))


def test_the_firmware_that_was_flashed_is_accepted(tmp_path: Path) -> None:
    manifest = images.built(tmp_path)
    assert check_hello(SOUND, manifest, DEVICE) == []
    record = decode(frame()).messages["hello"][0]
    assert isinstance(record, np.void)
    assert check_hello(record, manifest, DEVICE) == []


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("role", 1, "it says that it is the follower, not the leader"),
        ("target", 0, "not on nrf52840dk"),
        ("build_id", 0x99, "it says build 0000000000000099; flashed was 00112233445566aa"),
        ("schema_hash", 5, "protocol table 0000000000000005"),
        ("device_id", 7, "the serial port is the other board's"),
    ],
)
def test_each_field_that_differs_is_a_sentence(
    tmp_path: Path, field: str, value: int, said: str
) -> None:
    (sentence,) = check_hello(SOUND | {field: value}, images.built(tmp_path), DEVICE)
    assert said in sentence


def test_hello_is_heard_in_pieces_and_among_noise() -> None:
    stream = b"boot: hello\r\n\x00\xff\x13" + frame()[:7] + b"\x00" + frame(uptime_ms=99)
    pieces = [stream[n : n + 5] for n in range(0, len(stream), 5)]
    heard = hear_hello(lambda timeout_s: pieces.pop(0) if pieces else b"", 5.0)
    assert heard == SOUND | {"uptime_ms": 99}


def test_silence_ends_in_time() -> None:
    import time  # noqa: PLC0415

    def silent(timeout_s: float) -> bytes:
        time.sleep(timeout_s)
        return b""

    start_s = time.monotonic()
    assert hear_hello(silent, 0.3) is None
    assert 0.25 < time.monotonic() - start_s < 2


def test_hello_is_heard_on_a_real_serial_line() -> None:
    """A pseudo-terminal in place of the DK's port, from the doctor's own function on."""
    import os  # noqa: PLC0415
    import threading  # noqa: PLC0415
    import time  # noqa: PLC0415
    import tty  # noqa: PLC0415

    from hil.bench.cli import _hello  # noqa: PLC0415

    board, port = os.openpty()
    tty.setraw(board)
    tty.setraw(port)
    done = threading.Event()

    def speak() -> None:
        while not done.is_set():
            os.write(board, b"csv,1,2\r\n" + frame())
            time.sleep(0.1)

    speaker = threading.Thread(target=speak)
    speaker.start()
    try:
        assert _hello(os.ttyname(port)) == SOUND
    finally:
        done.set()
        speaker.join()
        os.close(board)
        os.close(port)
