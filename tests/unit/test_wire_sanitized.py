# SPDX-License-Identifier: Apache-2.0
"""The C library and the bulk decoder under both sanitizers, on hostile bytes."""

from __future__ import annotations

import os
import random
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hil.wire.codec import decode
from hil.wire.frames import frame, take_apart
from hil.wire.messages import MESSAGES
from hil.wire.records import layout

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
    return frames, len(take_apart(np.frombuffer(stream, np.uint8), ())[0].start) - frames


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
    assert frames + rejected == len(take_apart(data, ())[0].start)


def test_one_chunk_without_end(stress: Path) -> None:
    assert run(stress, b"\0" + b"\xff" * 1_000_000) == (0, 0)
    assert run(stress, b"\0" + b"\x01" * 1_000_000 + b"\0") == (0, 1)


@pytest.fixture(scope="module")
def bulk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("streams") / "streams_stress"
    native = ROOT / "hil" / "wire" / "native"
    subprocess.run(
        [
            *(os.environ.get("CXX", "c++"), "-std=c++17", "-Wall", "-Wextra", "-Wconversion"),
            *("-Werror", "-g", "-O1", "-fsanitize=address,undefined", "-D_GLIBCXX_ASSERTIONS"),
            *("-fno-sanitize-recover=all", f"-I{native}", str(native / "streams.cpp")),
            *(str(ROOT / "tests/unit/c/streams_stress.cpp"), "-o", str(program)),
        ],
        check=True,
    )
    return program


@pytest.mark.parametrize("kind", ["sound", "damaged", "noise", "empty", "long"])
def test_bulk_decoder(bulk: Path, kind: str) -> None:
    rng = np.random.default_rng(3)
    data = np.frombuffer(b"".join(any_frames(random.Random(4), 4000)), np.uint8).copy()
    if kind == "damaged":
        hit = rng.choice(len(data), len(data) // 40, replace=False)
        data[hit] = rng.choice(np.array([0, 1, 0xFE, 0xFF, 0x55], np.uint8), len(hit))
    elif kind == "noise":
        data = rng.integers(0, 256, 500_000, np.uint8)
        data[rng.random(len(data)) < rng.random(len(data)) / 5] = 0
    elif kind == "empty":
        data = data[:0]
    elif kind == "long":
        data = np.repeat(np.array([0, 0xFF, 0, 1, 0, 2, 0], np.uint8), 5000)
    layouts = [",".join(map(str, layout(message))) for message in MESSAGES]
    done = subprocess.run(
        [str(bulk), *layouts], input=data.tobytes(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    chunks, frames, unknown_types, bad_lengths = map(int, done.stdout.split())
    stats = decode(data).stats
    assert (frames, unknown_types, bad_lengths) == (
        stats.frames,
        stats.unknown_types,
        stats.bad_lengths,
    )
    assert chunks == len([c for c in data.tobytes().split(b"\0")[1:-1] if c])
