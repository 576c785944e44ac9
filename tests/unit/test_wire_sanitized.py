# SPDX-License-Identifier: Apache-2.0
"""The C library under AddressSanitizer and UndefinedBehaviorSanitizer, on hostile bytes."""

from __future__ import annotations

import os
import random
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hil.wire.codec import decode
from hil.wire.frames import find_chunks, frame
from hil.wire.messages import MESSAGES

ROOT = Path(__file__).parents[2]
WIRE = ROOT / "firmware" / "lib" / "wire"


@pytest.fixture(scope="module")
def stress(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("wire") / "wire_rx_stress"
    subprocess.run(
        [
            os.environ.get("CC", "cc"),
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Wconversion",
            "-Wshadow",
            "-Wpedantic",
            "-Werror",
            "-g",
            "-O1",
            "-fsanitize=address,undefined",
            "-fno-sanitize-recover=all",
            f"-I{WIRE}",
            str(ROOT / "tests" / "unit" / "c" / "wire_rx_stress.c"),
            str(WIRE / "framing.c"),
            "-o",
            str(program),
        ],
        check=True,
    )
    return program


def run(program: Path, stream: bytes) -> tuple[int, int]:
    """Frames and rejected chunks, as the program says."""
    done = subprocess.run([str(program)], input=stream, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    frames, rejected = done.stdout.split()
    return int(frames), int(rejected)


def counted(stream: bytes) -> tuple[int, int]:
    """The same, as the Python codec says."""
    frames = decode(stream).stats.frames
    return frames, len(find_chunks(np.frombuffer(stream, np.uint8)).start) - frames


def any_frames(rng: random.Random, count: int) -> list[bytes]:
    """Frames of every type with payloads of every length around the right one."""
    result = []
    for seq in range(count):
        message = rng.choice(MESSAGES)
        rows = rng.randrange(message.group.max_count + 1) if message.group else 0
        size = message.fixed_size + (message.group.size * rows if message.group else 0)
        payload = bytearray(bytes(rng.choice((0, rng.randrange(256))) for _ in range(size)))
        if message.group:
            payload[message.fixed_size - 1] = rows
        cut = max(0, size - rng.choice((0, 0, 0, 1, size)))
        result.append(frame(message.id, seq, bytes(payload[:cut])))
    return result


def test_good_frames(stress: Path) -> None:
    stream = b"".join(any_frames(random.Random(1), 3000))
    assert run(stress, stream) == counted(stream) == (3000, 0)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_frames(stress: Path, seed: int) -> None:
    rng = random.Random(seed)
    stream = bytearray(b"".join(any_frames(rng, 3000)))
    for at in rng.sample(range(len(stream)), 1000):
        stream[at] = rng.choice((0, 1, 0xFF, rng.randrange(256)))
    frames, rejected = run(stress, bytes(stream))
    assert (frames, rejected) == counted(bytes(stream))
    assert frames > 1000
    assert rejected > 500


@pytest.mark.parametrize("zeros", [0.0, 0.001, 0.01, 0.1, 0.5])
def test_random_bytes(stress: Path, zeros: float) -> None:
    rng = np.random.default_rng(7)
    data = rng.integers(0, 256, 1_000_000, np.uint8)
    data[rng.random(len(data)) < zeros] = 0
    frames, rejected = run(stress, data.tobytes())
    assert frames + rejected == len(find_chunks(data).start)


def test_one_chunk_without_end(stress: Path) -> None:
    assert run(stress, b"\0" + b"\xff" * 1_000_000) == (0, 0)
    assert run(stress, b"\0" + b"\x01" * 1_000_000 + b"\0") == (0, 1)
