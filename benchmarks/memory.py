# SPDX-License-Identifier: Apache-2.0
"""Memory of the recorder after 1, 10, 60 and 120 minutes of two nodes' bytes and edges."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.measure import Row
from benchmarks.recordings import minutes
from benchmarks.report import child

LENGTHS = (1, 10, 60, 120)


def rows() -> list[Row]:
    peaks = []
    minutes(1)
    for length in LENGTHS:
        with tempfile.TemporaryDirectory() as folder:
            _, peak = child(
                [sys.executable, "-m", "benchmarks.memory", str(length), f"{folder}/run.mcap"]
            )
        peaks.append(peak)
    met = peaks[-1] <= 1.1 * peaks[1]
    told = ", ".join(f"{n} min {mb:.0f} MB" for n, mb in zip(LENGTHS, peaks, strict=True))
    return [
        Row(
            work="peak memory while recording",
            ours=told,
            peer="none",
            ratio=None,
            limit=None,
            aim="flat: 120 min within 10 % of 10 min",
            met=met,
            lacking=""
            if met
            else f"{(peaks[-1] - peaks[1]) / (LENGTHS[-1] - LENGTHS[1]):.2f} MB a minute: the "
            "index of the chunks, which the file's end repeats",
        )
    ]


def record(length: int, output: Path) -> None:
    """Write the same minute again and again, as a bench would in as many minutes."""
    from hil.recording import Writer, load

    one = load(minutes(1))
    blocks = {}
    for role, stream in one.serial.items():
        ends = [*stream.block_offset[1:].tolist(), len(stream.data)]
        blocks[role] = [
            (t, stream.data[a:b].tobytes())
            for a, b, t in zip(
                stream.block_offset.tolist(), ends, stream.block_t_ns_bench.tolist(), strict=True
            )
        ]
    edges = one.edges
    with Writer(
        output,
        one.provenance,
        roles=one.roles,
        edge_channels=edges.channels,
        edge_resolution_ns=edges.resolution_ns,
    ) as writer:
        for minute in range(length):
            shift = minute * 60_000_000_000
            for role, kept in blocks.items():
                for t, data in kept:
                    writer.write_serial(role, t + shift, data)
            writer.write_edges(np.asarray(edges.t_ns_bench + shift), edges.channel, edges.level)


if __name__ == "__main__":
    record(int(sys.argv[1]), Path(sys.argv[2]))
