# SPDX-License-Identifier: Apache-2.0
"""Out and in again: the same; foreign data: within half of the steps that are stated."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.checks import evaluate
from hil.exchange import export
from hil.exchange.contents import contents
from hil.exchange.foreign import Imu, Said
from hil.exchange.recorded import cut, imported, recording, save
from hil.recording import load

TICK_S = 62.5e-9


def column(n, low, high):
    return st.lists(st.integers(low, high), min_size=n, max_size=n).map(np.array)


@st.composite
def imus(draw):
    """Samples with jitter, gaps, lost indices, changes of every field."""
    n = draw(st.integers(3, 40))
    step = draw(st.integers(16_000, 400_000))
    jitter = draw(st.sampled_from([0, 1, 400]))
    steps = step + draw(column(n, -jitter, jitter))
    steps[draw(st.integers(1, n - 1))] += draw(st.sampled_from([0, 0, 10 * step]))
    ticks = np.cumsum(steps)
    lost = draw(column(n, 0, 1)) * draw(st.sampled_from([0, 0, 5]))
    known = draw(column(n, 0, 1)) if draw(st.booleans()) else np.ones(n, int)
    changes = draw(st.integers(0, n))
    before = np.arange(n) < changes
    return Imu(
        ticks,
        np.where(known, ticks + 777, -1),
        True,
        draw(column(6 * n, -32768, 32767)).reshape(n, 6),
        np.where(before, draw(st.sampled_from([125, 2000])), 2000),
        np.where(before, draw(st.sampled_from([2, 16])), 16),
        np.arange(n) + np.cumsum(lost),
        np.where(before, 9, 1),
        np.where(before, draw(st.integers(-32768, 32767)), 2500),
        np.where(before, draw(st.integers(0, 65535)), 256),
        {},
    )


def same(a, b) -> None:
    for name in ("imu_leader", "imu_follower"):
        assert (name in a.tables) == (name in b.tables)
        for one, other in (
            zip(a.tables[name].columns, b.tables[name].columns, strict=True)
            if (name in a.tables)
            else ()
        ):
            assert np.array_equal(one.values, other.values, equal_nan=True), one.name


@settings(max_examples=25, deadline=None)
@given(imus(), st.none() | imus(), st.sampled_from(["csv", "npz", "hdf5", "parquet"]))
def test_an_export_comes_back_bit_for_bit(leader, follower, form):
    leader = Imu(**{**vars(leader), "leader_ticks": leader.node_ticks})
    found = {"leader": leader} | ({} if follower is None else {"follower": follower})
    before = contents(recording(found, {"files": [], "sensors": {}}, "small"))
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "out"
        export.write(before, form, path)
        again, _ = imported([path], Said(), "again")
    same(before, contents(again))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 10**7), min_size=1, max_size=200))
def test_batches_give_back_every_tick(steps):
    ticks = np.cumsum([0, *steps])
    made = cut(ticks, np.zeros(len(ticks), bool))
    back = [
        int(ticks[first]) + (k * period + 128) // 256 for first, n, period in made for k in range(n)
    ]
    assert back == ticks.tolist()
    assert [a for a, _, _ in made] == np.cumsum([0, *(n for _, n, _ in made)]).tolist()[:-1]
    assert all(1 <= n <= 16 for _, n, _ in made)


def test_a_real_recording_comes_back_and_hil_runs_on_it(tables, tmp_path):
    export.write(tables, "npz", tmp_path / "out.npz")
    made, facts = imported([tmp_path / "out.npz"], Said(), "again")
    path = save(made, tmp_path / "again")
    loaded = load(path)
    same(tables, contents(loaded))
    assert loaded.provenance.source == "import"
    import_ = loaded.provenance.scenario["import"]
    assert import_["files"] == facts["files"]
    assert len(facts["files"][0]["sha256"]) == 64
    assert loaded.integrity.complete
    judged = {m.name: m for m in evaluate(loaded)}
    assert judged["imu.leader.samples_lost"].value == 0.0
    # What was not recorded is never called sound.
    assert not math.isfinite(judged["sync.pairs_wrong"].value or math.nan)
    assert "ekf.core_mismatches" not in judged


def foreign(path, t, gyro_dps, accel_g, sep=","):
    names = ["time [ms]", *(f"Gyr_{a}" for a in "XYZ"), *(f"acc {a} (g)" for a in "xyz"), "note"]
    lines = [sep.join(names)]
    for row in np.column_stack([t * 1e3, gyro_dps, accel_g]).tolist():
        lines.append(sep.join([*map(repr, row), "hello"]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_foreign_values_come_within_half_a_step(tmp_path):
    rng = np.random.default_rng(5)
    t = 3.0 + np.arange(400) / 200.0 + rng.uniform(-1e-4, 1e-4, 400)
    gyro = rng.uniform(-300.0, 300.0, (400, 3))
    accel = rng.normal((0.0, 0.0, 1.0), 0.2, (400, 3))
    files = [
        foreign(tmp_path / f"{n}.csv", t, gyro * k, accel) for n, k in (("a", 1.0), ("b", 0.5))
    ]
    made, facts = imported(files, Said(gyro_unit="dps"), "two")
    found = contents(made).tables
    for name, share in (("imu_leader", 1.0), ("imu_follower", 0.5)):
        table, said = found[name], facts["sensors"][name.removeprefix("imu_")]
        assert table["t_leader_s"] == pytest.approx(t, abs=0.51 * TICK_S)
        read = np.stack([table[f"gyro_{a}_radps"] for a in "xyz"], axis=1)
        assert np.abs(read - np.radians(gyro * share)).max() <= 0.501 * said["gyro_step_radps"]
        read = np.stack([table[f"accel_{a}_mps2"] for a in "xyz"], axis=1)
        assert np.abs(read - accel * 9.80665).max() <= 0.501 * said["accel_step_mps2"]
    # 300 dps need 500 dps of full scale, 17.5 mdps a count.
    assert facts["sensors"]["leader"]["gyro_step_radps"] == pytest.approx(math.radians(0.0175))
    assert facts["sensors"]["follower"]["gyro_fs_dps"] == 250


def test_nanoseconds_since_1970_keep_their_last_digit(tmp_path):
    n = 50
    t = 1_764_000_000_123_456_789 + np.arange(n, dtype=np.int64) * 5_000_000
    np.savez(
        tmp_path / "x.npz",
        timestamp_ns=t,
        gyro_radps=np.zeros((n, 3)),
        accel_mps2=np.tile([0.0, 0.0, 9.8], (n, 1)),
    )
    made, facts = imported([tmp_path / "x.npz"], Said(), "x")
    assert np.array_equal(
        np.rint(contents(made).tables["imu_leader"]["t_node_s"] * 1e9), np.arange(n) * 5_000_000
    )
    assert "1764000000123456789" in facts["sensors"]["leader"]["times"]
