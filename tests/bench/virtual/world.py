# SPDX-License-Identifier: Apache-2.0
"""A virtual bench: two boards, their probes, ports and an analyser, with no hardware.

Programs run against it as against a real one. ``openocd`` and ``sigrok-cli`` are found on PATH and
ask this process; the flash is that of :mod:`tests.bench.fakes.chip`; serial ports are
pseudoterminals. When both boards have been reset, they begin to say and do what a recording holds.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import pytest
from serial.tools import list_ports

from hil.bench import setup
from hil.bench.errors import ProbeLostError
from hil.bench.probes import usb
from hil.bench.probes.model import Protection
from hil.recording import Recording
from hil.wire.messages import ROLES
from tests.bench.fakes import images
from tests.bench.fakes.chip import FakeChip, FakeProbe
from tests.bench.virtual import client
from tests.bench.virtual.play import ROOT, Tape, tape, tape_of
from tests.bench.virtual.site import sitecustomize

SERIALS = {"leader": "683000001", "follower": "683000002"}
DEVICE_IDS = (0x1111_2222_3333_4444, 0x5555_6666_7777_8888)
ANALYSER = "fx2lafw:conn=1.7 - Saleae Logic with 8 channels: D0 D1 D2 D3 D4 D5 D6 D7"
TICK_S = 0.004
PIECE_S = 0.05
BACKLOG_B = 1 << 16
"""What a debugger keeps of a port that nobody reads."""
WIRED = [f"{role}.{signal}" for role in ROLES for signal in ("radio_end", "pulse", "imu_int1")]


class Port:
    """One virtual COM port, raw at both ends."""

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        for fd in (self.master, self._slave):
            tty.setraw(fd)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self._slave)

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)


class World:
    """The bench; a context manager.

    Args:
        folder: of its own.
        recording: what the boards do; a name in ``fixtures/recordings``, or one just made.
        exchanged: each probe's serial port is the other board's.

    Attributes:
        project: folder with a bench's project: where commands are run.
        heard: role -> bytes that the host sent.
    """

    def __init__(
        self,
        folder: Path,
        recording: str | Recording | Tape = "clean-7ms5",
        *,
        exchanged: bool = False,
    ) -> None:
        self.folder = folder
        self.project = folder / "project"
        self.heard = {role: bytearray() for role in ROLES}
        if isinstance(recording, str):
            self.tape = tape(recording, DEVICE_IDS)
        elif isinstance(recording, Tape):
            self.tape = recording
        else:
            self.tape = tape_of(recording, DEVICE_IDS)
        self.probes = {
            role: FakeProbe(SERIALS[role], FakeChip((i & 0xFFFF_FFFF, i >> 32)))
            for role, i in zip(ROLES, DEVICE_IDS, strict=True)
        }
        self._exchanged = exchanged
        self._ports: dict[str, Port | None] = dict.fromkeys(ROLES)
        self._next = dict.fromkeys(ROLES, 0)
        self._backlog = {role: bytearray() for role in ROLES}
        self._reset: set[str] = set()
        self._start_ns: int | None = None
        self._leaving = threading.Event()
        self._lock = threading.RLock()
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        for name in ("sys", "dev/001", "bin", "project/boards"):
            (self.folder / name).mkdir(parents=True)
        for number, role in enumerate(ROLES, 4):
            device = self.folder / "sys" / f"1-{number}"
            device.mkdir()
            facts = {"idVendor": "1366", "product": "J-Link", "busnum": "1"}
            facts |= {"serial": SERIALS[role].zfill(12), "devnum": str(number)}
            for key, value in facts.items():
                (device / key).write_text(value + "\n")
            (self.folder / "dev/001" / f"{number:03}").touch()
        for role in ROLES:
            self.plug(role)
        # Paths of sockets are short.
        self._socket = socket.socket(socket.AF_UNIX)
        path = self.folder / "s"
        self._socket.bind(str(path))
        self._socket.listen()
        for name in ("openocd", "sigrok-cli"):
            client.install(self.folder / "bin", name, path)
        (self.project / "pytest.ini").write_text(
            f"[pytest]\npythonpath = {ROOT}\n"
            "addopts = --import-mode=importlib -p no:cacheprovider\n"
        )
        for target in (self._serve, self._play):
            thread = threading.Thread(target=target, daemon=True)
            self._threads.append(thread)
            thread.start()
        # Somebody switched both boards on before the bench is used.
        for role in ROLES:
            self.reset(role)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
        self._leaving.set()
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for thread in self._threads:
            thread.join(5)
        for role in ROLES:
            if self._ports[role] is not None:
                self.unplug(role)

    def close(self) -> None:
        """End what a kind of bench has beside; nothing here."""

    # What a person does

    def plug(self, role: str) -> None:
        """Connect the serial port; it comes back under another name."""
        with self._lock:
            self._ports[role] = Port()
            self._backlog[role].clear()
            self._list_ports()

    def unplug(self, role: str) -> None:
        with self._lock:
            port, self._ports[role] = self._ports[role], None
            self._list_ports()
            assert port is not None
            port.close()

    def reset(self, role: str) -> None:
        """The board stops; when both have been reset they go on together, from the beginning."""
        with self._lock:
            self._start_ns = None
            self._reset.add(role)
            if len(self._reset) == len(ROLES):
                self._reset.clear()
                self._next = dict.fromkeys(ROLES, 0)
                for backlog in self._backlog.values():
                    backlog.clear()
                self._start_ns = time.monotonic_ns()

    def bench_file(self, *, samplerate_hz: int = 8_000_000, analyser: bool = True) -> Path:
        """A bench file, as ``hil bench init`` writes it but for the rate."""
        path = self.project / "boards/bench.toml"
        text = setup.text(
            (SERIALS["leader"], SERIALS["follower"]), driver="fx2lafw" if analyser else ""
        )
        path.write_text(text.replace("8_000_000", str(samplerate_hz)))
        return path

    def images(self, *, build_id: str = "") -> Path:
        """A folder of images that match what the boards will say, or have another build id."""
        folder = self.project / "images"
        for n, role in enumerate(ROLES):
            built = images.built(folder / role, role, seed=n)
            replace(
                built,
                build_id=build_id or self.tape.build_ids[role],
                kconfig=self.tape.kconfig[role],
            ).save()
        return folder

    def scenario(self, duration_s: float, more: str = "") -> Path:
        """A scenario file for the images of :meth:`images`; ``more`` is TOML."""
        lines = ['name = "virtual"', f"duration_s = {duration_s}", more]
        for role, options in self.tape.kconfig.items():
            lines += [f"[firmware.{role}]"] if options else []
            lines += [f"{key} = {json.dumps(value)}" for key, value in options.items()]
        path = self.project / "virtual.toml"
        path.write_text("\n".join(lines) + "\n")
        return path

    def suite(self, duration_s: float, *more: str | Path) -> list[str | Path]:
        """The command line of a live run of the rig's suite."""
        folder = ROOT / "tests/hil"
        line: list[str | Path] = ["pytest", folder, "-c", "pytest.ini", "--rootdir", "."]
        if not self.tape.has_calibration:
            # The recording is older than the store of calibrations.
            line.append(f"--ignore={folder / 'test_cal.py'}")
        line += ["-q", "-rs", "--board=bench", "--require-live", "--images", self.images()]
        return [*line, "--scenario", self.scenario(duration_s), *more]

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Let this process meet the bench, as programs with :attr:`environment` do."""
        for name in ("PATH", "HIL_VIRTUAL_BENCH"):
            monkeypatch.setenv(name, self.environment[name])
        monkeypatch.setattr(sitecustomize, "FOLDER", str(self.folder))
        monkeypatch.setattr(list_ports, "comports", sitecustomize.comports)
        monkeypatch.setattr(
            usb.find_probes, "__defaults__", (self.folder / "sys", self.folder / "dev")
        )

    @property
    def environment(self) -> Mapping[str, str]:
        """Of programs that are to meet this bench."""
        paths = [str(ROOT / "tests/bench/virtual/site"), str(ROOT)]
        programs = [str(self.folder / "bin"), str(Path(sys.executable).parent)]
        return {
            **os.environ,
            "HIL_VIRTUAL_BENCH": str(self.folder),
            "PYTHONPATH": os.pathsep.join(paths),
            "PATH": os.pathsep.join([*programs, os.environ["PATH"]]),
            "COLUMNS": "200",
        }

    def start(self, *argv: str | Path) -> subprocess.Popen[str]:
        """A program of this Python, run in the project."""
        return subprocess.Popen(
            [str(Path(sys.executable).parent / argv[0]), *map(str, argv[1:])],
            cwd=self.project,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, *argv: str | Path, limit_s: float = 60.0) -> tuple[int, str]:
        """Exit status and output of a program that was run in the project."""
        with self.start(*argv) as program:
            try:
                said, _ = program.communicate(timeout=limit_s)
            except subprocess.TimeoutExpired:
                program.kill()
                raise
        return program.returncode, said

    # What the boards do

    def _list_ports(self) -> None:
        listed = []
        for number, role in enumerate(ROLES, 4):
            there = ROLES_EXCHANGED[role] if self._exchanged else role
            port = self._ports[there]
            if port is not None:
                listed.append(
                    {
                        **{"device": port.path, "vid": 0x1366, "pid": 0x1051},
                        "serial_number": SERIALS[role].zfill(12),
                        "location": f"1-{number}:1.0",
                    }
                )
        partial = self.folder / "ports.partial"
        partial.write_text(json.dumps(listed))
        partial.replace(self.folder / "ports.json")

    def _play(self) -> None:
        while not self._leaving.wait(TICK_S):
            with self._lock:
                for role, port in self._ports.items():
                    self._say(role)
                    if port is not None:
                        self._exchange_bytes(role, port.master)

    def _say(self, role: str) -> None:
        if self._start_ns is None:
            return
        now_ns, said = time.monotonic_ns() - self._start_ns, self.tape.bursts[role]
        while self._next[role] < len(said) and said[self._next[role]][0] <= now_ns:
            self._backlog[role] += said[self._next[role]][1]
            self._next[role] += 1
        del self._backlog[role][:-BACKLOG_B]

    def _exchange_bytes(self, role: str, master: int) -> None:
        with contextlib.suppress(BlockingIOError):
            while self._backlog[role]:
                sent = os.write(master, self._backlog[role])
                del self._backlog[role][:sent]
        with contextlib.suppress(BlockingIOError):
            self.heard[role] += os.read(master, 4096)

    # What the programs do

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                line, _ = self._socket.accept()
                threading.Thread(target=self._answer, args=(line,), daemon=True).start()

    def _answer(self, line: socket.socket) -> None:
        stream = line.makefile("rb")
        program, *argv = json.loads(stream.readline())
        answer = {"openocd": self._openocd, "sigrok-cli": self._sigrok}[program]
        with line, contextlib.suppress(BrokenPipeError, ConnectionResetError):
            line.sendall(_frame(b"x", str(answer(argv, line)).encode()))

    def _openocd(self, argv: list[str], line: socket.socket) -> int:
        if "--version" in argv:
            line.sendall(_frame(b"e", b"Open On-Chip Debugger 0.12.0\n"))
            return 0
        said = [argv[n + 1] for n, word in enumerate(argv) if word == "-c"]
        serial = next(c.split()[2] for c in said if c.startswith("adapter serial"))
        role = next(role for role, probe in self.probes.items() if probe.serial == serial)
        probe = self.probes[role]
        try:
            for command in said:
                if command == "reset run":
                    probe.reset("pin" if "reset_config srst_only" in said else "system")
                    self.reset(role)
                else:
                    self._debug(command, probe, line)
        except ProbeLostError as error:
            line.sendall(_frame(b"e", f"Error: {error.message}\n".encode()))
            return 1
        return 0

    def _debug(self, command: str, probe: FakeProbe, line: socket.socket) -> None:
        if "approtectstatus" in command:
            is_open = probe.protection() is Protection.OFF
            line.sendall(_frame(b"e", f"approtectstatus {int(is_open)}\n".encode()))
        elif match := re.fullmatch(r"dump_image (\S+) (\S+) (\d+)", command):
            Path(match[1]).write_bytes(probe.read_memory(int(match[2], 0), int(match[3])))
        elif match := re.fullmatch(r"flash write_image erase (\S+) 0 ihex", command):
            probe.program(Path(match[1]))

    def _sigrok(self, argv: list[str], line: socket.socket) -> int:
        if "--version" in argv:
            line.sendall(_frame(b"o", b"sigrok-cli 0.7.2\n"))
            return 0
        driver = argv[argv.index("--driver") + 1]
        if not driver.startswith("fx2lafw"):
            return 0
        if "--scan" in argv:
            line.sendall(_frame(b"o", f"{ANALYSER}\n".encode()))
            return 0
        rate_hz = int(argv[argv.index("--config") + 1].partition("=")[2])
        wires = argv[argv.index("--channels") + 1].split(",")
        self._capture(line, rate_hz, wires)
        return 0

    def _capture(self, line: socket.socket, rate_hz: int, wires: list[str]) -> None:
        """Samples in real time, a byte each, until a key is pressed."""
        begin_ns, sample = time.monotonic_ns(), 0
        line.settimeout(PIECE_S)
        pressed = b""
        while not pressed:
            with contextlib.suppress(TimeoutError):
                pressed = line.recv(1)
                if not pressed:
                    return
            end = (time.monotonic_ns() - begin_ns) * rate_hz // 1_000_000_000
            data = self._samples(begin_ns, sample, end, rate_hz, wires)
            sample = end
            said = f"cli: Received SR_DF_LOGIC ({len(data)} bytes, unitsize = 1).\n"
            line.settimeout(None)
            line.sendall(_frame(b"e", said.encode()) + _frame(b"o", data))
            line.settimeout(PIECE_S)

    def _samples(
        self, begin_ns: int, first: int, end: int, rate_hz: int, wires: list[str]
    ) -> bytes:
        """Samples ``first`` to ``end`` of a capture: each channel's level since its last change."""
        with self._lock:
            start_ns = self._start_ns
        level, at, bits = 0, [], []
        for wire in wires:
            bit = int(wire[1:])
            times = self.tape.edges[WIRED[bit]]
            if start_ns is None:
                continue
            number = np.ceil((times + (start_ns - begin_ns)) * rate_hz / 1e9).astype(np.int64)
            low, high = np.searchsorted(number, (first, end))
            level |= (int(low) & 1) << bit
            at.append(number[low:high] - first)
            bits.append(np.full(high - low, 1 << bit, np.uint8))
        if not at or not sum(map(len, at)):
            return bytes([level]) * (end - first)
        when = np.concatenate(at)
        order = np.argsort(when, kind="stable")
        levels = np.bitwise_xor.accumulate(
            np.concatenate([np.array([level], np.uint8), np.concatenate(bits)[order]])
        )
        lengths = np.diff(np.concatenate([[0], when[order], [end - first]]))
        return bytes(np.repeat(levels, lengths).tobytes())


ROLES_EXCHANGED = dict(zip(ROLES, reversed(list(ROLES)), strict=True))


def _frame(kind: bytes, data: bytes) -> bytes:
    return struct.pack("<cI", kind, len(data)) + data
