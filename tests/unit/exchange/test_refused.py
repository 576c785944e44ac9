# SPDX-License-Identifier: Apache-2.0
"""Hostile and doubtful files: one clear error each, before memory is spent."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.errors import HilError
from hil.exchange.foreign import Said
from hil.exchange.recorded import imported, save
from hil.synthesis import Plan, synthesise

REFUSALS = Path(__file__).parents[3] / "docs" / "refusals.md"
NAMES = "t_s,gyro_x_radps,gyro_y_radps,gyro_z_radps,accel_x_mps2,accel_y_mps2,accel_z_mps2"
ROWS = [f"{k / 100},0,0,0,0,0,9.8" for k in range(10)]


def csv(*changes, names=NAMES):
    rows = list(ROWS)
    for at, text in changes:
        rows[at] = text
    return "\n".join([names, *rows, ""]).encode()


def npz(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def arrays(n=10, **more):
    given_ = {"t_s": np.arange(n) / 100, "gyro_radps": np.zeros((n, 3))}
    return given_ | {"accel_mps2": np.tile([0.0, 0.0, 9.8], (n, 1))} | more


def npy_header(shape, descr="<f8"):
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"
    text += " " * (117 - len(text)) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def npz_of(member, compress=zipfile.ZIP_DEFLATED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compress) as archive:
        archive.writestr("t_s.npy", member)
    return stream.getvalue()


def hdf5(make):
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        make(file)
    return stream.getvalue()


def h5_good(file, n=10):
    for name, value in arrays(n).items():
        file[name] = value


def h5_huge(file):
    h5_good(file)
    file.create_dataset("time_s", shape=(10**12,), chunks=(1000,), dtype="f8")


def h5_link(file):
    h5_good(file)
    file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/")


def h5_bomb(file):
    h5_good(file)
    one = file.create_dataset("bomb", (1000,), "f8", chunks=(1000,), compression="gzip")
    one.id.write_direct_chunk((0,), zlib.compress(b"\0" * 10_000_000))


def parquet(columns):
    stream = io.BytesIO()
    pq.write_table(pa.table(columns), stream)
    return stream.getvalue()


def flat(**more):
    found = {"t_s": np.arange(10) / 100}
    found |= {f"gyro_{a}_radps": np.zeros(10) for a in "xyz"}
    return found | {f"accel_{a}_mps2": np.full(10, 5.7) for a in "xyz"} | more


BOMB = npz_of(npy_header((1000,)) + bytes(16_000_000))
CASES = {
    "nan": (csv((3, "0.03,nan,0,0,0,0,9.8")), "line 5: 'gyro_x_radps' is nan"),
    "an empty cell": (csv((3, "0.03,,0,0,0,0,9.8")), "line 5: 'gyro_x_radps' is nan"),
    "inf": (csv((2, "0.02,0,0,0,inf,0,9.8")), "line 4: 'accel_x_mps2' is inf"),
    "ragged": (csv((4, "0.04,0,0")), "line 6: 3 fields, but 7 column names"),
    "words": (csv((4, "0.04,0,0,0,0,0,heavy")), "no column of numbers for accel_z"),
    "no names": ("\n".join(ROWS).encode(), "line 1: is not a line of column names"),
    "names twice": (csv(names=NAMES.replace("gyro_y", "gyro_x")), "a column name occurs twice"),
    "time goes back": (csv((5, "0.01,0,0,0,0,0,9.8")), "line 7: the time does not increase"),
    "no unit": (csv(names=NAMES.replace("_radps", "")), "in which unit gyro is"),
    "unknown unit": (csv(names=NAMES.replace("gyro_x_radps", "gyro_x [rpm]")), "different units"),
    "accel in g said to be m/s^2": (
        csv(*((k, f"{k / 100},0,0,0,0,0,1.0") for k in range(10))),
        "that is not gravity's 9.8",
    ),
    "gyro in dps said to be rad/s": (
        csv((3, "0.03,9999,0,0,0,0,9.8")),
        "line 5: gyro is 9999 in SI units, read as radps: beyond any full scale",
    ),
    "times in the wrong unit": (csv(names=NAMES.replace("t_s", "t_ns")), "does not increase"),
    "slow": (
        csv(*((k, f"{k},0,0,0,0,0,9.8") for k in range(10))),
        "samples a second are none of an IMU's",
    ),
    "two candidates": (
        csv(names=NAMES.replace("gyro_y_radps", "gyr_x_radps")),
        "could be gyro_x",
    ),
    "one row": ((NAMES + "\n" + ROWS[0]).encode(), "nothing to import"),
    "empty": (b"", "is empty"),
    "binary": (b"\x00\xff\xfe" * 100, "not a CSV file"),
    "objects": (npz(**arrays(note=np.array([{}], dtype=object))), "never unpickled"),
    "npz of another length": (npz(**arrays(t_s=np.arange(9) / 100)), "'t_s' 9"),
    "npz with nan": (npz(**arrays(t_s=np.full(10, np.nan))), "row 1: 't_s' is nan"),
    "npz claims 1e12 rows": (npz_of(npy_header((10**12,))), "claims shape (1000000000000,)"),
    "npz claims a negative shape": (npz_of(npy_header((-1, -8)) + bytes(64)), "claims shape"),
    "npz with code in its header": (npz_of(npy_header("__import__('os')")), "is no array"),
    "npz bomb": (BOMB, "claims shape"),
    "cut npz": (npz(**arrays())[:-30], "not a whole .npz"),
    "hdf5 claims 1e12 rows": (hdf5(h5_huge), "claims 1000000000000 rows"),
    "hdf5 with a link outside": (hdf5(h5_link), "is a link that leads elsewhere"),
    "hdf5 bomb": (hdf5(h5_bomb), "unpacks to more than"),
    "cut hdf5": (hdf5(h5_good)[:900], "damaged, or not HDF5"),
    "parquet of texts": (parquet(flat(t_s=["a"] * 10)), "neither times nor a rate"),
    "parquet with nulls": (
        parquet(flat(t_s=pa.array([0.0, None, *(k / 100 for k in range(2, 10))]))),
        "row 2: 't_s' is nan",
    ),
    "parquet with lists": (parquet(flat(gyro_x_radps=[[1.0]] * 10)), "for gyro_x"),
    "cut parquet": (parquet(flat())[:-20], "damaged, or not Parquet"),
}


@pytest.mark.parametrize("name", CASES)
def test_it_is_refused_in_a_sentence_and_in_the_table(name, tmp_path):
    data, message = CASES[name]
    file = tmp_path / "data.bin"
    file.write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(HilError) as caught:
            imported([file], Said(), "x")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert message in caught.value.message
    assert str(file) in caught.value.message
    assert peak < 64 << 20
    assert name in REFUSALS.read_text(encoding="utf-8")


@pytest.mark.parametrize("data", [csv(), npz(**arrays()), hdf5(h5_good), parquet(flat())])
def test_the_same_files_without_the_fault_are_read(data, tmp_path):
    file = tmp_path / "data.bin"
    file.write_bytes(data)
    _, facts = imported([file], Said(), "x")
    assert facts["sensors"]["leader"]["samples"] == 10


@settings(max_examples=120, deadline=None)
@given(
    st.sampled_from([csv(), npz(**arrays()), parquet(flat())]),
    st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), min_size=1, max_size=6),
)
def test_damage_is_read_or_refused_and_nothing_else(tmp_path_factory, data, changes):
    broken = bytearray(data)
    for at, value in changes:
        broken[at % len(broken)] = value
    file = tmp_path_factory.mktemp("damaged") / "data.bin"
    file.write_bytes(broken)
    said = ""
    try:
        imported([file], Said(), "x")
    except HilError as error:
        said = error.message
    assert said.isprintable()


def test_too_much_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("hil.exchange.read_npz.BYTES_MAX", 1_000_000)
    file = tmp_path / "bomb.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for k in range(3):
            with archive.open(f"a{k}.npy", "w", force_zip64=True) as member:
                member.write(npy_header((125_000,)))
                member.write(bytes(1_000_000))
    assert file.stat().st_size < 10_000
    with pytest.raises(HilError, match="3000384 bytes unpacked, the limit is"):
        imported([file], Said(), "x")


def test_options_and_names_that_disagree_are_refused(tmp_path):
    file = tmp_path / "x.csv"
    file.write_bytes(csv())
    for said, message in (
        (Said(gyro_unit="dps"), "says radps, --gyro-unit says dps"),
        (Said(rate_hz=100.0), "--rate is said too"),
        (Said(gyro_unit="rpm"), "no unit of gyro"),
        (Said(columns={"gyro_x": "nowhere"}), "no column of numbers 'nowhere'"),
    ):
        with pytest.raises(HilError, match=message):
            imported([file], said, "x")
    with pytest.raises(HilError, match="3 sensors"):
        imported([file] * 3, Said(), "x")


def test_a_recording_that_cannot_be_written_leaves_no_folder(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hil.exchange.recorded.os.replace", full)
    with pytest.raises(HilError, match="cannot be written: No space"):
        save(synthesise(Plan(duration_s=2.0)), tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
