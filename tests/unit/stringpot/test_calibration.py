# SPDX-License-Identifier: Apache-2.0
"""Counts to millimetres: fits worked out by hand, what is warned of, files that are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from esp32 import MM_PER_COUNT, OFFSET_MM, counts

from hil.stringpot.calibration import Calibration, Point, fit, load, point, save, warnings
from hil.stringpot.samples import Samples, StringPotError


def taken(raw: np.ndarray) -> Samples:
    n = len(raw)
    return Samples(1000 * np.arange(n), raw.astype(np.int64), np.zeros(n, np.int64), 0, 0)


def test_a_line_by_hand() -> None:
    # Through (100, 0), (200, 11), (300, 19): slope 19/200, mean 200 and 10.
    found = fit([Point(19.0, 300.0), Point(0.0, 100.0), Point(11.0, 200.0)])
    assert found.mm_per_count == pytest.approx(0.095)
    assert found.offset_mm == pytest.approx(10.0 - 0.095 * 200.0)
    assert found.residuals_mm == pytest.approx([-0.5, 1.0, -0.5])
    assert found.raw_range == (100.0, 300.0)
    assert found.mm([0, 400]) == pytest.approx([-9.0, 29.0])


def test_a_string_that_shortens_has_a_negative_slope() -> None:
    assert fit([Point(0.0, 4000.0), Point(1000.0, 0.0)]).mm_per_count == pytest.approx(-0.25)


def test_two_points_say_that_they_show_nothing_of_the_converter() -> None:
    (said,) = warnings(fit([Point(0.0, 100.0), Point(100.0, 500.0)]))
    assert "two points" in said


def test_a_bent_converter_is_warned_of_where_it_is_bent_and_by_how_much() -> None:
    """Straight up to 600 mm; beyond, a millimetre is 5 % more counts."""
    lengths = np.arange(0.0, 1001.0, 200.0)
    raw = 10.0 * lengths + np.maximum(lengths - 600.0, 0.0) * 0.5
    found = fit([Point(mm, x, 0.05, 1000) for mm, x in zip(lengths, raw, strict=True)])
    said = warnings(found)
    assert any("from 800 to 1000 mm" in text for text in said)
    # There a velocity comes out as slope * 10.5 counts per mm.
    off = 100.0 * (found.mm_per_count * 10.5 - 1.0)
    assert any(f"{off:+.1f} %" in text for text in said if "from 800" in text)
    straight = fit([Point(mm, 10.0 * mm, 0.05, 1000) for mm in lengths])
    assert warnings(straight) == []


def test_noise_alone_is_not_called_a_bend() -> None:
    points = [
        point(mm, taken(counts(np.full(1000, mm), seed=round(mm))))
        for mm in (0.0, 100.0, 200.0, 400.0, 700.0, 1000.0)
    ]
    found = fit(points)
    assert warnings(found) == []
    # 8 counts of noise over 1,000 samples: 0.25 counts, 0.025 mm.
    assert all(0.05 < p.sigma_raw < 0.6 for p in points)
    assert found.mm_per_count == pytest.approx(MM_PER_COUNT, rel=2e-4)
    assert found.offset_mm == pytest.approx(OFFSET_MM, abs=0.15)


def test_a_string_that_moves_or_says_little_is_no_point() -> None:
    with pytest.raises(StringPotError, match="moved by"):
        point(5.0, taken(np.linspace(1000, 1200, 1000)))
    with pytest.raises(StringPotError, match="only 99 samples"):
        point(5.0, taken(np.full(99, 1000)))


@pytest.mark.parametrize(
    "points",
    [
        [Point(0.0, 1.0)],
        [Point(0.0, 100.0), Point(100.0, 110.0)],
        [Point(5.0, 100.0), Point(5.0, 900.0)],
        [Point(0.0, 100.0), Point(float("nan"), 900.0)],
    ],
)
def test_points_that_make_no_line(points: list[Point]) -> None:
    with pytest.raises(StringPotError):
        fit(points)


def test_a_file_reads_back_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "pot.toml"
    found = fit([Point(0.0, 103.25, 0.2, 998), Point(500.0, 5103.5), Point(1000.0, 10_101.0)])
    save(found, path)
    assert load(path) == found
    (tmp_path / "file").write_text("x")
    with pytest.raises(StringPotError, match="cannot be written"):
        save(found, tmp_path / "file" / "pot.toml")


GOOD = """format = 1
mm_per_count = 0.1
offset_mm = 3
[[points]]
length_mm = 0.0
raw = 1.0
sigma_raw = 0.1
samples = 10
[[points]]
length_mm = 9.0
raw = 2.0
sigma_raw = 0.1
samples = 10
"""


def test_a_file_written_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "pot.toml"
    path.write_text(GOOD)
    found = load(path)
    assert isinstance(found, Calibration)
    assert (found.mm_per_count, found.offset_mm, len(found.points)) == (0.1, 3.0, 2)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("format = 1", "format = 2", "format"),
        ("mm_per_count = 0.1", "mm_per_count = 0", "mm_per_count"),
        ("mm_per_count = 0.1", "mm_per_count = nan", "mm_per_count"),
        ("mm_per_count = 0.1", "mm_per_count = true", "mm_per_count"),
        ("offset_mm = 3", 'offset_mm = "x"', "offset_mm"),
        ("offset_mm = 3", "offset_mm = inf", "offset_mm"),
        ("offset_mm = 3", "", "offset_mm"),
        ("raw = 2.0", "", "raw"),
        ("offset_mm = 3", "offset_mm = = 3", "not a TOML file"),
        ("offset_mm = 3", "points = 3", "TOML"),
        (GOOD, "#" * 70_000, "larger than"),
        (GOOD[GOOD.rindex("[[points]]") :], "", "points"),
        (GOOD, "\x00", "TOML"),
    ],
)
def test_files_that_are_wrong_name_the_key(tmp_path: Path, old: str, new: str, what: str) -> None:
    path = tmp_path / "pot.toml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(StringPotError, match=what) as caught:
        load(path)
    assert "hil stringpot calibrate" in caught.value.mend


def test_no_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(StringPotError, match="No such file"):
        load(tmp_path / "pot.toml")
