# SPDX-License-Identifier: Apache-2.0
"""Opening and loading recordings of 1, 10 and 60 minutes, beside Parquet and bare arrays."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.measure import Row, best, reading_s
from benchmarks.recordings import minutes
from hil.recording import Recording, load


def arrays(recording: Recording) -> dict[str, np.ndarray]:
    """Everything in the recording that is as long as the run."""
    found: dict[str, np.ndarray] = {}
    for role, stream in recording.serial.items():
        found[f"{role}.data"] = stream.data
        found[f"{role}.block_offset"] = stream.block_offset
        found[f"{role}.block_t_ns_bench"] = stream.block_t_ns_bench
    for name in ("t_ns_bench", "channel", "level"):
        found[f"edges.{name}"] = getattr(recording.edges, name)
    for role, truth in recording.imu_truth.items():
        for name in ("run", "slot", "t_us_true", "counts", "flags"):
            found[f"{role}.{name}"] = np.asarray(getattr(truth, name))
    return found


def rows() -> list[Row]:
    return [_row(duration) for duration in (1, 10, 60)]


def _row(duration: int) -> Row:
    path = minutes(duration)
    held = arrays(load(path))
    size = sum(one.nbytes for one in held.values())
    with tempfile.TemporaryDirectory() as folder:
        for name, one in held.items():
            one.tofile(Path(folder, name))
            # Parquet's defaults, but with the compression that recordings have.
            pq.write_table(
                pa.table({name: one.reshape(-1)}),
                Path(folder, name + ".parquet"),
                compression="zstd",
            )
        ours_s = best(lambda: load(path), 3)
        raw_s = best(lambda: [np.fromfile(Path(folder, n), a.dtype) for n, a in held.items()], 3)
        peer_s = best(
            lambda: [
                pq.read_table(Path(folder, n + ".parquet"), use_threads=False)[n].to_numpy()
                for n in held
            ],
            3,
        )
    return Row(
        work=f"open and load {duration} min, {size / 1e6:.0f} MB",
        ours=f"{1e3 * ours_s:.0f} ms",
        peer=f"Parquet: {1e3 * peer_s:.0f} ms; bare arrays: {1e3 * raw_s:.0f} ms",
        ratio=peer_s / ours_s,
        limit=reading_s(size) / ours_s,
        aim="within 2 times of Parquet",
        met=ours_s <= 2 * peer_s,
        lacking=""
        if ours_s <= 2 * peer_s
        else f"{ours_s / peer_s:.1f} times Parquet: each serial block is a message that Python "
        "takes; reading whole chunks with NumPy comes next",
    )
