# SPDX-License-Identifier: Apache-2.0
"""Live captures through ``sigrok-cli``, streamed while they run.

What the program does, and how it is used (version 0.7.2):

- ``-O binary`` goes to standard output; ``-o -`` would write a file called ``-``.
- With ``--continuous`` any key ends the capture in order. An input at its end counts as a key
  that is pressed at once, so standard input is a pipe that stays open until :meth:`stop`.
- Log level 3 announces each packet with its size and unit size. That tells how wide a sample is,
  which differs between drivers and channels, and that no byte was lost on the way.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from hil.bench.analyser.capture import CaptureEdges, Progress, Start
from hil.bench.analyser.edges import EdgeExtractor
from hil.bench.analyser.find import INSTALL, PROGRAM, SigrokDevice
from hil.bench.analyser.sr_file import SrWriter
from hil.errors import HilError, RigError
from hil.process import Child

LOG_LEVEL = 3
ANY_KEY = b"q"
LAYOUT_LIMIT_S = 5.0
STOP_LIMIT_S = 10.0
MARK_EVERY_NS = 20_000_000
START_WINDOW_NS = 1_000_000_000
"""A crystal off by 100 ppm moves the start by less than 0.1 us within this."""

PACKET = re.compile(r"cli: Received SR_DF_LOGIC \((\d+) bytes, unitsize = (\d+)\)\.")
CHATTER = ("cli: Received SR_DF_", "sr: session:", "Press any key")


def capture_argv(
    device: SigrokDevice,
    wires: Mapping[str, str],
    samplerate_hz: int,
    samples: int | None,
) -> list[str]:
    """The command line of a capture, of ``samples`` samples or until a key is pressed."""
    return [
        *(PROGRAM, "--loglevel", str(LOG_LEVEL), "--driver", device.spec),
        *("--config", f"samplerate={samplerate_hz}", "--channels", ",".join(wires.values())),
        *(("--continuous",) if samples is None else ("--samples", str(samples))),
        *("-O", "binary"),
    ]


class SigrokAnalyser:
    """One analyser of sigrok's; a context manager that ends its capture.

    Args:
        device: as :func:`hil.bench.analyser.find.find_sigrok` finds it.
        wires: our channel name -> the device's: ``{"leader.pulse": "D1"}``.
        samplerate_hz: one of the rates of the device.
        limit_s: a capture is ended after this long.

    Raises:
        RigError: the device has not such a channel.
    """

    def __init__(
        self,
        device: SigrokDevice,
        wires: Mapping[str, str],
        samplerate_hz: int,
        *,
        limit_s: float = 3600.0,
    ) -> None:
        unknown = [wire for wire in wires.values() if wire not in device.channels]
        if unknown or not wires:
            raise RigError(
                f"{device.spec} has no channel '{', '.join(unknown)}'",
                "its channels: " + ", ".join(device.channels),
            )
        self._device = device
        self._wires = dict(wires)
        self._bits = {name: device.channels.index(wire) for name, wire in wires.items()}
        self._samplerate_hz = samplerate_hz
        self._limit_s = limit_s
        self._run: _Run | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(self._wires)

    @property
    def samplerate_hz(self) -> float:
        return float(self._samplerate_hz)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def start(self, archive: Path | None = None) -> None:
        """Capture until :meth:`stop`; returns when the first samples have come.

        Args:
            archive: where the samples are kept, as a session file (.sr).

        Raises:
            RigError: already capturing, sigrok-cli or the analyser is not there, or no sample
                came.
        """
        self._begin(None, archive)
        assert self._run is not None
        self._run.await_samples()

    def stop(self) -> CaptureEdges:
        """End the capture.

        Raises:
            RigError: not capturing, or the capture ended by itself, came short or is damaged.
        """
        run, self._run = self._running(), None
        with run:
            return run.stop()

    def capture(self, samples: int, archive: Path | None = None) -> CaptureEdges:
        """Capture exactly ``samples`` samples.

        Raises:
            RigError: as :meth:`start` and :meth:`stop`; or fewer came, and how many.
        """
        self._begin(samples, archive)
        run, self._run = self._running(), None
        with run:
            return run.await_end()

    def close(self) -> None:
        run, self._run = self._run, None
        if run is not None:
            with run:
                pass

    def _begin(self, samples: int | None, archive: Path | None) -> None:
        if self._run is not None:
            raise RigError(f"{self._device.spec} is capturing already", "stop it first")
        argv = capture_argv(self._device, self._wires, self._samplerate_hz, samples)
        self._run = _Run(
            argv,
            bits=self._bits,
            samplerate_hz=self._samplerate_hz,
            samples=samples,
            limit_s=self._limit_s,
            archive=archive,
        )

    def _running(self) -> _Run:
        if self._run is None:
            raise RigError(f"{self._device.spec} is not capturing", "start it first")
        return self._run


class _Run:
    """One capture: the program, what it says, and the samples on their way to edges."""

    def __init__(
        self,
        argv: list[str],
        *,
        bits: Mapping[str, int],
        samplerate_hz: int,
        samples: int | None,
        limit_s: float,
        archive: Path | None,
    ) -> None:
        self._bits = bits
        self._rate_hz = samplerate_hz
        self._wanted = samples
        self._extractor: EdgeExtractor | None = None
        self._unitsize = 0
        self._announced = 0
        self._received = 0
        self._complaint = ""
        self._layout_known = threading.Event()
        self._flowing = threading.Event()
        self._marks: list[tuple[int, int]] = []
        self._latest = (0, 0)
        self._writer = None if archive is None else SrWriter(archive)
        self._spawn_ns_host = time.monotonic_ns()
        self._deadline_s = time.monotonic() + limit_s
        try:
            self._child = Child(
                argv, name="the capture", on_bytes=self._take, hold_input=True, mend=INSTALL
            )
        except HilError:
            if self._writer is not None:
                self._writer.close()
            raise
        self._listener = threading.Thread(target=self._listen, name="capture log", daemon=True)
        self._listener.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._child.stop(grace_s=0.0)
        self._listener.join(STOP_LIMIT_S)
        if self._writer is not None:
            self._writer.close()

    def await_samples(self) -> None:
        while not self._flowing.wait(0.05):
            if self._child.exit_status() is not None and not self._flowing.wait(1.0):
                raise self._failed("ended before the first sample")
            if time.monotonic() > self._deadline_s:
                raise self._failed("brought no sample in time")

    def stop(self) -> CaptureEdges:
        if self._child.exit_status() is not None:
            raise self._failed("ended by itself")
        self._child.send(ANY_KEY)
        try:
            self._child.wait(STOP_LIMIT_S)
        except TimeoutError:
            raise self._failed("did not end when told to") from None
        return self._edges()

    def await_end(self) -> CaptureEdges:
        try:
            self._child.wait(max(self._deadline_s - time.monotonic(), 0.0))
        except TimeoutError:
            raise self._failed("was still running when its time was up") from None
        return self._edges()

    def _take(self, piece: bytes) -> None:
        """In the thread that reads standard output."""
        t_ns_host = time.monotonic_ns()
        if self._extractor is None:
            # The packet was announced before it was written, on another pipe.
            if not self._layout_known.wait(LAYOUT_LIMIT_S):
                raise RigError(
                    "sigrok-cli did not say how wide its samples are",
                    "use sigrok-cli 0.7.2 or newer",
                )
            self._extractor = EdgeExtractor(self._bits, self._unitsize)
        self._received += len(piece)
        self._extractor.feed(piece)
        if self._writer is not None:
            self._writer.write(piece)
        self._latest = (t_ns_host, self._extractor.samples)
        if not self._marks or t_ns_host - self._marks[-1][0] >= MARK_EVERY_NS:
            self._marks.append(self._latest)
        self._flowing.set()

    def _listen(self) -> None:
        """In a thread of its own: packets announced, and the time limit."""
        while True:
            try:
                line = self._child.next_line(0.2)
            except TimeoutError:
                line = ""
            if line is None:
                return
            if match := PACKET.fullmatch(line):
                size, unitsize = int(match[1]), int(match[2])
                self._announced += size
                if self._unitsize not in (0, unitsize):
                    self._complaint = "changed the width of its samples"
                self._unitsize = unitsize
                self._layout_known.set()
            if time.monotonic() > self._deadline_s and self._child.exit_status() is None:
                self._complaint = "ran into its time limit"
                self._child.stop(grace_s=0.0)
                return

    def _edges(self) -> CaptureEdges:
        status = self._child.stop()
        self._listener.join(STOP_LIMIT_S)
        if isinstance(self._child.refusal, HilError):
            raise self._child.refusal
        if self._child.refusal is not None:
            raise self._failed(f"could not be taken: {self._child.refusal}")
        if self._complaint:
            raise self._failed(self._complaint)
        if status != 0:
            raise self._failed(f"failed with exit status {status}")
        if self._extractor is None:
            raise self._failed("brought no sample")
        if self._received != self._announced:
            raise self._failed(
                f"announced {self._announced} bytes of samples, of which {self._received} came"
            )
        came = self._extractor.samples
        if self._wanted is not None and came != self._wanted:
            raise self._failed(f"came short: {came} samples of {self._wanted}")
        marks = [*self._marks, self._latest] if self._latest != self._marks[-1] else self._marks
        table = np.array(marks, dtype=np.int64)
        progress = Progress(table[:, 0].copy(), table[:, 1].copy())
        start = start_of(progress, self._spawn_ns_host, self._rate_hz)
        edges = self._extractor.finish(float(self._rate_hz), progress=progress, start=start)
        if self._writer is not None:
            self._writer.describe(float(self._rate_hz), self._bits, self._unitsize)
        return edges

    def _failed(self, what: str) -> RigError:
        self._child.stop(grace_s=0.0)
        said = [line for line in self._child.lines if line and not line.startswith(CHATTER)]
        words = "\n".join(f"    {line}" for line in said[-20:]) or "    (it said nothing)"
        return RigError(
            f"the capture {what}; last words of {PROGRAM}:\n{words}",
            "connect the analyser to a USB port of its own, not through a hub\n"
            "lower the sample rate\n"
            f"try by hand: {' '.join(self._child.argv)}",
        )


def start_of(progress: Progress, spawn_ns_host: int, samplerate_hz: float) -> Start:
    """When the first sample was taken.

    Not before the program was started, and not later than any piece's arrival less the time that
    its samples took.

    Raises:
        RigError: more samples came than the time allows.
    """
    early = progress.t_ns_host <= progress.t_ns_host[0] + START_WINDOW_NS
    taken_ns = np.rint(progress.samples[early] * 1e9 / samplerate_hz).astype(np.int64)
    latest = int(np.min(progress.t_ns_host[early] - taken_ns))
    if latest < spawn_ns_host:
        came, passed_s = progress.samples[early][-1], progress.t_ns_host[early][-1] - spawn_ns_host
        raise RigError(
            f"{came} samples came within {passed_s / 1e9:.3f} s, too many for "
            f"{samplerate_hz:g} Hz: the analyser samples faster, or its buffer held old samples",
            "set a rate that the analyser has: sigrok-cli --driver ... --show",
        )
    return Start((spawn_ns_host + latest) // 2, (latest - spawn_ns_host + 1) // 2)
