# SPDX-License-Identifier: Apache-2.0
"""sigrok's session file ``.sr``, read and written.

A zip of ``version`` ("2"; "1" of old files), ``metadata`` (INI) and the samples as ``logic-1-1``,
``logic-1-2``, ... or, in old files, as one ``logic-1``
(https://sigrok.org/wiki/File_format:Sigrok/v2).

Written here with :mod:`zipfile`, because libsigrok's own writer takes longer than in proportion
to the length. The INI is read by hand: sigrok's own reader (GLib) takes indented keys, which
:mod:`configparser` joins to the line above.
"""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

from hil.bench.analyser.capture import UNITSIZE_MAX, Capture
from hil.errors import RecordingError, printable

METADATA_BYTES_MAX = 1 << 16
SAMPLE_BYTES_MAX = 1 << 36
"""64 GiB: two hours at 8 MHz. Samples are streamed, so this bounds time, not memory."""
MEMBERS_MAX = 1 << 16
PIECE_BYTES = 1 << 20
WRITE_PIECE_BYTES = 4 << 20

DEVICE = "device 1"
UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
BROKEN = (
    *(zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError),
    *(ValueError, OverflowError, struct.error),
)
"""What :mod:`zipfile` raises on damaged or encrypted members, and on names that are no UTF-8."""
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""sigrok writes no others, and they may ask for gigabytes before the first byte comes out."""


def open_sr(path: Path, *, samplerate_hz: float | None = None) -> Capture:
    """The logic samples of a session file.

    Args:
        samplerate_hz: the rate, of files that do not say it; overrides the file's.

    Raises:
        RecordingError: not a session file, damaged, absurd, or without a rate; damage within the
            samples shows when they are read.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > MEMBERS_MAX:
                raise _bad(path, f"has {len(members)} members")
            if any(member.compress_type not in COMPRESSIONS for member in members):
                raise _bad(path, "has a member that is not deflated, as sigrok writes them")
            sizes = {member.filename: member.file_size for member in members}
            if len(sizes) != len(members):
                raise _bad(path, "has two members of one name")
            version = _small(archive, path, sizes, "version").strip()
            if version not in ("1", "2"):
                raise _bad(path, f"is of version {version[:20]!r}, not 1 or 2")
            keys = _device(path, _small(archive, path, sizes, "metadata"))
    except BROKEN as error:
        raise _bad(path, f"cannot be read as a zip ({error})") from error
    unitsize = _integer(path, keys, "unitsize", 1, UNITSIZE_MAX)
    names = _chunks(path, keys, sizes)
    total = sum(sizes[name] for name in names)
    if not 0 < total <= SAMPLE_BYTES_MAX:
        raise _bad(path, f"says it holds {total} bytes of samples")
    if total % unitsize:
        raise _bad(path, f"holds {total} bytes, no whole number of samples of {unitsize}")
    rate_hz = samplerate_hz if samplerate_hz is not None else _rate_hz(path, keys)
    channels = _channels(path, keys, unitsize)
    lengths = {name: sizes[name] for name in names}
    try:
        return Capture(rate_hz, channels, unitsize, lambda: _pieces(path, lengths))
    except RecordingError as error:
        raise RecordingError(f"{path}: {error.message}", error.mend) from None


def write_sr(path: Path, capture: Capture) -> None:
    """Write a capture as a session file.

    Raises:
        RecordingError: as reading the capture does.
        OSError: the file cannot be written.
    """
    with SrWriter(path) as writer:
        for piece in capture.pieces():
            writer.write(piece)
        writer.describe(capture.samplerate_hz, capture.channels, capture.unitsize)


class SrWriter:
    """Writes a session file while its samples arrive; a file left without a description goes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._zip = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
        self._zip.writestr("version", "2")
        self._buffer = bytearray()
        self._chunks = 0
        self._described = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, piece: bytes) -> None:
        """Append samples, in pieces of any length."""
        self._buffer += piece
        while len(self._buffer) >= WRITE_PIECE_BYTES:
            self._flush(WRITE_PIECE_BYTES)

    def describe(self, samplerate_hz: float, channels: Mapping[str, int], unitsize: int) -> None:
        """Write what is left and what the samples are; nothing may be written after.

        Raises:
            ValueError: a name that the format cannot hold, or a rate below or between whole Hz.
        """
        if samplerate_hz != int(samplerate_hz):
            raise ValueError("a session file holds whole hertz")
        if any(set(name) & set("\r\n") or name != name.strip() or not name for name in channels):
            raise ValueError("a channel's name is empty, has a line end or spaces around it")
        while self._buffer:
            self._flush(WRITE_PIECE_BYTES)
        lines = [
            *("[global]", "sigrok version=0.5.2", "", f"[{DEVICE}]"),
            *("capturefile=logic-1", f"total probes={8 * unitsize}"),
            *(f"samplerate={int(samplerate_hz)} Hz", "total analog=0"),
            *(f"probe{bit + 1}={name}" for name, bit in channels.items()),
            f"unitsize={unitsize}",
        ]
        self._zip.writestr("metadata", "\n".join(lines) + "\n")
        self._described = True

    def close(self) -> None:
        self._zip.close()
        if not self._described:
            with suppress(FileNotFoundError):
                self._path.unlink()

    def _flush(self, size: int) -> None:
        self._chunks += 1
        self._zip.writestr(f"logic-1-{self._chunks}", bytes(self._buffer[:size]))
        del self._buffer[:size]


def _small(archive: zipfile.ZipFile, path: Path, sizes: Mapping[str, int], name: str) -> str:
    if name not in sizes:
        raise _bad(path, f"has no '{name}'")
    with archive.open(name) as file:
        data = file.read(METADATA_BYTES_MAX + 1)
    if len(data) > METADATA_BYTES_MAX:
        raise _bad(path, f"has a '{name}' of more than {METADATA_BYTES_MAX} bytes")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _bad(path, f"has a '{name}' that is not text") from error


def _device(path: Path, text: str) -> dict[str, str]:
    """The keys of the first device."""
    section = ""
    keys: dict[str, str] = {}
    # str.splitlines() would cut at control characters too, which a name may hold.
    for number, line in enumerate(map(str.strip, io.StringIO(text, newline=None)), 1):
        if not line or line.startswith("#"):
            continue
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1]
            continue
        key, equals, value = line.partition("=")
        if not equals or not section:
            raise _bad(path, f"has no 'key=value' in line {number} of its metadata")
        if section == DEVICE:
            keys[key.strip()] = value.strip()
    if not keys:
        raise _bad(path, f"describes no [{DEVICE}] in its metadata")
    return keys


def _integer(path: Path, keys: Mapping[str, str], key: str, low: int, high: int) -> int:
    text = keys.get(key, "")
    if not re.fullmatch(r"[0-9]{1,6}", text) or not low <= int(text) <= high:
        raise _bad(path, f"says {key}={text[:20]!r}, which is not {low} to {high}")
    return int(text)


def _chunks(path: Path, keys: Mapping[str, str], sizes: Mapping[str, int]) -> list[str]:
    """Names of the members with samples, in order."""
    base = keys.get("capturefile", "")
    if not base:
        raise _bad(path, "names no capturefile: it holds no logic samples")
    if base in sizes:
        return [base]
    pattern = re.compile(re.escape(base) + r"-([1-9][0-9]{0,5})")
    found = {int(m[1]): name for name in sizes if (m := pattern.fullmatch(name))}
    if not found:
        raise _bad(path, f"has no member '{base[:40]}' or '{base[:40]}-1' with samples")
    missing = sorted(set(range(1, max(found) + 1)) - set(found))
    if missing:
        raise _bad(path, f"lacks the samples '{base[:40]}-{missing[0]}'")
    return [found[number] for number in sorted(found)]


def _channels(path: Path, keys: Mapping[str, str], unitsize: int) -> dict[str, int]:
    channels: dict[str, int] = {}
    for key, name in keys.items():
        match = re.fullmatch(r"probe([1-9][0-9]{0,3})", key)
        if match is None:
            continue
        if not name:
            raise _bad(path, f"gives its {key} no name")
        if name in channels:
            raise _bad(path, f"has two channels called '{name[:40]}'")
        bit = int(match[1]) - 1
        if bit >= 8 * unitsize:
            raise _bad(path, f"has a {key} in samples of {8 * unitsize} bits")
        channels[name] = bit
    if not channels:
        raise _bad(path, "names no channel")
    return channels


def _rate_hz(path: Path, keys: Mapping[str, str]) -> float:
    text = keys.get("samplerate", "")
    if not text:
        raise RecordingError(
            f"{path}: the file does not say its sample rate",
            "pass the rate that it was captured with, as samplerate_hz=",
        )
    # sigrok takes the prefix in either case: '2 mHz' is 2 MHz in files of its own.
    match = re.fullmatch(r"([0-9]{1,15}(?:\.[0-9]{1,9})?)\s*([kmg]?)(?:hz)?", text.lower())
    rate_hz = float(Fraction(match[1]) * UNITS[match[2]]) if match else 0.0
    if rate_hz <= 0:
        raise RecordingError(
            f"{path}: the sample rate {text[:40]!r} cannot be read",
            "pass the rate that it was captured with, as samplerate_hz=",
        )
    return rate_hz


def _pieces(path: Path, lengths: Mapping[str, int]) -> Iterator[bytes]:
    name = ""
    try:
        with zipfile.ZipFile(path) as archive:
            for name, length in lengths.items():
                left = length
                with archive.open(name) as file:
                    while piece := file.read(PIECE_BYTES):
                        left -= len(piece)
                        yield piece
                if left:
                    # zipfile takes a member that ends early for whole.
                    raise EOFError(f"{left} of {length} bytes are missing")
    except BROKEN as error:
        raise _bad(path, f"is damaged within '{name}' ({error})") from error


def _bad(path: Path, what: str) -> RecordingError:
    return RecordingError(
        printable(f"{path}: as a sigrok session file it {what}"),
        "open it with sigrok-cli -i to compare",
    )
