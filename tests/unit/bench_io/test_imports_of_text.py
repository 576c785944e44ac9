# SPDX-License-Identifier: Apache-2.0
"""VCD, Saleae CSV and raw files: known contents, another program's output, and hostile ones."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from captures import as_rows, in_memory

from hil.bench.analyser import edges as edges_module
from hil.bench.analyser.edges import extract
from hil.bench.analyser.raw import open_raw
from hil.bench.analyser.saleae_csv import read_saleae_csv
from hil.bench.analyser.sr_file import write_sr
from hil.bench.analyser.vcd import read_vcd
from hil.errors import RecordingError

VCD = """$date today $end
$version a pen $end
$comment by hand,
  over two lines $end
$timescale 10 ns $end
$scope module top $end
$var wire 1 ! pulse $end
$var wire 8 bus data $end
$scope module inner $end
$var reg 1 " pulse $end
$var wire 1 # end [0] $end
$upscope $end
$upscope $end
$enddefinitions $end
$dumpvars
x!
0"
bxxxxxxxx bus
1#
$end
#100 0!
#250 1! 1"
b00001111 bus
r1.5 other
#300
b0 #
#1000
"""
"""At 10 MHz a sample is ten units: changes at samples 25 and 30, the end is sample 100."""


def test_a_dump_written_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "x.vcd"
    path.write_text(VCD)
    edges = read_vcd(path, samplerate_hz=10e6)
    assert edges.channels == ("top.pulse", "top.inner.pulse", "end")
    assert edges.initial.tolist() == [0, 0, 1]
    assert as_rows(edges) == [(25, 0, 1), (25, 1, 1), (30, 2, 0)]
    assert edges.samples == 101


def test_a_dump_written_by_sigrok_has_the_edges_of_its_samples(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    words = np.repeat(rng.integers(0, 4, 3000).astype(np.uint8), rng.integers(1, 50, 3000))
    session, dump = tmp_path / "x.sr", tmp_path / "x.vcd"
    capture = in_memory(words, {"a": 0, "b": 1}, 8e6)
    write_sr(session, capture)
    subprocess.run(
        ["sigrok-cli", "-i", str(session), "-O", "vcd", "-o", str(dump)], check=True, timeout=60
    )
    assert as_rows(read_vcd(dump, samplerate_hz=8e6)) == as_rows(extract(capture))


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("#300", "#200", "line 25: time goes back"),
        ("#300", "#305", r"line 25: a time lies [+-]0.50 samples beside"),
        ("#300", "#-5", "line 25: a time '-5'"),
        ("#300", "#" + "9" * 20, "further than a capture lasts"),
        ("#300", "#" + "9" * 30, "a time"),
        ("#300", "#300 z!", "line 25: a level 'z', where 0 or 1 was before"),
        ("#300", "#300 hello", "line 25: 'hello' is no value change"),
        ("#300", "$var wire 1 ? late $end", "among the value changes"),
        ("$timescale 10 ns $end", "", "no .timescale"),
        ("$timescale 10 ns $end", "$timescale 3 ns $end", "line 5: a .timescale"),
        ("$timescale 10 ns $end", "$timescale 1 us $end", "cannot tell samples"),
        ("$var wire 1 ! pulse $end", "$var wire 1 $end", "line 7: a .var without"),
        ("$enddefinitions $end", "", "where the header should be"),
        ("#300", "#300 " + "0! " * 30_000, "line 25: a line of 65536 bytes"),
    ],
)
def test_hostile_dumps(tmp_path: Path, old: str, new: str, what: str) -> None:
    path = tmp_path / "x.vcd"
    path.write_text(VCD.replace(old, new))
    with pytest.raises(RecordingError, match=what):
        read_vcd(path, samplerate_hz=10e6)


def test_a_dump_cut_in_its_header_or_empty(tmp_path: Path) -> None:
    path = tmp_path / "x.vcd"
    for length in range(0, VCD.index("$enddefinitions $end") + 14, 5):
        path.write_text(VCD[:length])
        with pytest.raises(RecordingError, match=r"cut|header"):
            read_vcd(path, samplerate_hz=10e6)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_vcd(tmp_path / "gone.vcd", samplerate_hz=10e6)


def test_more_variables_than_channels_or_none(tmp_path: Path) -> None:
    path = tmp_path / "x.vcd"
    head, tail = "$timescale 1 ns $end\n", "$enddefinitions $end\n#0\n"
    path.write_text(head + "".join(f"$var wire 1 v{n} n{n} $end\n" for n in range(65)) + tail)
    with pytest.raises(RecordingError, match="more than 64 channels"):
        read_vcd(path, samplerate_hz=1e6)
    path.write_text(head + "".join(f"$var wire 1 v{n} n{n} $end\n" for n in range(5000)) + tail)
    with pytest.raises(RecordingError, match="more than 4096 variables"):
        read_vcd(path, samplerate_hz=1e6)
    path.write_text(head + "$var wire 8 v n $end\n" + tail)
    with pytest.raises(RecordingError, match="no variable of one bit"):
        read_vcd(path, samplerate_hz=1e6)


def test_text_cannot_fill_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edges_module, "TEXT_CHANGES_MAX", 10)
    path = tmp_path / "x.csv"
    rows = "".join(f"{n * 1e-6:.9f},{n & 1}\n" for n in range(20))
    path.write_text("Time [s],Channel 0\n" + rows)
    with pytest.raises(RecordingError, match="line 13: more than 10 changes"):
        read_saleae_csv(path, samplerate_hz=1e6)


CSV = """Time [s],Channel 0,Channel 5
-0.000001000,0,1
0.000000500,1,1
0.000000750,1,0
0.000000750,0,0
0.002000000,0,1
"""
"""At 4 MHz, from the first row on: samples 0, 6, 7, 7, 8004."""


def test_an_export_written_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "digital.csv"
    path.write_bytes(("\ufeff" + CSV).replace("\n", "\r\n").encode())
    edges = read_saleae_csv(path, samplerate_hz=4e6)
    assert edges.channels == ("Channel 0", "Channel 5")
    assert edges.initial.tolist() == [0, 1]
    assert as_rows(edges) == [(6, 0, 1), (7, 1, 0), (7, 0, 0), (8004, 1, 1)]


def test_times_printed_in_whole_nanoseconds_fit_a_rate_that_is_not(tmp_path: Path) -> None:
    """12 MHz has samples every 83.33 ns."""
    path = tmp_path / "digital.csv"
    at = [0, 1, 5, 1000, 12_000_001]
    rows = "".join(f"{k / 12e6:.9f},{i & 1}\n" for i, k in enumerate(at))
    path.write_text("Time [s],Channel 0\n" + rows)
    assert read_saleae_csv(path, samplerate_hz=12e6).sample.tolist() == at[1:]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("Time [s]", "Time", "line 1: no 'Time"),
        ("Time [s],Channel 0,Channel 5", "Time [s]", "line 1: no 'Time"),
        ("0.000000750,1,0", "0.000000250,1,0", "line 4: time goes back"),
        ("0.000000750,1,0", "0.000000650,1,0", "line 4: a time lies"),
        ("0.000000750,1,0", "soon,1,0", "line 4: 'soon' is no time"),
        ("0.000000750,1,0", "2024-01-01T00:00:00,1,0", "line 4: .* is no time"),
        ("0.000000750,1,0", "9e99,1,0", "line 4: '9e99' is no time"),
        ("0.000000750,1,0", "0.000000750,1", "line 4: not a time and 2 levels"),
        ("0.000000750,1,0", "0.000000750,1,2", "line 4: not a time and 2 levels"),
        ("0.000000750,1,0", "1" * 5000, "line 4: a line of 4096 bytes"),
        (CSV[CSV.index("\n") :], "\n", "no row follows"),
    ],
)
def test_hostile_exports(tmp_path: Path, old: str, new: str, what: str) -> None:
    path = tmp_path / "digital.csv"
    path.write_text(CSV.replace(old, new, 1))
    with pytest.raises(RecordingError, match=what):
        read_saleae_csv(path, samplerate_hz=4e6)


def test_a_rate_finer_than_the_printed_times_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "digital.csv"
    path.write_text(CSV)
    with pytest.raises(RecordingError, match="cannot tell samples at 2e\\+09 Hz apart"):
        read_saleae_csv(path, samplerate_hz=2e9)


def test_a_raw_file(tmp_path: Path) -> None:
    path = tmp_path / "x.bin"
    path.write_bytes(bytes([0, 1, 3, 3, 2]))
    edges = extract(open_raw(path, samplerate_hz=1e6, channels={"a": 0, "b": 1}))
    assert as_rows(edges) == [(1, 0, 1), (2, 1, 1), (4, 0, 0)]
    with pytest.raises(RecordingError, match=r"no.* whole number of samples of 2 bytes"):
        open_raw(path, samplerate_hz=1e6, channels={"a": 0}, unitsize=2)
    with pytest.raises(RecordingError, match="cannot be read"):
        open_raw(tmp_path / "gone", samplerate_hz=1e6, channels={"a": 0})
    with pytest.raises(RecordingError, match="Hz cannot be"):
        open_raw(path, samplerate_hz=-1, channels={"a": 0})
    path.write_bytes(b"")
    with pytest.raises(RecordingError, match="0 bytes"):
        open_raw(path, samplerate_hz=1e6, channels={"a": 0})
