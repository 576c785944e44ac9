# SPDX-License-Identifier: Apache-2.0
"""Lines of a string pot: wraps, losses, restarts, damage; counted by hand."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from esp32 import lines
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.stringpot.meter import PotMeter
from hil.stringpot.samples import StringPotError, of_csv, parse

WRAP = 1 << 32


def said(*times_us: int) -> list[bytes]:
    return [b"%d,7\r\n" % (t % WRAP) for t in times_us]


def test_the_clock_wraps_and_goes_on() -> None:
    found = parse(said(WRAP - 2000, WRAP - 1000, WRAP, WRAP + 1000))
    assert found.t_us.tolist() == [WRAP - 2000, WRAP - 1000, WRAP, WRAP + 1000]
    assert (found.lost, found.bad_lines, found.restarts) == (0, 0, 0)


def test_two_wraps_in_more_than_two_hours() -> None:
    t = np.arange(0, 2 * WRAP + 10_000_000, 900_000)
    assert parse(lines(t, t * 0)).t_us.tolist() == t.tolist()


def test_losses_are_counted_by_the_times_also_across_the_wrap() -> None:
    # 2,000 to 5,000: two missing. Jitter of 200 us is no loss. 8,500 ms: 8,495 missing.
    found = parse(said(0, 1000, 2000, 5000, 6200, 7000))
    assert found.lost == 2
    assert parse(said(WRAP - 1000, WRAP + 1000)).lost == 1
    pause = parse(said(0, 1000, 8_501_000, 8_502_000))
    assert (pause.lost, pause.restarts, pause.t_us[-1]) == (8499, 0, 8_502_000)


def test_a_restart_begins_a_new_run() -> None:
    found = parse([*said(90_000_000, 90_001_000), b"time_us,raw_adc\r\n", *said(500, 1500, 2500)])
    assert found.run.tolist() == [0, 0, 1, 1, 1]
    assert found.t_us.tolist() == [90_000_000, 90_001_000, 500, 1500, 2500]
    assert (found.restarts, found.lost, found.bad_lines) == (1, 0, 0)


def test_a_digit_lost_on_the_line_costs_that_line() -> None:
    times = [1_234_000, 1_235_000, 123_000, 1_237_000, 9_238_000, 1_239_000]
    found = parse(said(*times))
    assert found.t_us.tolist() == [1_234_000, 1_235_000, 1_237_000, 1_239_000]
    assert (found.bad_lines, found.restarts, found.lost) == (2, 0, 2)


BAD = ["", "1", "1,", ",1", "1,2,3", "-1,2", "1.5,2", "a,b", "1, 2x", "4294967296,1", "1,99999999",
       "1" * 60 + ",1", "١,2", "1_0,2"]  # fmt: skip


@pytest.mark.parametrize("bad", BAD[1:])
def test_what_is_no_sample_is_counted(bad: str) -> None:
    found = parse([*said(0), bad.encode(), *said(1000)])
    assert (found.t_us.tolist(), found.bad_lines) == ([0, 1000], 1)


def test_half_a_line_at_the_beginning_is_no_sample() -> None:
    found = parse([b"75296,2507", *said(4_286_876_296, 4_286_877_296, 4_286_878_296)])
    assert found.t_us.tolist() == [4_286_876_296, 4_286_877_296, 4_286_878_296]
    assert (found.bad_lines, found.restarts, found.lost) == (1, 0, 0)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.binary(max_size=30) | st.from_regex(rb"[0-9]{1,11},[0-9]{1,9}", fullmatch=True)))
def test_no_bytes_raise_anything_and_time_only_grows(pieces: list[bytes]) -> None:
    found = parse(pieces)
    for run in np.unique(found.run):
        assert np.all(np.diff(found.t_us[found.run == run]) > 0)
    assert len(found) + found.bad_lines <= len(pieces)


def test_a_meter_counts_the_same_in_any_pieces_and_keeps_nothing() -> None:
    t = 1000 * np.array([k for k in range(5000) if k % 100 != 3])
    stream = b"".join(lines(t, t % 4000)) + b"rubbish\r\n"
    for piece in (33, 4096):
        meter = PotMeter("stringpot", 0)
        for at in range(0, len(stream), piece):
            meter.feed(at, stream[at : at + piece])
        assert (meter.lines, meter.lost, meter.damaged) == (len(t) + 1, 50, 1)
        assert len(meter._reader.samples()) < 1000
    assert "ESP32" in PotMeter("stringpot", 0).hint(5_000_000_000)


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "raw.csv"
    path.write_bytes(b"000,12\r\ntime_us,raw_adc\r\n" + b"".join(said(5000, 6000)) + b"7000,")
    found = of_csv(path)
    assert found.t_us.tolist() == [0, 5000, 6000]
    assert found.bad_lines == 1
    path.write_text("name,date\n1,x\n2,y\n")
    with pytest.raises(StringPotError, match="3 lines are not time_us,raw_adc, and 0 are"):
        of_csv(path)
    with pytest.raises(StringPotError, match="No such file"):
        of_csv(tmp_path / "none.csv")


def test_an_hour_is_read_in_seconds(tmp_path: Path) -> None:
    t = np.arange(400_000) * 1000
    path = tmp_path / "long.csv"
    path.write_bytes(b"".join(lines(t, t % 4000)))
    begin_s = time.process_time()
    assert len(of_csv(path)) == 400_000
    assert time.process_time() - begin_s < 4.0
