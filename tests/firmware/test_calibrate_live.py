# SPDX-License-Identifier: Apache-2.0
"""``hil calibrate`` as a person sees it: on a terminal, with real firmware on a simulated unit."""

from __future__ import annotations

import os
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Mapping
from fcntl import ioctl
from pathlib import Path

import numpy as np
import pytest

from hil.build import Manifest
from hil.calibration.record import Record, load
from hil.motion.imu_model import chip_errors

LIMIT_S = 120.0
SEED = 3
ROWS, COLUMNS = 40, 80


class Terminal:
    """A program on a terminal of its own; what it shows is kept as plain text."""

    def __init__(self, arguments: list[str], cwd: Path) -> None:
        self._master, slave = os.openpty()
        ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        self.shown = ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from hil.cli import main; main()", *arguments],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=cwd,
            env={**os.environ, "TERM": "xterm-256color"},
            start_new_session=True,
        )
        os.close(slave)

    def wait_for(self, text: str) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while text not in self.shown:
            if not self._read() or time.monotonic() > deadline_s:
                pytest.fail(f"'{text}' never came; shown:\n{self.shown[-3000:]}")

    def type(self, text: str) -> None:
        os.write(self._master, text.encode())

    def end(self) -> int:
        """Everything that is still shown, and the exit status."""
        while self._read():
            pass
        os.close(self._master)
        return self.process.wait(LIMIT_S)

    def _read(self) -> bool:
        ready, _, _ = select.select([self._master], [], [], LIMIT_S)
        try:
            data = os.read(self._master, 65536) if ready else b""
        except OSError:
            # The program has closed its end.
            return False
        self.shown += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", data.decode("utf-8", "replace"))
        return bool(data)


def calibrate(cwd: Path, *more: str, rest_s: float = 60.0) -> Terminal:
    arguments = ["calibrate", "--role", "leader", "--board", "sim", "--speed", "0"]
    return Terminal([*arguments, "--seed", str(SEED), "--rest", str(rest_s), *more], cwd)


def only_record(folder: Path) -> Record:
    (path,) = folder.glob("calibrations/*.json")
    return load(path)


def test_a_whole_guided_run(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    """Six faces, a minute of rest, the question, write, reset, boot check; then it is there."""
    terminal = calibrate(tmp_path)
    for face in ("+x", "-x", "+y", "-y", "+z", "-z"):
        terminal.wait_for(f"{face} up")
    terminal.wait_for("[y/n]")
    assert not list(tmp_path.glob("calibrations/*")), "written before the question was answered"
    terminal.type("y\n")
    assert terminal.end() == 0, terminal.shown[-3000:]
    assert "read back equal" in terminal.shown
    assert "boot check: applied" in terminal.shown
    assert "simulated" in terminal.shown

    found = only_record(tmp_path).calibration
    truth = chip_errors(SEED, "leader", "uncalibrated")
    scale = np.diagonal(np.linalg.inv(found.accel_matrix))
    np.testing.assert_allclose(scale, np.diagonal(truth.accel_matrix), rtol=1e-3)
    bias_mg = (found.accel_bias_mps2 - truth.accel_bias_mps2) / 9.80665e-3
    assert np.abs(bias_mg).max() < 1.0
    gyro_dps = np.degrees(found.gyro_bias_radps - truth.gyro_bias_radps)
    assert np.abs(gyro_dps).max() < 0.02
    # A sound run that had found nothing would pass, too: this chip's errors are larger.
    assert np.abs(truth.accel_bias_mps2).max() / 9.80665e-3 > 5.0

    again = calibrate(tmp_path, "--dry-run", rest_s=5.0)
    again.wait_for("calibration: stored")
    again.wait_for("nothing was written")
    assert again.end() == 0, again.shown[-3000:]
    assert len(list(tmp_path.glob("calibrations/*"))) == 1


def test_no_writes_nothing(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    terminal = calibrate(tmp_path, rest_s=5.0)
    terminal.wait_for("[y/n]")
    terminal.type("n\n")
    assert terminal.end() == 0, terminal.shown[-3000:]
    assert not list(tmp_path.glob("calibrations/*"))
    again = calibrate(tmp_path, "--dry-run", rest_s=5.0)
    again.wait_for("calibration: defaults")
    assert again.end() == 0


def test_interrupted_among_the_faces(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    terminal = calibrate(tmp_path)
    terminal.wait_for("+y up")
    terminal.process.send_signal(signal.SIGINT)
    assert terminal.end() == 130, terminal.shown[-3000:]
    assert "keeps the calibration it had" in " ".join(terminal.shown.split())
    assert not list(tmp_path.glob("calibrations/*"))
