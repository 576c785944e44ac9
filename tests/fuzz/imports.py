# SPDX-License-Identifier: Apache-2.0
"""The readers of other programs' files: sigrok sessions, value change dumps, Saleae, references.

The first byte chooses the reader. A session comes as it is or, parted by SPLIT, as members
``name 00 contents``, which are zipped here with right checksums.
"""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hil.bench.analyser.capture import CaptureEdges
from hil.bench.analyser.edges import extract
from hil.bench.analyser.saleae_csv import read_saleae_csv
from hil.bench.analyser.sr_file import open_sr, write_sr
from hil.bench.analyser.vcd import read_vcd
from hil.truth import reference
from tests.fuzz.common import SPLIT, hostile_file, read_or_refuse

RATE_HZ = 1e6


def run(data: bytes) -> None:
    if data:
        READERS[data[0] % len(READERS)](data[1:])


def session(data: bytes) -> None:
    path = hostile_file("hostile.sr", data)
    capture = read_or_refuse(path, open_sr)
    if capture is None:
        return
    edges = read_or_refuse(path, lambda _: extract(capture))
    if edges is None:
        return
    assert edges.samples > 0
    if capture.samplerate_hz == int(capture.samplerate_hz):
        again = path.with_name("again.sr")
        write_sr(again, capture)
        copy = open_sr(again)
        assert copy.samplerate_hz == capture.samplerate_hz
        _check_same(extract(copy), edges)


def sealed_session(data: bytes) -> None:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Two members of one name are the point.
        for part in data.split(SPLIT):
            name, _, contents = part.partition(b"\0")
            archive.writestr(zipfile.ZipInfo(name.decode("latin-1")), contents)
    session(file.getvalue())


def dump(data: bytes) -> None:
    _timed("hostile.vcd", data, lambda p: read_vcd(p, samplerate_hz=RATE_HZ), _as_dump)


def saleae(data: bytes) -> None:
    _timed("hostile.csv", data, lambda p: read_saleae_csv(p, samplerate_hz=RATE_HZ), _as_saleae)


def _timed(
    name: str,
    data: bytes,
    read: Callable[[Path], CaptureEdges],
    write: Callable[[CaptureEdges], bytes],
) -> None:
    path = hostile_file(name, data)
    edges = read_or_refuse(path, read)
    if edges is None:
        return
    assert np.all(np.diff(edges.sample) >= 0)
    assert edges.sample.size == 0 or 0 <= edges.sample[0] <= edges.sample[-1] < edges.samples
    # Seconds of ten digits do not fit the export.
    if edges.samples < 10**15:
        path.write_bytes(write(edges))
        _check_same(read(path), edges, names=False)


def _check_same(found: CaptureEdges, wanted: CaptureEdges, *, names: bool = True) -> None:
    assert found.samples == wanted.samples
    assert not names or found.channels == wanted.channels
    for column in ("initial", "sample", "channel", "level"):
        assert getattr(found, column).tolist() == getattr(wanted, column).tolist(), column


def _as_dump(edges: CaptureEdges) -> bytes:
    lines = ["$timescale 100 ns $end"]
    lines += [f"$var wire 1 c{i} n{i} $end" for i in range(len(edges.channels))]
    lines += ["$enddefinitions $end", "#0"]
    lines += [f"{level}c{i}" for i, level in enumerate(edges.initial.tolist())]
    for sample, channel, level in zip(edges.sample, edges.channel, edges.level, strict=True):
        lines.append(f"#{10 * int(sample)} {level}c{channel}")
    return "\n".join([*lines, f"#{10 * (edges.samples - 1)}"]).encode()


def _as_saleae(edges: CaptureEdges) -> bytes:
    levels = edges.initial.tolist()
    rows = [(0, list(levels))]
    for sample, channel, level in zip(edges.sample, edges.channel, edges.level, strict=True):
        levels[channel] = int(level)
        rows.append((int(sample), list(levels)))
    rows.append((edges.samples - 1, list(levels)))
    head = "Time [s]," + ",".join(f"Channel {i}" for i in range(len(levels)))
    body = [f"{t // 10**6}.{t % 10**6:06d}000," + ",".join(map(str, row)) for t, row in rows]
    return "\n".join([head, *body]).encode()


def truth(data: bytes) -> None:
    path = hostile_file("hostile.csv", data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_or_refuse(path, reference.read)
    if found is None:
        return
    assert np.all(np.isfinite(found.t_s))
    assert np.all(np.isfinite(found.value))
    assert np.all(np.diff(found.t_s) > 0)
    unit = "m" if found.quantity == "position" else "m/s"
    rows = [f"{t!r},{x!r}" for t, x in zip(found.t_s.tolist(), found.value.tolist(), strict=True)]
    path.write_text("\n".join([f"time (s),{found.quantity} ({unit})", *rows]))
    again = reference.read(path)
    assert again.quantity == found.quantity
    assert again.t_s.tolist() == found.t_s.tolist()
    assert again.value.tolist() == found.value.tolist()


READERS: tuple[Callable[[bytes], None], ...] = (session, sealed_session, dump, saleae, truth)
