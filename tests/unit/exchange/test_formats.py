# SPDX-License-Identifier: Apache-2.0
"""Each format read back by somebody else's reader, and the tables against the decoded stream."""

from __future__ import annotations

import csv
import json
import math

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from hil.exchange import export
from hil.exchange.table import ExchangeError
from hil.reference import broad

TICK_S = 62.5e-9
GYRO_2000 = math.radians(0.070)
ACCEL_16 = 0.000488 * 9.80665
"""Of a count, from the datasheet (DS12814, table 2), rounded there to three digits."""


def test_samples_are_those_of_the_stream_in_datasheet_units(real, tables):
    found = real.decoded("follower")
    batch, rows = found.messages["imu_batch"], found.groups["imu_batch"]
    table = tables.tables["imu_follower"]
    assert len(table) == len(rows) == int(batch["count"].sum())
    assert table["gyro_y_radps"] == pytest.approx(rows["gyro_lsb"][:, 1] * GYRO_2000, rel=1e-3)
    assert table["accel_z_mps2"] == pytest.approx(rows["accel_lsb"][:, 2] * ACCEL_16, rel=1e-3)
    first = np.cumsum(batch["count"]) - batch["count"]
    assert table["t_node_s"][first] == pytest.approx(
        batch["t_first_ticks_node"] * TICK_S, abs=1e-12
    )
    # The period in the frame is in 1/256 ticks.
    third = first[batch["count"] > 2] + 2
    period_s = batch["period_ticks"][batch["count"] > 2] * TICK_S / 256
    assert table["t_node_s"][third] - table["t_node_s"][third - 2] == pytest.approx(
        2 * period_s, abs=1.01 * TICK_S
    )


def test_follower_times_on_the_leaders_clock_are_the_clock_models(tables):
    """Those that the leader's own model, of the sync table, gives for the node's times."""
    table, sync = tables.tables["imu_follower"], tables.tables["sync"]
    locked = np.flatnonzero(sync["state"] == "locked")
    at = locked[len(locked) // 2]
    t_ref, offset, skew = (sync[k][at] for k in ("t_leader_s", "offset_s", "skew"))
    leader = table["t_leader_s"]
    near = np.abs(leader - t_ref) < 0.05
    assert near.sum() > 10
    predicted = leader[near] + offset + skew * (leader[near] - t_ref)
    assert predicted == pytest.approx(table["t_node_s"][near], abs=1e-6)
    assert np.isnan(leader[table["t_node_s"] < 1.0]).all(), "nothing was locked then"


def test_states_have_unit_quaternions_and_ascend_and_their_names_carry_units(tables):
    ekf = tables.tables["ekf"]
    norm = sum(ekf[f"quaternion_{axis}"] ** 2 for axis in "wxyz")
    assert norm == pytest.approx(np.ones(len(ekf)), abs=1e-5)
    states = [
        c for c in ekf.columns if c.name.startswith(("position_", "velocity_", "quaternion_"))
    ]
    biases = [c for c in ekf.columns if c.name.startswith(("accel_bias", "gyro_bias"))]
    variances = [c for c in ekf.columns if c.name.startswith("variance_")]
    assert (len(states) + len(biases), len(variances)) == (16, 15)
    assert np.all(np.diff(ekf["t_leader_s"]) > 0)
    for table in tables.tables.values():
        assert all(np.shape(c.values) == (len(table),) and c.meaning for c in table.columns)


def test_csv(tables, tmp_path):
    folder = tmp_path / "out"
    export.write(tables, "csv", folder)
    for name, table in tables.tables.items():
        with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        assert len(rows) == len(table)
        for column in table.columns:
            if column.values.dtype.kind == "f":
                read = np.array([float(r[column.name] or "nan") for r in rows])
                assert np.array_equal(read, column.values, equal_nan=True)
    known = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    assert known["source"] == "sim"
    assert set(known["build_ids"]) == {"leader", "follower"}


def test_npz_needs_no_pickle(tables, tmp_path):
    file = tmp_path / "out.npz"
    export.write(tables, "npz", file)
    with np.load(file, allow_pickle=False) as archive:
        for name, table in tables.tables.items():
            for column in table.columns:
                read = archive[f"{name}/{column.name}"]
                if column.is_text:
                    assert read.tolist() == column.values.tolist()
                else:
                    assert np.array_equal(read, column.values, equal_nan=read.dtype.kind == "f")
        assert json.loads(str(archive["provenance_json"])) == tables.provenance


def test_parquet_carries_units_and_provenance(tables, tmp_path):
    folder = tmp_path / "out"
    export.write(tables, "parquet", folder)
    read = pq.read_table(folder / "imu_leader.parquet")
    table = tables.tables["imu_leader"]
    for column in table.columns:
        assert np.array_equal(
            read[column.name].to_numpy(), column.values, equal_nan=column.values.dtype.kind == "f"
        )
        assert read.schema.field(column.name).metadata[b"unit"].decode() == column.unit
    assert json.loads(read.schema.metadata[b"hil.provenance"]) == tables.provenance
    events = pq.read_table(folder / "events.parquet")
    assert events["kind"].to_pylist() == tables.tables["events"]["kind"].tolist()


def test_hdf5_is_read_by_the_reader_of_broad(tables, tmp_path):
    file = tmp_path / "broad" / "99_ours.hdf5"
    export.write(tables, "hdf5", file)
    trial = broad.load(tmp_path, "99")
    table = tables.tables["imu_leader"]
    assert trial.rate_hz == pytest.approx(1.0 / np.median(np.diff(table["t_node_s"])), rel=1e-4)
    assert np.array_equal(trial.gyro_radps[:, 2], table["gyro_z_radps"])
    assert np.array_equal(trial.accel_mps2[:, 0], table["accel_x_mps2"])
    assert np.isnan(trial.q_true).all()
    assert np.isnan(trial.p_true_m).all()
    with h5py.File(file) as read:
        assert "no cameras" in read.attrs["info"]
        assert read["follower/imu_gyr"].shape == (len(tables.tables["imu_follower"]), 3)
        one = read["hil/ekf/velocity_z_mps"]
        assert one.attrs["unit"] == "m/s"
        assert np.array_equal(one[:], tables.tables["ekf"]["velocity_z_mps"])


def test_mcap_is_decoded_by_the_schemas_inside_it(tables, tmp_path):
    file = tmp_path / "out.mcap"
    export.write(tables, "mcap", file)
    found: dict[str, list] = {}
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
        (metadata,) = list(reader.iter_metadata())
    assert json.loads(metadata.metadata["json"]) == tables.provenance
    ekf = tables.tables["ekf"]
    assert [m.velocity_z_mps for _, m in found["/ekf"]] == ekf["velocity_z_mps"].tolist()
    times = np.array([t for t, _ in found["/ekf"]]) / 1e9
    assert times == pytest.approx(ekf["t_leader_s"], abs=1e-9)
    assert len(found["/leader/imu"]) == len(tables.tables["imu_leader"])
    _, turn = found["/tf"][0]
    assert turn.DESCRIPTOR.full_name == "foxglove.FrameTransform"
    assert (turn.parent_frame_id, turn.rotation.w) == ("world", ekf["quaternion_w"][0])
    assert found["/events"][-1][1].DESCRIPTOR.full_name == "foxglove.Log"
    assert found["/provenance"][0][1].source == "sim"


def test_a_folder_that_is_there_stays_as_it_is(tables, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ExchangeError, match="is there already"):
        export.write(tables, "csv", tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_an_export_that_fails_leaves_nothing(tables, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(export.csv_files, "write_provenance", full)
    with pytest.raises(ExchangeError, match="No space left"):
        export.write(tables, "csv", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
