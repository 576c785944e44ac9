# SPDX-License-Identifier: Apache-2.0
"""HDF5 in the layout of the BROAD benchmark, with everything else in groups beside it.

At the root, and in the group ``follower``, lies what BROAD's files hold: ``imu_gyr`` rad/s,
``imu_acc`` m/s^2, ``imu_mag``, ``opt_quat``, ``opt_pos``, ``movement`` and the attribute
``sampling_rate``. Sample k is at k / sampling_rate, so lost samples are rows of NaN.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.exchange.table import Contents, ExchangeError, Table
from hil.extras import module

INFO: Final = """\
{label}: {name}. Exported by hil; build ids: {builds}.

Layout of BROAD (D. Laidig et al., Data 6(7), 2021). IMU data: imu_gyr in rad/s, imu_acc in m/s^2,
of the {role}'s LSM6DSOX, from its last start on; sample k is at {start:.9f} s + k / sampling_rate
on that node's clock, and a lost sample is a row of NaN. What this rig does not have is NaN: imu_mag
(the chip has no magnetometer), opt_quat and opt_pos (no cameras). movement marks the time from the
first repetition's start to the last one's end, by the estimate; all False where there is none.
All tables of the export, with exact times, are in the group hil; where they come from, as JSON, is
in its attribute provenance_json.
"""


def write(contents: Contents, path: Path) -> None:
    """Write ``path``.

    Raises:
        ExchangeError: h5py is not installed, or too many samples are lost for rows by number.
    """
    h5py = module("h5py")
    with h5py.File(path, "w") as file:
        imu = [name for name in ("imu_leader", "imu_follower") if name in contents.tables]
        for name in imu:
            role = name.removeprefix("imu_")
            place = file if name == imu[0] else file.create_group(role)
            _broad(contents, contents.tables[name], role, place)
        everything = file.create_group("hil")
        everything.attrs["provenance_json"] = json.dumps(dict(contents.provenance), allow_nan=False)
        for name, table in contents.tables.items():
            group = everything.create_group(name)
            for column in table.columns:
                kind = {"dtype": h5py.string_dtype()} if column.is_text else {}
                made = _dataset(group, column.name, column.values, **kind)
                made.attrs["unit"] = column.unit
                made.attrs["meaning"] = column.meaning


def _broad(contents: Contents, table: Table, role: str, place: Any) -> None:
    index, t_s = table["sample_index"], table["t_node_s"]
    t_s = table["t_leader_s"] if np.isnan(t_s).all() else t_s
    anew = np.flatnonzero(np.diff(index) < 0)
    since = int(anew[-1]) + 1 if anew.size else 0
    index, t_s = index[since:] - index[since], t_s[since:]
    rows = int(index[-1]) + 1
    if rows > 2 * len(index) + 1000:
        raise ExchangeError(
            f"{rows - len(index)} of {rows} samples of the {role} are lost: rows by number, as "
            "BROAD has them, would be mostly empty",
            "take another format: --format npz",
        )
    timed = np.isfinite(t_s)
    rate = np.nan
    start = float("nan")
    if np.count_nonzero(timed) > 1:
        slope, start = np.polyfit(index[timed], t_s[timed], 1)
        rate = 1.0 / slope if slope > 0 else np.nan
    for name, quantity, unit in (("imu_gyr", "gyro", "radps"), ("imu_acc", "accel", "mps2")):
        values = np.full((rows, 3), np.nan)
        values[index] = np.stack(
            [table[f"{quantity}_{axis}_{unit}"][since:] for axis in "xyz"], axis=1
        )
        _dataset(place, name, values)
    for name, width in (("imu_mag", 3), ("opt_quat", 4), ("opt_pos", 3)):
        _dataset(place, name, np.full((rows, width), np.nan))
    _dataset(place, "movement", _movement(contents, table, since, index, rows))
    place.attrs["sampling_rate"] = rate
    known = contents.provenance
    place.attrs["info"] = INFO.format(
        label=known["source_label"],
        name=known["recording"],
        builds=", ".join(f"{r} {b}" for r, b in known["build_ids"].items()) or "none",
        role=role,
        start=start,
    )


def _movement(
    contents: Contents, table: Table, since: int, index: NDArray[Any], rows: int
) -> NDArray[np.bool_]:
    moving = np.zeros(rows, dtype=bool)
    found = contents.tables.get("repetitions")
    if found is not None:
        t_s = table["t_leader_s"][since:]
        first, last = found["t_start_s_leader"].min(), found["t_end_s_leader"].max()
        inside = index[(t_s >= first) & (t_s <= last)]
        if inside.size:
            moving[inside[0] : inside[-1] + 1] = True
    return moving


def _dataset(place: Any, name: str, values: NDArray[Any], **kind: Any) -> Any:
    return place.create_dataset(name, data=values, compression="gzip", **kind)
