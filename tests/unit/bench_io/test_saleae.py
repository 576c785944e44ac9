# SPDX-License-Identifier: Apache-2.0
"""Saleae's application, played by a fake that records what it is asked."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest
from captures import as_rows

from hil.bench.analyser.capture import Analyser
from hil.bench.analyser.saleae import SaleaeAnalyser
from hil.errors import RigError

CSV = "Time [s],Channel 2,Channel 5\n0.000000000,0,1\n0.000001000,1,1\n0.000002000,1,0\n"
"""At 8 MHz: channel 2 rises at sample 8, channel 5 falls at sample 16."""


class Application(types.ModuleType):
    """Looks like ``saleae.automation``; ``calls`` is what it was asked, ``fails`` what fails."""

    def __init__(self, fails: str = "") -> None:
        super().__init__("saleae.automation")
        self.calls: list[tuple[str, dict[str, Any]]] = []
        self.fails = fails
        self.Manager = types.SimpleNamespace(connect=self._answer("connect", self))
        for name in ("LogicDeviceConfiguration", "CaptureConfiguration", "ManualCaptureMode"):
            setattr(self, name, lambda _name=name, **options: (_name, options))
        self.start_capture = self._answer("start_capture", self)
        for name in ("stop", "close", "save_capture"):
            setattr(self, name, self._answer(name, None))

    def _answer(self, name: str, result: Any) -> Any:
        def call(**options: Any) -> Any:
            self.calls.append((name, options))
            if name == self.fails:
                raise ConnectionError("failed to connect to all addresses")
            return result

        return call

    def export_raw_data_csv(self, *, directory: str, digital_channels: list[int]) -> None:
        self.calls.append(("export", {"digital_channels": digital_channels}))
        Path(directory, "digital.csv").write_text(CSV)


def installed(monkeypatch: pytest.MonkeyPatch, fails: str = "") -> Application:
    application = Application(fails)
    monkeypatch.setitem(sys.modules, "saleae", types.ModuleType("saleae"))
    monkeypatch.setitem(sys.modules, "saleae.automation", application)
    return application


WIRES = {"follower.pulse": 5, "leader.pulse": 2}


def test_a_capture_from_start_to_stop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    application = installed(monkeypatch)
    analyser: Analyser
    with SaleaeAnalyser(WIRES, 8_000_000, device_id="F4241", threshold_volts=1.8) as analyser:
        analyser.start(tmp_path / "x.sal")
        edges = analyser.stop()
    assert edges.channels == analyser.channels == ("follower.pulse", "leader.pulse")
    assert edges.samplerate_hz == 8e6
    assert as_rows(edges) == [(8, 1, 1), (16, 0, 0)]
    assert edges.start is not None
    assert application.calls == [
        ("connect", {"address": "127.0.0.1", "port": 10430, "connect_timeout_seconds": 5.0}),
        (
            "start_capture",
            {
                "device_id": "F4241",
                "device_configuration": (
                    "LogicDeviceConfiguration",
                    {
                        "enabled_digital_channels": [5, 2],
                        "digital_sample_rate": 8_000_000,
                        "digital_threshold_volts": 1.8,
                    },
                ),
                "capture_configuration": (
                    "CaptureConfiguration",
                    {"buffer_size_megabytes": 4096, "capture_mode": ("ManualCaptureMode", {})},
                ),
            },
        ),
        ("stop", {}),
        ("save_capture", {"filepath": str(tmp_path / "x.sal")}),
        ("export", {"digital_channels": [5, 2]}),
        ("close", {}),
        ("close", {}),
    ]


def test_leaving_the_block_throws_a_running_capture_away(monkeypatch: pytest.MonkeyPatch) -> None:
    application = installed(monkeypatch)
    with SaleaeAnalyser(WIRES, 8_000_000) as analyser:
        analyser.start()
        with pytest.raises(RigError, match="capturing already"):
            analyser.start()
    assert [name for name, _ in application.calls][2:] == ["stop", "close", "close"]


@pytest.mark.parametrize(
    ("fails", "what"), [("connect", "to connect"), ("start_capture", "to start a capture")]
)
def test_an_application_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, fails: str, what: str
) -> None:
    installed(monkeypatch, fails)
    with pytest.raises(RigError, match=f"asked {what} and failed: ConnectionError") as caught:
        SaleaeAnalyser(WIRES, 8_000_000).start()
    assert "automation server" in caught.value.mend


def test_a_failed_export_still_closes_the_capture(monkeypatch: pytest.MonkeyPatch) -> None:
    application = installed(monkeypatch, "stop")
    analyser = SaleaeAnalyser(WIRES, 8_000_000)
    analyser.start()
    with pytest.raises(RigError, match="to end and export"):
        analyser.stop()
    assert application.calls[-1][0] == "close"
    with pytest.raises(RigError, match="not capturing"):
        analyser.stop()


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "saleae.automation", None)
    with pytest.raises(RigError, match="cannot be loaded") as caught:
        SaleaeAnalyser(WIRES, 8_000_000).start()
    assert "hil[saleae]" in caught.value.mend
