# SPDX-License-Identifier: Apache-2.0
"""References in CSV: units found out or asked for, hostile files refused with their line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.truth.reference import Columns, Reference, ReferenceError, read

N = 50
T = np.arange(N) * 0.01
Z = 0.4 * np.sin(T)


def written(folder, heading, t=T, x=Z, sep=","):
    lines = [f"{a:.6f}{sep}{b:.6f}" for a, b in zip(t, x, strict=True)]
    file = folder / "reference.csv"
    file.write_text("\n".join([*([heading] if heading else []), *lines, ""]), encoding="utf-8")
    return file


def is_read(found: Reference, quantity: str) -> None:
    assert found.quantity == quantity
    assert found.t_s == pytest.approx(T, abs=1e-6)
    assert found.value == pytest.approx(Z, abs=1e-5)


@pytest.mark.parametrize(
    ("heading", "t", "x", "quantity"),
    [
        ("time_s,height_m", 1.0, 1.0, "position"),
        ("Time (ms),Position (mm)", 1e3, 1e3, "position"),
        ("t [us],Displacement [cm]", 1e6, 1e2, "position"),
        ("timestamp,velocity_mps", 1.0, 1.0, "velocity"),
        ("time ms,speed mm/s", 1e3, 1e3, "velocity"),
        # Units from sizes: 10 apart must be ms; 0.19 wide must be m, 190 wide mm.
        ("time,height", 1e3, 1.0, "position"),
        ("time,height", 1.0, 1e3, "position"),
    ],
)
def test_columns_and_units_are_found_by_name_or_size(tmp_path, heading, t, x, quantity):
    is_read(read(written(tmp_path, heading, T * t, Z * x)), quantity)


def test_options_go_before_names_and_make_a_file_without_names_readable(tmp_path):
    file = written(tmp_path, "", T * 1e3, Z * 1e3)
    is_read(read(file, Columns(unit="mm")), "position")
    is_read(read(file, Columns(unit="mm/s", time_unit="ms")), "velocity")
    file = written(tmp_path, "time_s,height_m", T * 1e3, Z * 1e2)
    is_read(read(file, Columns(time_unit="ms", unit="cm")), "position")
    file = written(tmp_path, "zeit,strecke", Z * 10, T * 1e3)
    with pytest.raises(ReferenceError, match="no time column"):
        read(file)
    is_read_swapped = read(file, Columns("2", "zeit", "ms", "m"))
    assert is_read_swapped.value == pytest.approx(Z * 10, abs=1e-5)


def test_semicolons_decimal_commas_tabs_and_gaps(tmp_path):
    file = tmp_path / "a.csv"
    rows = [f"{a:.6f};{b:.6f}".replace(".", ",") for a, b in zip(T, Z, strict=True)]
    file.write_text("\ufefftime (s);height (m)\r\n" + "\r\n".join(rows), encoding="utf-8")
    is_read(read(file), "position")
    is_read(read(written(tmp_path, "time_s\theight_m", sep="\t")), "position")
    file.write_text(
        "time_s,height_m\n" + "".join(f"{a},{b}\n5.0,\n" for a, b in zip(T, Z, strict=True))
    )
    found = read(file)
    is_read(found, "position")
    assert found.gaps == N


GOOD = "".join(f"{a:.3f},{b:.5f}\n" for a, b in zip(T, Z, strict=True))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("\n\n  \n", "empty"),
        ("time_s,height_m\n", "0 rows"),
        ("time_s,height_m\n" + GOOD + "0.600,abc\n", r"line 52: 'abc' in 'height_m' is not"),
        ("time_s,height_m\n" + GOOD + "0.600,inf\n", r"line 52: 'inf'"),
        ("time_s,height_m\n" + GOOD + "0.600,1_0\n", r"line 52: '1_0'"),
        ("time_s,height_m\n" + GOOD + "0.600,1e999\n", r"line 52"),
        ("time_s,height_m\n" + GOOD + "0.600\n", r"line 52: 1 fields"),
        ("time_s,height_m\n" + GOOD + "\n0.100,0.1\n", r"line 53: the time does not increase"),
        ("time_s,height_m\n" + GOOD + "0.600,\0\n", r"line 52: a null byte"),
        ("time_s,height_m\n" + GOOD + "9" * 9000, r"line 52: longer than"),
        ("time_s,height_m\n" + "," * 90 + "\n", r"line 2: more than 64 columns"),
        ("time_fortnights,height_m\n" + GOOD, "no time column"),
        ("time (h),height_m\n" + GOOD, r"line 1: 'h' is no unit of time"),
        ("time_s,weight\n" + GOOD, "no value column"),
        (
            "time_s,height\n"
            + "".join(f"{a:.3f},{50 * b:.4f}\n" for a, b in zip(T, Z, strict=True)),
            "--unit",
        ),
        (GOOD, "unit of 'column 2'"),
        ("time_s,height_m\n" + '0.1,"' * 30, r"line 2|CSV|fields"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, message):
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(ReferenceError, match=message) as raised:
        read(file)
    assert "bad.csv" in str(raised.value)
    assert raised.value.mend


def test_no_file_a_folder_and_bytes_that_are_no_text(tmp_path):
    with pytest.raises(ReferenceError, match="No such file"):
        read(tmp_path / "none.csv")
    with pytest.raises(ReferenceError, match="directory"):
        read(tmp_path)
    file = tmp_path / "a.csv"
    file.write_bytes(b"time_s,height_m\n\xff\xfe\x00")
    with pytest.raises(ReferenceError, match="UTF-8"):
        read(file)


def test_a_file_too_large_is_refused_unread(tmp_path):
    file = tmp_path / "large.csv"
    with file.open("wb") as stream:
        stream.truncate((1 << 27) + 1)
    with pytest.raises(ReferenceError, match="larger than 128 MiB"):
        read(file)


@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_refused(tmp_path_factory, data):
    file = tmp_path_factory.mktemp("any") / "any.csv"
    file.write_bytes(b"time_s,height_m\n" + data)
    with pytest.raises(ReferenceError):
        read(file)
