# SPDX-License-Identifier: Apache-2.0
"""A desk with stand-ins for simulator and firmware: reset, power cut, death, and nothing left."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hil.bench.port import SerialPort
from hil.build import BabbleSim
from hil.errors import RigError
from hil.motion.imu_model import UNCALIBRATED, draw_errors
from hil.scenario import StoredCalibration
from hil.simulator.desk import Desk
from hil.simulator.preload import of_chip

ERRORS = draw_errors(np.random.default_rng(6), UNCALIBRATED)

NODE = """
import os, pathlib, sys, time
options = dict(a.lstrip("-").partition("=")[::2] for a in sys.argv[1:])
flash = pathlib.Path(options["flash"])
boots = int(flash.read_text()) + 1 if flash.exists() else 1
flash.write_text(str(boots))
line = os.open(options["hil_uart"], os.O_RDWR | os.O_NOCTTY)
held = os.open(options["imu_hands"], os.O_RDWR | os.O_NONBLOCK)
first = os.read(held, 4096).decode().splitlines()[-1]
os.write(line, f"boot {boots} held {first}\\n".encode())
while True:
    command = os.read(line, 100).strip()
    if command == b"reset":
        sys.exit(87)
    if command == b"cut":
        sys.exit(86)
    if command == b"die":
        print("assertion failed in the radio", flush=True)
        sys.exit(1)
"""


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{sys.executable}\n{text}")
    path.chmod(0o755)
    return path


@pytest.fixture
def desk(tmp_path: Path) -> Callable[..., Desk]:
    babblesim = BabbleSim(tmp_path, tmp_path)
    script(babblesim.phy, "import time; time.sleep(60)")
    node = script(tmp_path / "node", NODE)
    return lambda **options: Desk(babblesim, options.pop("executable", node), ERRORS, **options)


def read_line(port: SerialPort, limit_s: float = 20.0) -> str:
    got = b""
    deadline_s = time.monotonic() + limit_s
    while not got.endswith(b"\n"):
        assert time.monotonic() < deadline_s, got
        got += port.read_bytes(0.2)
    return got.decode().strip()


def held(line: str) -> np.ndarray:
    return np.array([float(x) for x in line.split(" held ")[1].split(",")])


def test_a_reset_starts_it_again_at_the_same_port(
    desk: Callable[..., Desk], tmp_path: Path
) -> None:
    flash = tmp_path / "flash"
    with desk(flash=flash) as unit, SerialPort(unit.port) as port:
        first = read_line(port)
        assert first.startswith("boot 1 held ")
        # +z up, as the chip with its errors feels it.
        up = ERRORS.accel_matrix[:, 2] * 9.80665 + ERRORS.accel_bias_mps2
        np.testing.assert_allclose(held(first)[1:4], up, rtol=1e-8)
        unit.hands.turn(np.array([1.0, 0.0, 0.0]))
        port.write(b"reset\n")
        second = read_line(port)
        assert second.startswith("boot 2 held ")
        across = ERRORS.accel_matrix[:, 0] * 9.80665 + ERRORS.accel_bias_mps2
        np.testing.assert_allclose(held(second)[1:4], across, rtol=1e-8)
        unit.check()
        assert unit.boots == 2
    assert flash.read_text() == "2"


def test_a_power_cut_ends_it_and_says_so(desk: Callable[..., Desk]) -> None:
    with desk() as unit, SerialPort(unit.port) as port:
        read_line(port)
        assert not unit.wait_power_cut(0.1)
        port.write(b"cut\n")
        assert unit.wait_power_cut(20.0)
        with pytest.raises(RigError, match="lost its power"):
            unit.check()


def test_a_unit_that_dies_shows_its_last_words(desk: Callable[..., Desk]) -> None:
    with desk() as unit, SerialPort(unit.port) as port:
        read_line(port)
        unit.check()
        port.write(b"die\n")
        assert not unit.wait_power_cut(20.0)
        with pytest.raises(RigError, match="assertion failed in the radio"):
            unit.check()


def test_an_image_that_is_not_there_is_said(desk: Callable[..., Desk], tmp_path: Path) -> None:
    with desk(executable=tmp_path / "none") as unit:
        unit.wait_power_cut(20.0)
        with pytest.raises(RigError, match="none"):
            unit.check()


def test_nothing_is_left_however_it_is_left(desk: Callable[..., Desk]) -> None:
    """Terminals, pipe, folder, programs."""
    before = sorted(os.listdir("/proc/self/fd"))
    folders: list[Path] = []

    def interrupted() -> None:
        with desk() as unit, SerialPort(unit.port) as port:
            read_line(port)
            folders.append(unit._folder)
            assert folders[0].is_dir()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    (folder,) = folders
    assert not folder.exists()
    assert len(os.listdir("/proc/self/fd")) == len(before)
    running = [
        path
        for path in Path("/proc").glob("[0-9]*/cmdline")
        if str(folder).encode() in _contents(path)
    ]
    assert running == []


def _contents(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def test_what_is_put_into_a_flash_undoes_the_chips_errors() -> None:
    stored = of_chip(ERRORS, StoredCalibration((0.5, 0.0, -0.25)))
    true = np.array([3.0, -4.0, 8.4])
    raw = ERRORS.accel_matrix @ true + ERRORS.accel_bias_mps2
    matrix = np.array(stored["accel_matrix"]).reshape(3, 3)
    np.testing.assert_allclose(
        matrix @ (raw - np.array(stored["accel_bias_mps2"])), true, atol=5e-6
    )
    left_dps = np.degrees(np.array(stored["gyro_bias_radps"]) - ERRORS.gyro_bias_radps)
    np.testing.assert_allclose(left_dps, [0.5, 0.0, -0.25], atol=1e-5)
