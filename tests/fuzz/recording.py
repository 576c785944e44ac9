# SPDX-License-Identifier: Apache-2.0
"""The reader of recordings.

The lowest bit of the first byte says what the rest is: the file itself, or, parted by SPLIT, the
contents of its chunks, which are compressed and given their checksums here. With the second bit
the last part is the summary behind a right checksum: what no mutation would ever get past.
"""

from __future__ import annotations

import itertools
import json
import struct
import zlib

import numpy as np
import zstandard

from hil.errors import RecordingError
from hil.recording import Provenance, Recording, Writer, load
from tests.fuzz.common import SPLIT, check_refusal, hostile_file, read_or_refuse

MAGIC = b"\x89MCAP0\r\n"
MAX_BYTES = 16 << 20


def run(data: bytes) -> None:
    if not data:
        return
    path = hostile_file("hostile.mcap", sealed(data[0], data[1:]))
    recording = read_or_refuse(path, lambda p: load(p, max_bytes=MAX_BYTES))
    if recording is not None:
        _check(recording)


def sealed(how: int, data: bytes) -> bytes:
    """The file that an input stands for."""
    if not how & 1:
        return data
    parts = data.split(SPLIT)
    summary = parts.pop() if how & 2 else b""
    body = MAGIC + b"".join(map(_chunk, parts))
    if not how & 2:
        return body
    body += struct.pack("<BQI", 15, 4, zlib.crc32(body))
    footer = struct.pack("<BQQQ", 2, 20, len(body) if summary else 0, 0)
    return body + summary + footer + struct.pack("<I", zlib.crc32(summary + footer)) + MAGIC


def _chunk(contents: bytes) -> bytes:
    packed = zstandard.compress(contents, 1)
    body = struct.pack("<QQQII", 0, 0, len(contents), zlib.crc32(contents), 4) + b"zstd"
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body


def _check(recording: Recording) -> None:
    """All that a check would ask of it; then written and read again, it says the same."""
    assert all(text.isprintable() for text in recording.integrity.problems)
    for stream in recording.serial.values():
        if len(stream.data):
            stream.t_ns_bench([0, len(stream.data) - 1])
    for role in recording.roles:
        # The table in the recording is input as well.
        _refused(recording, lambda r, role=role: r.decoded(role))
    _refused(recording, lambda r: r.truth)
    for name in recording.edges.channels:
        recording.edges.select(name)
    json.dumps(recording.provenance.to_mapping(), allow_nan=False)
    _check_rewritten(recording)


def _refused(recording: Recording, use: object) -> None:
    try:
        use(recording)  # type: ignore[operator]
    except RecordingError as error:
        assert recording.path is not None
        renamed = RecordingError(f"{recording.path}: {error.message}", error.mend)
        check_refusal(renamed, recording.path)


def _check_rewritten(recording: Recording) -> None:
    path = hostile_file("again.mcap", b"")
    path.unlink()
    channels = recording.edges.channels
    provenance = Provenance.from_mapping(recording.provenance.to_mapping())
    roles = sorted({*recording.roles, *recording.imu_truth})
    if len(roles) > 16:
        return
    with Writer(
        path,
        provenance,
        roles=roles,
        edge_channels=channels,
        edge_resolution_ns=recording.edges.resolution_ns,
    ) as writer:
        for role, stream in recording.serial.items():
            starts = [*stream.block_offset.tolist(), len(stream.data)]
            data = stream.data.tobytes()
            for t_ns, (first, behind) in zip(
                stream.block_t_ns_bench.tolist(), itertools.pairwise(starts), strict=True
            ):
                writer.write_serial(role, t_ns, data[first:behind])
        edges = recording.edges
        writer.write_edges(edges.t_ns_bench, edges.channel, edges.level)
        for event in recording.events:
            writer.write_event(event)
        for role, truth in recording.imu_truth.items():
            writer.write_imu_truth(
                role, truth.run, truth.slot, truth.t_us_true, truth.counts, truth.flags
            )
    again = load(path)
    assert again.integrity.complete
    assert again.events == recording.events
    assert again.provenance == recording.provenance
    for role, stream in recording.serial.items():
        assert again.serial[role].data.tobytes() == stream.data.tobytes()
        assert again.serial[role].block_t_ns_bench.tolist() == stream.block_t_ns_bench.tolist()
    for column in ("t_ns_bench", "channel", "level"):
        before, after = getattr(recording.edges, column), getattr(again.edges, column)
        assert before.tolist() == after.tolist(), column
    for role, truth in recording.imu_truth.items():
        assert again.imu_truth[role].counts.tolist() == truth.counts.tolist()
        assert np.allclose(again.imu_truth[role].t_us_true, truth.t_us_true, atol=2e-3, rtol=1e-15)
