# SPDX-License-Identifier: Apache-2.0
"""CSV lines between frames as tables: figures written by hand, and what must not get in."""

from __future__ import annotations

import csv
import ctypes
import io
import re
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.errors import HilError
from hil.log import tables as files
from hil.log.text import COLUMNS_MAX, KINDS_MAX, SHADOW_COLUMNS, tables, tables_of_parts
from hil.recording import (
    Edges,
    Integrity,
    Provenance,
    Recording,
    SerialStream,
    load,
)
from hil.wire.codec import encode
from tests.unit.native import shared_library

ROOT = Path(__file__).parents[3]
CLEAN = ROOT / "fixtures/recordings/clean-7ms5/recording.mcap"
HEADING = "#shadow," + ",".join(SHADOW_COLUMNS)


def recording(*reads: tuple[int, bytes], role: str = "leader") -> Recording:
    """What was read and when, ns."""
    data = b"".join(piece for _, piece in reads)
    offsets = np.cumsum([0, *(len(piece) for _, piece in reads)])[:-1]
    stream = SerialStream(
        np.frombuffer(data, np.uint8), offsets, np.array([t for t, _ in reads], np.int64)
    )
    edges = Edges(np.zeros(0, int), np.zeros(0, int), np.zeros(0, int), (), 0.0)
    return Recording(Provenance("bench", ""), {role: stream}, edges, (), Integrity(True))


def lines(*texts: str) -> bytes:
    return "".join(f"{text}\r\n" for text in texts).encode("latin-1")


def row(t_us: int, az: str = "9.80665") -> str:
    return f"shadow,{t_us},0.012,-0.5,{az},0.001,-0.002,0,3"


FRAME = encode("hello", {
    **{"protocol_version": 1, "role": 0, "target": 1, "schema_hash": 1, "build_id": 2},
    **{"device_id": 3, "reset_reason": 0, "tick_rate_hz": 16_000_000},
    **{"conn_interval_us": 7500, "uptime_ms": 5},
}, 0)  # fmt: skip


def test_rows_between_frames_become_columns() -> None:
    found = tables(
        recording(
            (100, FRAME + lines(HEADING, row(10_000))),
            (200, FRAME + lines(row(20_000, "-1.25")) + FRAME),
        ),
        "leader",
    )
    (table,) = found.values()
    assert (table.kind, len(table), table.bad_rows, table.headings) == ("shadow", 2, 0, 1)
    assert tuple(table.columns) == SHADOW_COLUMNS
    assert table.columns["t_us_node"].tolist() == [10_000, 20_000]
    assert table.columns["t_us_node"].dtype == np.int64
    assert table.columns["az_mps2"].tolist() == [9.80665, -1.25]
    assert table.columns["flags"].tolist() == [3, 3]
    assert table.t_ns_bench.tolist() == [100, 200]


def test_a_stream_entered_in_the_middle_is_read_by_the_next_heading() -> None:
    found = tables(recording((0, lines(row(1), row(2), HEADING, row(3), HEADING))), "leader")
    assert found["shadow"].columns["t_us_node"].tolist() == [1, 2, 3]
    assert found["shadow"].headings == 2


def test_a_clock_of_microseconds_stays_exact_beyond_float64() -> None:
    found = tables(recording((0, lines(HEADING, row((1 << 53) + 1)))), "leader")
    assert found["shadow"].columns["t_us_node"].tolist() == [(1 << 53) + 1]


BAD = {
    "too few values": "shadow,1,2,3",
    "too many values": row(1) + ",9",
    "a word": row(1, "up"),
    "not a number": row(1, "nan"),
    "infinite": row(1, "1e999"),
    "an exponent": row(1, "1e3"),
    "an underscore": row(1, "1_000"),
    "an empty cell": row(1, ""),
    "beyond 64 bits": row(1 << 63),
    "digits without end": row(1, "1" * 300),
    "another heading": "#shadow,t_us_node,other",
    "a heading with a name twice": "#shadow,a,a",
    "a heading with bad names": "#shadow,a b,$",
    "a heading too wide": "#shadow," + ",".join(f"c{k}" for k in range(COLUMNS_MAX + 1)),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_what_does_not_fit_is_counted_and_left_out(bad: str) -> None:
    (table,) = tables(recording((0, lines(HEADING, row(1), bad, row(2)))), "leader").values()
    assert table.columns["t_us_node"].tolist() == [1, 2]
    assert table.bad_rows == 1


def test_rows_that_nothing_names_make_no_table_and_other_text_none_either() -> None:
    said = lines(row(1), "*** Booting Zephyr OS ***", "#", "#shadow", "hello, world", "é,1")
    assert tables(recording((0, said)), "leader") == {}
    assert tables(recording((0, said)), "follower") == {}


def test_damage_costs_the_lines_that_it_hits() -> None:
    """Beyond ASCII a line is damaged; a lost digit is not seen, for rows have no checksum."""
    whole = lines(HEADING, row(1), row(2), row(3))
    for at in range(len(lines(HEADING)), len(whole), 5):
        for data in (whole[:at] + whole[at + 1 :], whole[:at] + b"\xff" + whole[at + 1 :]):
            found = tables(recording((0, FRAME + data + FRAME)), "leader")
            assert 1 <= len(found["shadow"]) <= 3


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=40) | st.sampled_from([FRAME, lines(HEADING), lines(row(7))])))
def test_no_bytes_raise_anything(pieces: list[bytes]) -> None:
    reads = [(k, piece) for k, piece in enumerate(pieces) if piece]
    for table in tables(recording(*reads), "leader").values():
        assert all(len(column) == len(table) for column in table.columns.values())


def test_many_kinds_and_a_flood_of_rows_stay_within_bounds() -> None:
    kinds = lines(*(f"#k{k},a" for k in range(200)))
    flood = lines(HEADING) + lines(row(5)) * 20_000 + lines("shadow," + "," * 800) * 2000
    begin_s = time.process_time()
    found = tables(recording((0, flood), (1, kinds)), "leader")
    assert time.process_time() - begin_s < 3.0
    assert len(found) == KINDS_MAX
    assert (len(found["shadow"]), found["shadow"].bad_rows) == (20_000, 2000)


def test_the_diagnostic_lines_of_real_firmware() -> None:
    """Every line of the recording, read by Python's own csv module."""
    real = load(CLEAN)
    for role in ("leader", "follower"):
        raw = [line.text for line in real.decoded(role).text]
        for kind, table in tables(real, role).items():
            names = next(t for t in raw if t.startswith(f"#{kind},")).split(",")[1:]
            rows = list(csv.reader(t for t in raw if t.startswith(f"{kind},")))
            assert list(table.columns) == names
            assert len(table) == len(rows) > 10
            for k, name in enumerate(names, 1):
                expected = [r[k] for r in rows]
                assert [str(v) for v in table.columns[name].tolist()] == expected
        assert {"IMU", "SYNC"} <= set(tables(real, role))


def test_parts_of_a_log_are_one_table() -> None:
    parts = [recording((5, lines(row(1)))), recording((9, lines(HEADING, row(2))))]
    found = tables_of_parts(parts, "leader")["shadow"]
    assert found.columns["t_us_node"].tolist() == [1, 2]
    assert found.t_ns_bench.tolist() == [5, 9]


def test_tables_as_files_read_back_as_they_were(tmp_path: Path) -> None:
    spoken = [row(10_000 * k, f"{9.8 + 0.001 * k:.3f}") for k in range(50)]
    del spoken[20:23]
    one = recording((1_234_567_890, lines(HEADING, *spoken, "shadow,bad")))
    said = files.write([one], tmp_path / "a.csv", tmp_path / "a.parquet")
    counts = "47 rows, 1 bad ones left out, 3 missing by their times"
    assert said == [f"{tmp_path / 'a-leader-shadow'}.{end}: {counts}" for end in ("csv", "parquet")]
    table = tables(one, "leader")["shadow"]
    text = (tmp_path / "a-leader-shadow.csv").read_text()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [r["t_s_bench"] for r in rows] == ["1.234568"] * 47
    parquet = pq.read_table(tmp_path / "a-leader-shadow.parquet")
    assert parquet.schema.metadata[b"hil.kind"] == b"shadow"
    for name, column in table.columns.items():
        assert [float(r[name]) for r in rows] == column.tolist()
        assert parquet[name].to_pylist() == column.tolist()


def test_nothing_to_write_is_said_and_a_folder_in_the_way_is_an_error(tmp_path: Path) -> None:
    (said,) = files.write([recording((0, b"hello"))], tmp_path / "a.csv", None)
    assert "no table" in said
    (tmp_path / "a-leader-shadow.csv").mkdir()
    one = recording((0, lines(HEADING, row(1))))
    with pytest.raises(HilError, match="cannot be written"):
        files.write([one], tmp_path / "a.csv", None)


def test_a_table_without_rows_is_a_heading() -> None:
    table = tables(recording((0, lines(HEADING))), "leader")["shadow"]
    assert files.as_csv(table).decode() == ",".join(["t_s_bench", *SHADOW_COLUMNS]) + "\n"
    assert files.steps_missing(table) is None


class ShadowRow(ctypes.Structure):
    """``struct shadow_row`` of firmware/lib/diag/shadow_row.h."""

    _fields_ = (
        ("t_us", ctypes.c_uint64),
        ("accel", ctypes.c_int32 * 3),
        ("gyro", ctypes.c_int32 * 3),
        ("flags", ctypes.c_uint16),
    )


def test_rows_that_the_firmware_writes_read_back_as_they_went_in(tmp_path: Path) -> None:
    folder = ROOT / "firmware/lib/diag"
    library = shared_library(tmp_path / "row.so", [folder / "shadow_row.c"], [folder])
    heading = re.search(r'"(#shadow,[^"]+)"', (folder / "shadow_row.h").read_text())
    assert heading is not None
    assert heading[1] == HEADING
    rng = np.random.default_rng(6)
    t_us = np.array([0, 9_999, (1 << 63) - 1, *rng.integers(0, 1 << 50, 40)])
    accel = rng.integers(-1_600_000, 1_600_000, (len(t_us), 3))
    gyro = rng.integers(-4_000_000, 4_000_000, (len(t_us), 3))
    accel[0], gyro[0] = (-1, 0, 1), (-1, -99_999, 5)
    said = []
    for k, t in enumerate(t_us.tolist()):
        row_k = ShadowRow(t, (*accel[k].tolist(),), (*gyro[k].tolist(),), k % 8)
        text = ctypes.create_string_buffer(112)
        assert library.shadow_row_text(ctypes.byref(row_k), text) == len(text.value)
        said.append(text.value.decode("ascii"))
    table = tables(recording((0, FRAME + lines(heading[1], *said))), "leader")["shadow"]
    assert table.bad_rows == 0
    assert table.columns["t_us_node"].tolist() == t_us.tolist()
    assert table.columns["flags"].tolist() == [k % 8 for k in range(len(t_us))]
    for axis, letter in enumerate("xyz"):
        assert table.columns[f"a{letter}_mps2"] == pytest.approx(accel[:, axis] * 1e-4, abs=1e-9)
        assert table.columns[f"g{letter}_radps"] == pytest.approx(gyro[:, axis] * 1e-5, abs=1e-9)
