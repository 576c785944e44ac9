# SPDX-License-Identifier: Apache-2.0
"""Edges of 100 million samples of 8 channels, and the pairing of two nodes' pulses."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.measure import Row, best, reading_s
from benchmarks.report import child
from hil.bench.analyser.capture import Capture
from hil.bench.analyser.edges import extract
from hil.timesync.pulses import edge_pairs

SAMPLES, PIECE = 100_000_000, 1 << 22
CAPTURED = 50_000
"""Pulses of a node in those samples, one every 2,000."""
RATE_HZ = 24e6
MANY = 1_000_000


def samples() -> np.ndarray:
    """Eight channels with pulses from every 2,000 samples to every 200,000."""
    packed = np.zeros(SAMPLES, np.uint8)
    for bit in range(8):
        period = 2_000 * (1 + 14 * bit)
        whole = packed[: SAMPLES // period * period].reshape(-1, period)
        whole[:, 100 * bit : 100 * bit + 240] |= np.uint8(1 << bit)
    return packed


def by_diff(packed: np.ndarray) -> np.ndarray:
    """The plain way: where a sample is not the one before."""
    return np.flatnonzero(np.diff(packed))


def rows() -> list[Row]:
    return [_edges(), _pairs(CAPTURED, SAMPLES), _pairs(MANY, 0)]


def _edges() -> Row:
    packed = samples()
    capture = Capture(
        RATE_HZ,
        {f"D{bit}": bit for bit in range(8)},
        1,
        lambda: (packed[i : i + PIECE].tobytes() for i in range(0, SAMPLES, PIECE)),
    )
    if len(np.unique(extract(capture).sample)) != len(by_diff(packed)):
        raise RuntimeError("the plain way finds other edges")
    ours_s = best(lambda: extract(capture), 3)
    peer_s = best(lambda: by_diff(packed), 3)
    read_s = reading_s(SAMPLES)
    met = ours_s <= 0.1
    return Row(
        work="edges of 100 M samples of 8 channels",
        ours=f"{1e3 * ours_s:.0f} ms",
        peer=f"NumPy diff: {1e3 * peer_s:.0f} ms{_sigrok(packed)}",
        ratio=peer_s / ours_s,
        limit=read_s / ours_s,
        aim="0.1 s",
        met=met,
        lacking="" if met else f"{ours_s / 0.1:.1f} times: comparing neighbours in C++ comes next",
    )


def _sigrok(packed: np.ndarray) -> str:
    """What sigrok-cli takes for the same by converting a hundredth of it, where it is."""
    program = shutil.which("sigrok-cli")
    if program is None:
        return ""
    with tempfile.TemporaryDirectory() as folder:
        raw, out = Path(folder, "raw.bin"), Path(folder, "out.vcd")
        packed[: SAMPLES // 100].tofile(raw)
        try:
            seconds, _ = child(
                [
                    *(program, "-I", f"binary:numchannels=8:samplerate={RATE_HZ:.0f}"),
                    *("-i", str(raw), "-O", "vcd", "-o", str(out)),
                ]
            )
        except RuntimeError:
            return ""
    return f"; sigrok-cli to VCD: {100 * seconds:.0f} s"


def _pairs(pulses: int, of_bytes: int) -> Row:
    """Pairing beside reading the capture that the edges are of; without one, beside the edges."""
    rng = np.random.default_rng(1)
    period = 250_000_000
    begun = np.arange(1, pulses + 1) * period
    leader = np.column_stack([begun, begun + period // 25]).ravel()
    follower = leader + rng.integers(-200, 200, len(leader))
    end = float(leader[-1])

    def plain() -> np.ndarray:
        return follower[::2] - leader[::2]

    if len(edge_pairs(leader, follower, period, 0.0, end).t_ns_bench) != pulses:
        raise RuntimeError("not every pulse found its partner")
    ours_s = best(lambda: edge_pairs(leader, follower, period, 0.0, end), 7)
    peer_s = best(plain, 7)
    read_s = reading_s(of_bytes or leader.nbytes + follower.nbytes)
    met = ours_s <= 2 * read_s
    return Row(
        work=f"pairing {pulses:,} pulses of two nodes"
        + (f", of {of_bytes / 1e6:.0f} M samples" if of_bytes else ", beside their edges alone"),
        ours=f"{1e3 * ours_s:.0f} ms",
        peer=f"NumPy difference of edges known to match: {1e3 * peer_s:.1f} ms",
        ratio=peer_s / ours_s,
        limit=read_s / ours_s,
        aim="within 2 times of reading the bytes",
        met=met,
        lacking=""
        if met
        else f"{ours_s / read_s:.0f} times: leading edges are told from the others, and each "
        "node's are held against the other's, in passes of NumPy; one merge in C++ comes next. "
        f"The 14,400 pulses of an hour take {1e3 * ours_s * 14_400 / pulses:.1f} ms",
    )
