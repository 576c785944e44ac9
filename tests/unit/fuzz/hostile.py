# SPDX-License-Identifier: Apache-2.0
"""Hostile files made by hand. What the program says of each is in docs/refusals.md."""

from __future__ import annotations

import io
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from hil import scenario
from hil.bench import inventory
from hil.bench.analyser.edges import extract
from hil.bench.analyser.saleae_csv import read_saleae_csv
from hil.bench.analyser.sr_file import open_sr
from hil.bench.analyser.vcd import read_vcd
from hil.recording import load
from hil.truth import reference

BEGIN = "<!-- Rows of tests/unit/fuzz/hostile.py: begin -->"
END = "<!-- end of them -->"


@dataclass(frozen=True)
class Case:
    """``what`` is wrong with the file that ``make`` gives."""

    what: str
    make: Callable[[], bytes]


METADATA = b"[device 1]\ncapturefile=logic-1\nsamplerate=1 MHz\nprobe1=a\nprobe2=b\nunitsize=1\n"


def session(members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, contents in members.items():
            archive.writestr(name, contents)
    return file.getvalue()


def sigrok(metadata: bytes = METADATA, samples: bytes = b"\0\1\3\2") -> bytes:
    return session({"version": b"2", "metadata": metadata, "logic-1-1": samples})


def claiming(size: int) -> bytes:
    """A session whose directory says that its samples are this long."""
    data = bytearray(sigrok())
    at = data.rindex(b"PK\x01\x02")
    struct.pack_into("<I", data, at + 24, size)
    return bytes(data)


def encrypted() -> bytes:
    data = bytearray(sigrok())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + at] |= 1
    return bytes(data)


def misnamed() -> bytes:
    return session({"versé": b"2"}).replace("é".encode(), b"\xff\xff")


def twice() -> bytes:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w") as archive:
            for _ in range(2):
                archive.writestr("version", b"2")
        return file.getvalue()


def dump(body: str, head: str = "") -> bytes:
    variables = f"{head}$timescale 100 ns $end $var wire 1 ! a $end\n$enddefinitions $end\n"
    return (variables + body).encode("latin-1")


def saleae(*rows: str, head: str = "Time [s],Channel 0") -> bytes:
    return "\n".join((head, *rows)).encode("latin-1")


def rows(count: int, row: Callable[[int], str]) -> bytes:
    return "".join(f"{row(i)}\n" for i in range(count)).encode()


BENCH = b"""format = 1
[boards.leader]
probe = "683001"
[boards.follower]
probe = "683002"
"""


def bench(old: bytes, new: bytes) -> bytes:
    assert old in BENCH
    return BENCH.replace(old, new)


def named(text: str) -> bytes:
    return b'name = "x"\n' + text.encode()


READERS: dict[str, Callable[[Path], object]] = {
    "Recordings (.mcap)": load,
    "Sessions of sigrok (.sr)": lambda path: extract(open_sr(path)),
    "Value change dumps (.vcd)": lambda path: read_vcd(path, samplerate_hz=1e6),
    "Exports of Saleae Logic 2 (digital.csv)": lambda p: read_saleae_csv(p, samplerate_hz=1e6),
    "References (.csv)": reference.read,
    "The bench file (bench.toml)": inventory.load,
    "Scenarios (.toml)": scenario.load,
}

MAGIC = b"\x89MCAP0\r\n"

CASES: dict[str, list[Case]] = {
    "Recordings (.mcap)": [
        Case("empty", lambda: b""),
        Case("another file", lambda: b"PK\x03\x04 what ever"),
        Case("a pointer of Git LFS", lambda: b"version https://git-lfs.github.com/x\n"),
        Case("nothing but the magic", lambda: MAGIC),
        Case(
            "a chunk that claims 10^12 bytes",
            lambda: (
                MAGIC
                + struct.pack("<BQQQQII", 6, 53, 0, 0, 10**12, 0, 4)
                + b"zstd"
                + struct.pack("<Q", 9)
                + bytes(9)
            ),
        ),
        Case("a record of 2^63 bytes", lambda: MAGIC + struct.pack("<BQ", 6, 1 << 63)),
    ],
    "Sessions of sigrok (.sr)": [
        Case("no zip", lambda: b"what ever"),
        Case("cut", lambda: sigrok()[:-30]),
        Case("no metadata", lambda: session({"version": b"2"})),
        Case("a later version", lambda: session({"version": b"3", "metadata": b""})),
        Case("two members of one name", twice),
        Case("a name that is not UTF-8", misnamed),
        Case("encrypted", encrypted),
        Case(
            "LZMA, which may ask for 4 GiB of memory",
            lambda: session({"version": b"2"}, zipfile.ZIP_LZMA),
        ),
        Case(
            "metadata of 128 MiB in 130 kB",
            lambda: session({"version": b"2", "metadata": bytes(1 << 27)}),
        ),
        Case("samples shorter than the directory says", lambda: claiming(1 << 30)),
        Case(
            "members that point out of the archive",
            lambda: sigrok(METADATA.replace(b"=logic-1", b"=../../etc/passwd")),
        ),
        Case("samples of 9 bytes", lambda: sigrok(METADATA.replace(b"=1\n", b"=9\n"))),
        Case("no rate", lambda: sigrok(METADATA.replace(b"samplerate=1 MHz\n", b""))),
        Case("a rate of 10^13 Hz", lambda: sigrok(METADATA.replace(b"1 MHz", b"9999 GHz"))),
        Case("a rate of NaN", lambda: sigrok(METADATA.replace(b"1 MHz", b"nan"))),
        Case("two channels of one name", lambda: sigrok(METADATA.replace(b"=b", b"=a"))),
        Case("a channel without a name", lambda: sigrok(METADATA.replace(b"=b", b"="))),
        Case(
            "what steers a terminal",
            lambda: sigrok(METADATA.replace(b"=logic-1", b"=\x1b[2J")),
        ),
    ],
    "Value change dumps (.vcd)": [
        Case("another file", lambda: b"what ever"),
        Case("cut in its header", lambda: b"$timescale 1 us"),
        Case("a time that goes back", lambda: dump("#90\n1!\n#80\n0!\n")),
        Case("a time of 30 digits", lambda: dump("#" + "9" * 30)),
        Case("a line of 70,000 bytes", lambda: dump("0!" * 35_000)),
        Case(
            "scopes within scopes, and names that grow with them",
            lambda: dump("", ("$scope module " + "a" * 200 + " $end\n") * 5000),
        ),
        Case("a name of 300 bytes", lambda: dump("", f"$scope module {'a' * 300} $end\n")),
        Case("what steers a terminal", lambda: dump("\x1b[2J")),
    ],
    "Exports of Saleae Logic 2 (digital.csv)": [
        Case("another table", lambda: b"a,b\n1,2\n"),
        Case("no rows", saleae),
        Case("a level of 2", lambda: saleae("0.0,2")),
        Case("a time of NaN", lambda: saleae("nan,1")),
        Case("a time that goes back", lambda: saleae("0.000002,1", "0.000001,0")),
        Case("a row cut short", lambda: saleae("0.0,1", "0.00")),
        Case("a line of 5,000 bytes", lambda: saleae("0.0," + "1" * 5000)),
    ],
    "References (.csv)": [
        Case("empty", lambda: b""),
        Case("not UTF-8", lambda: b"time (s),height (m)\n\xff,1\n"),
        Case("null bytes", lambda: b"time (s),height (m)\n0,\0\n"),
        Case("too few rows", lambda: b"time (s),height (m)\n0,1\n"),
        Case("no such column", lambda: b"alpha,beta\n1,2\n"),
        Case(
            "a value of infinity",
            lambda: b"time (s),height (m)\n" + rows(30, lambda i: f"{i},inf"),
        ),
        Case(
            "a time that goes back",
            lambda: b"time (s),height (m)\n" + rows(30, lambda i: f"{i % 25},1"),
        ),
        Case(
            "a heading that patterns could take hours over",
            lambda: b"a" + b" " * 1300 + b"(" + b" " * 1300 + b"b,x\n1,2\n",
        ),
        Case("a line of 5,000 characters", lambda: b"time (s),height (m)\n" + b"1" * 5000),
    ],
    "The bench file (bench.toml)": [
        Case("no TOML", lambda: b"format = "),
        Case("larger than 64 KiB", lambda: b"#" * 70_000),
        Case("arrays within arrays", lambda: b"a = " + b"[" * 5000),
        Case(
            "a number of 5,000 digits",
            lambda: bench(b"format = 1", b"format = " + b"9" * 5000),
        ),
        Case("a probe of 24,000 bits", lambda: bench(b'"683002"', b"0x" + b"f" * 6000)),
        Case("one probe twice", lambda: bench(b"683002", b"683001")),
        Case("a key with a line end in it", lambda: bench(b"[boards.l", b'"a\\nb"=1\n[boards.l')),
    ],
    "Scenarios (.toml)": [
        Case("no TOML", lambda: b"name = "),
        Case("not UTF-8", lambda: b"\xff"),
        Case("larger than 256 KiB", lambda: b"#" * 300_000),
        Case("arrays within arrays", lambda: named("a = " + "[" * 5000)),
        Case("a number of 5,000 digits", lambda: named("seed = " + "9" * 5000)),
        Case("a duration of NaN", lambda: named("duration_s = nan")),
        Case("a drift of infinity", lambda: named("[nodes.leader]\ndrift_ppm = inf")),
        Case("a duration of 10^400 s", lambda: named("duration_s = 1" + "0" * 400)),
        Case("options of an image that are no table", lambda: named("[firmware]\nleader = 5")),
        Case("a date for an option", lambda: named("[firmware.leader]\nA = 2020-01-01")),
        Case("a check that is a number", lambda: named("expect_fail = [1]")),
        Case("a key with a line end in it", lambda: named('"a\\nb" = 1')),
    ],
}


def section(messages: Mapping[tuple[str, str], str]) -> str:
    """The rows of the document."""
    lines = [BEGIN, ""]
    for reader, cases in CASES.items():
        lines += [f"## {reader}", "", "| Input | Message |", "| --- | --- |"]
        for case in cases:
            said = messages[reader, case.what].replace("|", "\\|")
            lines.append(f"| {case.what} | `{said}` |")
        lines.append("")
    return "\n".join([*lines, END])
