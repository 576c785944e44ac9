# SPDX-License-Identifier: Apache-2.0
"""Session files: real ones against sigrok-cli, our own read by sigrok-cli, and hostile ones."""

from __future__ import annotations

import io
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from captures import as_rows, edges_by_hand, in_memory, levels_by_sigrok

from hil.bench.analyser.edges import extract
from hil.bench.analyser.sr_file import SrWriter, open_sr, write_sr
from hil.errors import RecordingError

ROOT = Path(__file__).parents[3]
FOLDER = Path(os.environ.get("HIL_DATA", ROOT.parent / "shared" / "data")) / "sigrok"

RATES_HZ = {
    "adxl345_axis": 2e6,
    "adxl345_registers": 2e6,
    "nrf24l01-communication-rx": 12e6,
    "nrf24l01-communication-tx": 12e6,
    "pwmtest_snippet": 24e6,
    "rotary-ramp": 1e6,
    "rotary-sin": 1e6,
    "rtc_ds1307_200khz": 200e3,
    "smoothieware_snippet": 12e6,
}
"""Read off the files' metadata with unzip."""

METADATA = """[global]
sigrok version=0.5.2

[device 1]
capturefile=logic-1
total probes=8
samplerate=8 MHz
probe1=D0
unitsize=1
"""


def real(name: str) -> Path:
    path = FOLDER / f"{name}.sr"
    if not path.exists():
        pytest.skip(f"no session file at {path}; set HIL_DATA to the folder that holds sigrok/")
    return path


@pytest.mark.parametrize("name", RATES_HZ)
def test_real_files_have_the_edges_that_sigrok_sees(name: str) -> None:
    path = real(name)
    capture = open_sr(path)
    assert capture.samplerate_hz == RATES_HZ[name]
    edges = extract(capture)
    rows = levels_by_sigrok(path)
    assert edges.samples == len(rows)
    assert edges.initial.tolist() == rows[0].tolist()
    assert as_rows(edges) == edges_by_hand(rows)
    assert len(edges) > 100


def test_a_real_file_without_a_rate_says_what_to_pass() -> None:
    path = real("graycode-ramp-no-samplerate")
    with pytest.raises(RecordingError, match="does not say its sample rate") as caught:
        open_sr(path)
    assert "samplerate_hz=" in caught.value.mend
    edges = extract(open_sr(path, samplerate_hz=50e3))
    assert edges.samplerate_hz == 50e3
    assert as_rows(edges) == edges_by_hand(levels_by_sigrok(path))


@pytest.mark.parametrize("dtype", ["<u1", "<u2"])
def test_what_is_written_is_read_back_and_by_sigrok(tmp_path: Path, dtype: str) -> None:
    rng = np.random.default_rng(5)
    words = np.repeat(rng.integers(0, 256, 60_000), 100).astype(dtype)
    channels = {"leader.pulse": 0, "follower.pulse": 5}
    capture = in_memory(words, channels, 8e6)
    path = tmp_path / "capture.sr"
    write_sr(path, capture)
    with zipfile.ZipFile(path) as archive:
        assert len([n for n in archive.namelist() if n.startswith("logic-1-")]) > 1
    back = open_sr(path)
    assert back.samplerate_hz == 8e6
    assert back.channels == channels
    assert b"".join(back.pieces()) == words.tobytes()
    rows = levels_by_sigrok(path, "-C", "leader.pulse,follower.pulse")
    assert np.array_equal(rows, np.stack([words & 1, words >> 5 & 1], axis=1))


def test_a_name_may_hold_what_python_takes_for_the_end_of_a_line(tmp_path: Path) -> None:
    channels = {"a\x1eb": 0, "c\u2028d": 1}
    path = tmp_path / "capture.sr"
    write_sr(path, in_memory(np.zeros(8, dtype="<u1"), channels, 8e6))
    assert open_sr(path).channels == channels


def test_ten_chunks_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    path = session(tmp_path, chunks={f"logic-1-{n}": bytes([n]) for n in range(1, 13)})
    assert b"".join(open_sr(path).pieces()) == bytes(range(1, 13))


def test_a_file_without_a_description_does_not_stay(tmp_path: Path) -> None:
    path = tmp_path / "x.sr"
    with SrWriter(path) as writer:
        writer.write(b"abc")
    assert not path.exists()


@pytest.mark.parametrize(
    ("text", "rate_hz"),
    [
        ("2 mHz", 2e6),
        ("200 kHz", 2e5),
        ("24000000", 24e6),
        ("1 GHz", 1e9),
        ("12.5 MHz", 12.5e6),
        ("500 Hz", 500.0),
    ],
)
def test_rates_as_sigrok_writes_them(tmp_path: Path, text: str, rate_hz: float) -> None:
    path = session(tmp_path, METADATA.replace("8 MHz", text))
    assert open_sr(path).samplerate_hz == rate_hz


def session(
    folder: Path,
    metadata: str | bytes = METADATA,
    chunks: dict[str, bytes] | None = None,
    version: str = "2",
) -> Path:
    path = folder / "x.sr"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("version", version)
        archive.writestr("metadata", metadata)
        for name, data in (chunks or {"logic-1-1": b"\x00\x01"}).items():
            archive.writestr(name, data)
    return path


def test_the_sound_one_is_sound(tmp_path: Path) -> None:
    assert as_rows(extract(open_sr(session(tmp_path)))) == [(1, 0, 1)]


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda f: session(f, METADATA.replace("unitsize=1", "unitsize=0")), "unitsize"),
        (lambda f: session(f, METADATA.replace("unitsize=1", "unitsize=9")), "unitsize"),
        (lambda f: session(f, METADATA.replace("unitsize=1", "unitsize=1e9")), "unitsize"),
        (lambda f: session(f, METADATA.replace("unitsize=1\n", "")), "unitsize"),
        (lambda f: session(f, METADATA.replace("unitsize=1", "unitsize=4")), "no whole number"),
        (lambda f: session(f, METADATA.replace("probe1", "probe9")), "probe9"),
        (lambda f: session(f, METADATA.replace("probe1=D0\n", "")), "names no channel"),
        (lambda f: session(f, METADATA.replace("probe1=D0", "probe1=")), "its probe1 no name"),
        (lambda f: session(f, METADATA.replace("probe1=D0", "probe1=\x1e")), "its probe1 no name"),
        (lambda f: session(f, METADATA + "probe2=D0\n"), "two channels called"),
        (lambda f: session(f, METADATA.replace("8 MHz", "0 MHz")), "sample rate"),
        (lambda f: session(f, METADATA.replace("8 MHz", "-8 MHz")), "sample rate"),
        (lambda f: session(f, METADATA.replace("8 MHz", "fast")), "sample rate"),
        (lambda f: session(f, METADATA.replace("8 MHz", "9" * 400)), "sample rate"),
        (lambda f: session(f, "rubbish\n"), "line 1 of its metadata"),
        (lambda f: session(f, b"\xff\xfe[global]"), "not text"),
        (lambda f: session(f, "[global]\na=b\n"), "describes no"),
        (lambda f: session(f, "x" * 70_000), "more than 65536"),
        (lambda f: session(f, version="3"), "version '3'"),
        (lambda f: session(f, METADATA.replace("capturefile=logic-1\n", "")), "no capturefile"),
        (
            lambda f: session(f, METADATA.replace("=logic-1", "=../../etc/passwd")),
            "no member '../../etc/passwd'",
        ),
        (lambda f: session(f, chunks={"logic-1-1": b"a", "logic-1-3": b"c"}), "lacks .*logic-1-2"),
        (lambda f: session(f, chunks={"analog-1-1": b"a"}), "no member"),
        (lambda f: session(f, chunks={"logic-1-1": b""}), "0 bytes of samples"),
    ],
)
def test_hostile_files_are_one_clear_error(
    tmp_path: Path, make: Callable[[Path], Path], what: str
) -> None:
    with pytest.raises(RecordingError, match=what) as caught:
        open_sr(make(tmp_path))
    assert "x.sr" in caught.value.message


def test_a_missing_file_and_no_zip(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        open_sr(tmp_path / "gone.sr")
    text = tmp_path / "text.sr"
    text.write_text("not a zip")
    with pytest.raises(RecordingError, match="cannot be read as a zip"):
        open_sr(text)


def test_a_missing_member_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.sr"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("version", "2")
    with pytest.raises(RecordingError, match="has no 'metadata'"):
        open_sr(path)


def test_an_absurd_size_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    """The directory of the zip claims 128 GiB for the one chunk."""
    path = session(tmp_path)
    data = bytearray(path.read_bytes())
    with zipfile.ZipFile(io.BytesIO(bytes(data))) as archive:
        member = archive.getinfo("logic-1-1")
        assert member.file_size == 2
    entry = data.rindex(b"PK\x01\x02")
    struct.pack_into("<I", data, entry + 24, 0xFFFFFFFF)
    extra = struct.pack("<HHQ", 1, 8, 1 << 37)
    name_end = entry + 46 + len("logic-1-1")
    struct.pack_into("<H", data, entry + 30, len(extra))
    data[name_end:name_end] = extra
    end = data.rindex(b"PK\x05\x06")
    size = struct.unpack_from("<I", data, end + 12)[0]
    struct.pack_into("<I", data, end + 12, size + len(extra))
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=f"{1 << 37} bytes of samples"):
        open_sr(path)


def test_a_bomb_of_samples_passes_through_in_bounded_memory(tmp_path: Path) -> None:
    """256 MiB of zeros in 260 kB: no piece is larger than a MiB, however long the chunk."""
    path = tmp_path / "x.sr"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("version", "2")
        archive.writestr("metadata", METADATA)
        with archive.open("logic-1-1", "w", force_zip64=True) as member:
            for _ in range(256):
                member.write(bytes(1 << 20))
    assert path.stat().st_size < 300_000
    sizes = [len(piece) for piece in open_sr(path).pieces()]
    assert max(sizes) <= 1 << 20
    assert sum(sizes) == 256 << 20


def test_damage_within_the_samples_is_told(tmp_path: Path) -> None:
    path = session(tmp_path, chunks={"logic-1-1": os.urandom(100_000)})
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="damaged within 'logic-1-1'"):
        extract(open_sr(path))


def test_every_cut_of_a_file_is_an_error_of_ours(tmp_path: Path) -> None:
    whole = session(tmp_path).read_bytes()
    path = tmp_path / "cut.sr"
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        with pytest.raises(RecordingError):
            extract(open_sr(path))
