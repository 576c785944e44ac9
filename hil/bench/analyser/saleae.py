# SPDX-License-Identifier: Apache-2.0
"""Live captures of a Saleae analyser, through the automation server of its Logic 2 application.

The library (``logic2-automation``) is an extra; it is loaded only when an analyser is started.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hil.bench.analyser.capture import CaptureEdges, Start
from hil.bench.analyser.edges import renamed
from hil.bench.analyser.saleae_csv import read_saleae_csv
from hil.errors import RigError
from hil.process import scratch

MODULE = "saleae.automation"
PORT = 10430
CONNECT_LIMIT_S = 5.0
BUFFER_MB = 4096


class SaleaeAnalyser:
    """One Saleae analyser; a context manager that closes its capture.

    Args:
        wires: our channel name -> digital input: ``{"leader.pulse": 1}``.
        samplerate_hz: a digital rate that Logic 2 offers for so many inputs.
        device_id: which analyser; the application's choice when empty.
        threshold_volts: Pro models: 1.2, 1.8 or 3.3.
        address, port: of the application's automation server.
    """

    def __init__(
        self,
        wires: Mapping[str, int],
        samplerate_hz: int,
        *,
        device_id: str = "",
        threshold_volts: float | None = None,
        address: str = "127.0.0.1",
        port: int = PORT,
    ) -> None:
        self._wires = dict(wires)
        self._samplerate_hz = samplerate_hz
        self._device_id = device_id
        self._threshold_volts = threshold_volts
        self._address = address
        self._port = port
        self._manager: Any = None
        self._capture: Any = None
        self._archive: Path | None = None
        self._start = Start(0, 0)

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
        """Capture until :meth:`stop`.

        Args:
            archive: where Logic 2 saves the capture, in its own format (.sal).

        Raises:
            RigError: already capturing; no library, no application, or no analyser.
        """
        if self._capture is not None:
            raise RigError("the Saleae analyser is capturing already", "stop it first")
        automation = _library()
        self._archive = archive
        with _asking("to connect"):
            if self._manager is None:
                self._manager = automation.Manager.connect(
                    address=self._address,
                    port=self._port,
                    connect_timeout_seconds=CONNECT_LIMIT_S,
                )
        before_ns = time.monotonic_ns()
        with _asking("to start a capture"):
            self._capture = self._manager.start_capture(
                device_id=self._device_id or None,
                device_configuration=automation.LogicDeviceConfiguration(
                    enabled_digital_channels=list(self._wires.values()),
                    digital_sample_rate=self._samplerate_hz,
                    digital_threshold_volts=self._threshold_volts,
                ),
                capture_configuration=automation.CaptureConfiguration(
                    buffer_size_megabytes=BUFFER_MB,
                    capture_mode=automation.ManualCaptureMode(),
                ),
            )
        after_ns = time.monotonic_ns()
        self._start = Start((before_ns + after_ns) // 2, (after_ns - before_ns + 1) // 2)

    def stop(self) -> CaptureEdges:
        """End the capture; it lasts, for the rig, to its last edge.

        Raises:
            RigError: not capturing, or the application failed.
            RecordingError: its export cannot be read.
        """
        if self._capture is None:
            raise RigError("the Saleae analyser is not capturing", "start it first")
        try:
            with scratch("saleae") as folder:
                with _asking("to end and export the capture"):
                    self._capture.stop()
                    if self._archive is not None:
                        self._capture.save_capture(filepath=str(self._archive.absolute()))
                    self._capture.export_raw_data_csv(
                        directory=str(folder), digital_channels=list(self._wires.values())
                    )
                table = folder / "digital.csv"
                edges = read_saleae_csv(table, samplerate_hz=self.samplerate_hz)
        finally:
            self._close_capture()
        names = {f"Channel {number}": name for name, number in self._wires.items()}
        return replace(renamed(edges, names), start=self._start)

    def close(self) -> None:
        """End a running capture, throw it away, and let go of the application."""
        self._close_capture(running=True)
        manager, self._manager = self._manager, None
        if manager is not None:
            manager.close()

    def _close_capture(self, *, running: bool = False) -> None:
        capture, self._capture = self._capture, None
        if capture is not None:
            with _asking("to close the capture"):
                if running:
                    capture.stop()
                capture.close()


def _library() -> Any:
    try:
        return importlib.import_module(MODULE)
    except ImportError as error:
        raise RigError(
            f"the library for Saleae analysers cannot be loaded ({error})",
            "pip install 'hil[saleae]'",
        ) from error


@contextmanager
def _asking(what: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        # The library lets errors of gRPC through, which is not ours to import.
        raise RigError(
            f"Logic 2 was asked {what} and failed: {type(error).__name__}: {error}",
            "start the Logic 2 application\n"
            f"enable its automation server (Preferences, port {PORT}), or start it with "
            "--automation\n"
            "connect the analyser and choose a rate that Logic 2 offers for these inputs",
        ) from error
