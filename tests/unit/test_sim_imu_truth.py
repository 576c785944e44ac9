# SPDX-License-Identifier: Apache-2.0
"""The chip model's truth file, read while it grows."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from hil.errors import RigError
from hil.recording import Provenance, Writer, load
from hil.simulator.imu_truth import TruthLog

HEADER = b"BVIMUTRU" + struct.pack("<II", 1, 40)


def record(run: int, slot: int, t_us: float, flags: int = 11) -> bytes:
    counts = (slot, -slot, 32767, -32768, 1, -1)
    return struct.pack("<IIdd6hBBH", run, slot, t_us, t_us + 5, *counts, 16, flags, 2000)


def test_records_come_once_and_whole(tmp_path: Path) -> None:
    log = TruthLog(tmp_path / "truth")
    assert log.rows()[0].size == 0
    content = HEADER + record(1, 0, 10.5) + record(2, 7, 20.25, 8)
    got = []
    with (tmp_path / "truth").open("ab") as file:
        for start in range(0, len(content), 7):
            file.write(content[start : start + 7])
            file.flush()
            columns = log.rows()
            got += list(zip(*(column.tolist() for column in columns), strict=True))
    log.close()
    assert got == [
        (1, 0, 10.5, [0, 0, 32767, -32768, 1, -1], 11),
        (2, 7, 20.25, [7, -7, 32767, -32768, 1, -1], 8),
    ]


@pytest.mark.parametrize(
    ("header", "says"),
    [
        (b"BVMOTION" + struct.pack("<II", 1, 40), "not a truth file"),
        (b"BVIMUTRU" + struct.pack("<II", 2, 40), "version 2 with records of 40"),
        (b"BVIMUTRU" + struct.pack("<II", 1, 48), "records of 48 bytes"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, header: bytes, says: str) -> None:
    (tmp_path / "truth").write_bytes(header + bytes(80))
    with pytest.raises(RigError, match=says):
        TruthLog(tmp_path / "truth").rows()


def test_rows_are_what_a_recording_takes(tmp_path: Path) -> None:
    (tmp_path / "truth").write_bytes(HEADER + b"".join(record(3, k, 9.0 * k) for k in range(50)))
    with Writer(tmp_path / "r.mcap", Provenance("sim", "")) as writer:
        writer.write_imu_truth("leader", *TruthLog(tmp_path / "truth").rows())
    kept = load(tmp_path / "r.mcap").imu_truth["leader"]
    assert kept.slot.tolist() == list(range(50))
    assert kept.t_us_true == pytest.approx([9.0 * k for k in range(50)], abs=1e-3)
    assert kept.counts[49].tolist() == [49, -49, 32767, -32768, 1, -1]
