# SPDX-License-Identifier: Apache-2.0
"""The ESP32's side: its core on the host, and the sketch against declarations of Arduino."""

from __future__ import annotations

import ctypes
import random
import shutil
import subprocess
from collections import deque
from pathlib import Path

import pytest

from hil.stringpot.samples import parse
from tests.unit.native import STRICT

HERE = Path(__file__).parent
SKETCH = Path(__file__).parents[3] / "firmware/extras/stringpot"


def compile_cpp(*arguments: str | Path) -> None:
    compiler = shutil.which("g++") or shutil.which("clang++")
    assert compiler, "no C++ compiler found: install g++ or clang++"
    argv = [compiler, "-std=c++11", *STRICT, f"-I{SKETCH}", *map(str, arguments)]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    output = tmp_path_factory.mktemp("core") / "core.so"
    compile_cpp("-shared", "-fPIC", HERE / "core.cpp", "-o", output)
    library = ctypes.CDLL(str(output))
    for name in ("pot_push", "pot_pop", "pot_tick"):
        getattr(library, name).restype = ctypes.c_bool
    for name in ("pot_measure", "pot_missed", "pot_dropped"):
        getattr(library, name).restype = ctypes.c_uint32
    return library


@pytest.mark.parametrize(
    ("time_us", "raw", "line"),
    [
        (0, 0, b"0,0\r\n"),
        (1000, 16_380, b"1000,16380\r\n"),
        (4_294_967_295, 1 << 24, b"4294967295,16777216\r\n"),
        (10, 900, b"10,900\r\n"),
    ],
)
def test_lines_are_what_the_host_reads(
    core: ctypes.CDLL, time_us: int, raw: int, line: bytes
) -> None:
    out = ctypes.create_string_buffer(32)
    assert core.pot_line(out, time_us, raw) == len(line)
    assert out.value == line
    samples = parse([out.value, b"%d,1" % ((time_us + 1000) % (1 << 32))])
    assert (samples.t_us[0], samples.raw[0]) == (time_us, raw)
    assert len(line) < 24


def test_a_sample_is_the_sum_of_four_conversions(core: ctypes.CDLL) -> None:
    assert core.pot_measure(100) == 100 + 101 + 102 + 103
    assert core.pot_measure(4092) == 4092 + 4093 + 4094 + 4095


def test_ticks_that_came_too_late_are_counted(core: ctypes.CDLL) -> None:
    before = core.pot_missed()
    assert [core.pot_tick(n) for n in (1, 0, 1, 3, 1)] == [True, False, True, True, True]
    assert core.pot_missed() - before == 2


def test_the_queue_is_one_and_drops_what_it_cannot_hold(core: ctypes.CDLL) -> None:
    """Against a deque of seven, through many wraps."""
    rng, model, dropped = random.Random(1), deque[tuple[int, int]](), 0
    t, x = ctypes.c_uint32(), ctypes.c_uint32()
    for k in range(5000):
        if rng.random() < 0.55:
            fits = len(model) < 7
            assert core.pot_push(k, k * 3) == fits
            dropped += not fits
            if fits:
                model.append((k, k * 3))
        else:
            got = core.pot_pop(ctypes.byref(t), ctypes.byref(x))
            assert got == bool(model)
            if got:
                assert (t.value, x.value) == model.popleft()
    assert core.pot_dropped() == dropped > 100


def test_the_sketch_compiles_against_the_functions_it_calls(tmp_path: Path) -> None:
    """The declarations are ours, after the ESP32 core's documentation: this finds slips in the
    sketch, not in them."""
    includes = f"-I{HERE / 'arduino'}"
    compile_cpp("-fsyntax-only", includes, "-x", "c++", SKETCH / "stringpot.ino")
    broken = tmp_path / "stringpot.ino"
    broken.write_text((SKETCH / "stringpot.ino").read_text().replace("analogRead(", "analogReed("))
    with pytest.raises(AssertionError, match="analogReed"):
        compile_cpp("-fsyntax-only", includes, "-x", "c++", broken)
