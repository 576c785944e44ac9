# SPDX-License-Identifier: Apache-2.0
"""Live captures: sigrok's own demo device, really captured; and programs that misbehave."""

from __future__ import annotations

import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from captures import as_rows, edges_by_hand

from hil.bench.analyser import find, sigrok
from hil.bench.analyser.capture import Analyser, Progress
from hil.bench.analyser.edges import extract
from hil.bench.analyser.find import SigrokDevice, find_sigrok, parse_scan, scan_argv
from hil.bench.analyser.sigrok import SigrokAnalyser, capture_argv, start_of
from hil.bench.analyser.sr_file import open_sr
from hil.errors import RigError

FX2 = SigrokDevice("fx2lafw", "1.7", "Saleae Logic", tuple(f"D{n}" for n in range(8)))
DEMO = SigrokDevice("demo", "", "Demo device", tuple(f"D{n}" for n in range(8)))
WIRES = {"leader.radio_end": "D0", "leader.pulse": "D1", "follower.pulse": "D2"}


def test_the_command_line_of_a_capture() -> None:
    head = ["sigrok-cli", "--loglevel", "3", "--driver", "fx2lafw:conn=1.7"]
    set_up = ["--config", "samplerate=8000000", "--channels", "D0,D3"]
    wires = {"a": "D0", "b": "D3"}
    assert capture_argv(FX2, wires, 8_000_000, None) == [
        *(*head, *set_up, "--continuous", "-O", "binary")
    ]
    assert capture_argv(FX2, wires, 8_000_000, 500) == [
        *(*head, *set_up, "--samples", "500", "-O", "binary")
    ]
    assert scan_argv("fx2lafw") == ["sigrok-cli", "--driver", "fx2lafw", "--scan"]


def test_what_the_scan_prints() -> None:
    lines = [
        "The following devices were found:",
        "fx2lafw:conn=1.7 - Saleae Logic with 8 channels: D0 D1 D2 D3 D4 D5 D6 D7",
        "fx2lafw:conn=3.12 - sigrok FX2 LA (8ch) [S/N: 12] with 2 channels: D0 D1",
        "sr: fx2lafw: something else",
    ]
    assert parse_scan(lines) == [
        FX2,
        SigrokDevice("fx2lafw", "3.12", "sigrok FX2 LA (8ch) [S/N: 12]", ("D0", "D1")),
    ]


def test_none_and_several_analysers_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RigError, match="no analyser of driver 'fx2lafw'; found: none") as caught:
        find_sigrok("fx2lafw")
    assert "udev" in caught.value.mend
    monkeypatch.setattr(find, "parse_scan", lambda lines: [FX2, DEMO])
    with pytest.raises(RigError, match=r"2 analysers .* fx2lafw:conn=1\.7"):
        find_sigrok("fx2lafw")
    assert find_sigrok("fx2lafw", conn="1.7") == FX2


def test_a_capture_of_a_known_length_is_what_sigrok_prints(tmp_path: Path) -> None:
    device = find_sigrok("demo")
    path = tmp_path / "x.sr"
    edges = SigrokAnalyser(device, WIRES, 1_000_000).capture(20_000, path)
    said = subprocess.run(
        [
            *("sigrok-cli", "--driver", "demo", "--config", "samplerate=1000000"),
            *("--channels", "D0,D1,D2", "--samples", "20000"),
            *("-O", "bits"),
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    lines = [line.partition(":") for line in said.stdout.splitlines() if line[:1] == "D"]
    rows = [
        [int(bit) for name, _, bits in lines if name == wire for bit in bits.replace(" ", "")]
        for wire in WIRES.values()
    ]
    assert edges.samples == len(rows[0]) == 20_000
    assert as_rows(edges) == edges_by_hand(np.array(rows).T)
    archived = open_sr(path)
    assert archived.samplerate_hz == 1e6
    assert archived.channels == {name: int(wire[1:]) for name, wire in WIRES.items()}
    assert as_rows(extract(archived)) == as_rows(edges)


def test_a_capture_of_unknown_length_ends_when_told_to() -> None:
    analyser: Analyser
    with SigrokAnalyser(DEMO, WIRES, 1_000_000) as analyser:
        before_ns = time.monotonic_ns()
        analyser.start()
        started_ns = time.monotonic_ns()
        time.sleep(1.0)
        edges = analyser.stop()
        ended_ns = time.monotonic_ns()
        assert edges.start is not None
        assert edges.progress is not None
        low = edges.start.t_ns_host - edges.start.uncertainty_ns
        high = edges.start.t_ns_host + edges.start.uncertainty_ns
        assert before_ns <= low <= high <= started_ns
        assert 0.5 <= edges.duration_s <= (ended_ns - before_ns) / 1e9
        assert edges.progress.samples[-1] == edges.samples
        assert np.all(np.diff(edges.progress.t_ns_host) > 0)
        # And again, with the same object.
        analyser.start()
        assert analyser.stop().samples > 0


def test_using_it_wrongly() -> None:
    with pytest.raises(RigError, match="has no channel 'D9'"):
        SigrokAnalyser(DEMO, {"a": "D9"}, 1000)
    with SigrokAnalyser(DEMO, WIRES, 100_000) as analyser:
        with pytest.raises(RigError, match="not capturing"):
            analyser.stop()
        analyser.start()
        with pytest.raises(RigError, match="capturing already"):
            analyser.start()


def test_leaving_the_block_ends_the_program_and_leaves_no_file(tmp_path: Path) -> None:
    path = tmp_path / "x.sr"
    with SigrokAnalyser(DEMO, WIRES, 100_000) as analyser:
        analyser.start(path)
        assert analyser._run is not None
        child = analyser._run._child
    assert child.exit_status() is not None
    assert not path.exists()


def test_an_analyser_that_is_not_there_is_told_in_sigroks_words(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="ended before the first sample") as caught:
        SigrokAnalyser(FX2, {"a": "D0"}, 8_000_000).start(tmp_path / "x.sr")
    assert "No devices found" in caught.value.message


FAKE = """#!{python}
import os, sys, time
def say(text): print(text, file=sys.stderr, flush=True)
def samples(count, announced=None, unitsize=1):
    say(f"cli: Received SR_DF_LOGIC ({{count if announced is None else announced}} bytes, "
        f"unitsize = {{unitsize}}).")
    sys.stdout.buffer.write(bytes(count)); sys.stdout.buffer.flush()
def key(): os.read(0, 1)
{body}
"""


def faked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, rate_hz: int = 1000
) -> SigrokAnalyser:
    """An analyser whose sigrok-cli behaves as ``body`` says."""
    program = tmp_path / "sigrok-cli"
    program.write_text(FAKE.format(python=sys.executable, body=body))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(sigrok, "PROGRAM", str(program))
    return SigrokAnalyser(DEMO, {"a": "D0"}, rate_hz, limit_s=20.0)


def test_the_fake_can_succeed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with faked(tmp_path, monkeypatch, "time.sleep(0.3); samples(100); key()") as analyser:
        analyser.start()
        assert analyser.stop().samples == 100


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("time.sleep(0.3); samples(99, announced=100); key()", "announced 100 bytes .* 99 came"),
        ("time.sleep(0.3); samples(10); samples(10, unitsize=2); key()", "changed the width"),
        ("time.sleep(0.3); samples(10); key(); say('usb: gone'); sys.exit(3)", "exit status 3"),
        ("samples(2000); key()", "too many for 1000 Hz"),
    ],
)
def test_damaged_captures_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, what: str
) -> None:
    with faked(tmp_path, monkeypatch, body) as analyser:
        analyser.start()
        time.sleep(0.2)
        with pytest.raises(RigError, match=what):
            analyser.stop()


def test_a_capture_that_ends_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = "time.sleep(0.3); samples(10); say('sr: fx2lafw: USB transfer failed')"
    with faked(tmp_path, monkeypatch, body) as analyser:
        analyser.start()
        time.sleep(1.0)
        with pytest.raises(RigError, match="ended by itself") as caught:
            analyser.stop()
    assert "USB transfer failed" in caught.value.message


def test_a_short_capture_names_how_many_came(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        faked(tmp_path, monkeypatch, "time.sleep(0.3); samples(90)") as analyser,
        pytest.raises(RigError, match="came short: 90 samples of 100"),
    ):
        analyser.capture(100)


def test_a_capture_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    analyser = faked(tmp_path, monkeypatch, "time.sleep(1000)")
    analyser._limit_s = 0.5
    with analyser, pytest.raises(RigError, match=r"no sample in time|before the first sample"):
        analyser.start()


def test_a_capture_that_does_not_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sigrok, "STOP_LIMIT_S", 0.5)
    body = "time.sleep(0.3); samples(10); time.sleep(1000)"
    with faked(tmp_path, monkeypatch, body) as analyser:
        analyser.start()
        with pytest.raises(RigError, match="did not end when told to"):
            analyser.stop()


def test_the_start_is_bounded_by_the_spawn_and_by_the_quickest_piece() -> None:
    """Spawned at 0; first sample at 100 ms; pieces come 3, 1 and 9 ms late."""
    t_ns = np.array([203, 301, 409]) * 1_000_000
    progress = Progress(t_ns, np.array([100, 200, 300]))
    start = start_of(progress, 0, 1000)
    assert (start.t_ns_host, start.uncertainty_ns) == (50_500_000, 50_500_000)
    with pytest.raises(RigError, match="too many for 1000 Hz"):
        start_of(progress, 102_000_000, 1000)
