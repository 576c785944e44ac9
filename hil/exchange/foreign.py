# SPDX-License-Identifier: Apache-2.0
"""Samples of one sensor from a sheet: which columns, which units, which full scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.exchange.contents import UNKNOWN_CDEGC
from hil.exchange.names import ACCEL_UNITS, GYRO_UNITS, TIME_UNITS, UNITS, meaning
from hil.exchange.sheets import RefusedError, Sheet
from hil.fusion.inputs import SUBTICKS_PER_TICK
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, CLIPPED_LSB, GYRO_RADPS_PER_LSB_PER_DPS
from hil.wire.messages import IMU_FLAGS, TICK_RATE_HZ

Int = NDArray[np.int64]
Float = NDArray[np.float64]

QUANTITIES: Final = tuple(f"{q}_{axis}" for q in ("gyro", "accel") for axis in "xyz")
OWN: Final = {"sample_index", "t_node_s", "t_leader_s", "gyro_fs_dps", "accel_fs_g", "flags"}
"""Columns that only an export of hil has, all of them."""
GYRO_FS_DPS: Final = tuple(125 << k for k in range(10))
ACCEL_FS_G: Final = tuple(2 << k for k in range(7))
"""Full scales that the protocol can name; beyond the chip's own, the same counts are coarser."""
FULL_SCALES: Final = {
    "gyro": (GYRO_RADPS_PER_LSB_PER_DPS, GYRO_FS_DPS),
    "accel": (ACCEL_MPS2_PER_LSB_PER_G, ACCEL_FS_G),
}
RATES_HZ: Final = (5.0, 20_000.0)
GRAVITY_MPS2: Final = (5.0, 20.0)
"""The middle of the specific force's magnitude: a sensor that is not thrown feels gravity."""
ORIGIN_MAX_S: Final = 1e6
ROWS_MIN: Final = 2
TEMPERATURE_LSB: Final = 0.01


@dataclass(frozen=True)
class Said:
    """What the user says of a file; None: as its names say.

    Attributes:
        time_unit, gyro_unit, accel_unit: keys of the tables of :mod:`hil.exchange.names`.
        rate_hz: of samples that are equally far apart, in a file without times.
        columns: quantity (``t``, ``gyro_x`` …) -> name of its column.
    """

    time_unit: str | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    rate_hz: float | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Imu:
    """n samples as the protocol carries them.

    Attributes:
        node_ticks: int64[n], own node's clock, ascending; leader_ticks: on the leader's, -1 where
            it is not known.
        own_clock: the node's clock is known apart from the leader's.
        counts: int64[n, 6], gyro x y z, accel x y z.
        gyro_fs_dps, accel_fs_g, index, flags, cdegc, sigma_subticks: int64[n].
        facts: how the file was read, plain data.
    """

    node_ticks: Int
    leader_ticks: Int
    own_clock: bool
    counts: Int
    gyro_fs_dps: Int
    accel_fs_g: Int
    index: Int
    flags: Int
    cdegc: Int
    sigma_subticks: Int
    facts: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.node_ticks)


def samples(sheet: Sheet, said: Said) -> Imu:
    """The samples of a sheet.

    Raises:
        RefusedError: a column or unit that cannot be told, a number that is none, times that do not
            increase, or values that do not fit any full scale.
    """
    if set(sheet.columns) >= OWN:
        return _own(sheet)
    return _foreign(sheet, said)


# An export of hil -----------------------------------------------------------------------------


def _own(sheet: Sheet) -> Imu:
    c = sheet.columns
    names = [
        f"{q}_{unit}" for q, unit in zip(QUANTITIES, ["radps"] * 3 + ["mps2"] * 3, strict=True)
    ]
    for name in (*names, *OWN, "t_sigma_s", "temperature_degc"):
        if name not in c:
            raise RefusedError(f"{sheet.where}: no column '{name}'", "export it again: hil export")
    n = _length(sheet, list(OWN) + names)
    may_miss = {"t_node_s", "t_leader_s", "temperature_degc"}
    for name in (*names, *OWN, "t_sigma_s"):
        if name not in may_miss:
            _finite(sheet, name)
    node_s, leader_s = (np.asarray(c[k], np.float64) for k in ("t_node_s", "t_leader_s"))
    own_clock = not np.isnan(node_s).all()
    if own_clock:
        _finite(sheet, "t_node_s")
    else:
        _finite(sheet, "t_leader_s")
    node = _ticks(sheet, node_s if own_clock else leader_s)
    known = np.isfinite(leader_s)
    leader = np.where(known, _ticks(sheet, np.where(known, leader_s, 0.0)), -1)
    _increasing(sheet, node)
    gyro_fs, accel_fs = (
        _whole(sheet, name, 1, most) for name, most in (("gyro_fs_dps", 65535), ("accel_fs_g", 255))
    )
    scale = np.concatenate(
        [
            np.repeat(gyro_fs[:, None] * GYRO_RADPS_PER_LSB_PER_DPS, 3, axis=1),
            np.repeat(accel_fs[:, None] * ACCEL_MPS2_PER_LSB_PER_G, 3, axis=1),
        ],
        axis=1,
    )
    values = np.stack([np.asarray(c[name], np.float64) for name in names], axis=1)
    counts = np.rint(values / scale)
    far = np.abs(counts + 0.5).max(axis=1) > 32768
    if far.any():
        raise RefusedError(
            f"{sheet.where}, {sheet.place(int(np.argmax(far)))}: a value beyond its full scale",
            "export it again: hil export",
        )
    degc = np.asarray(c["temperature_degc"], np.float64)
    cdegc = np.where(np.isnan(degc), UNKNOWN_CDEGC, np.rint(np.nan_to_num(degc) / TEMPERATURE_LSB))
    sigma = np.rint(np.asarray(c["t_sigma_s"], np.float64) * SUBTICKS_PER_TICK * TICK_RATE_HZ)
    return Imu(
        node,
        leader,
        own_clock,
        counts.astype(np.int64),
        gyro_fs,
        accel_fs,
        _whole(sheet, "sample_index", 0, (1 << 32) - 1),
        _whole(sheet, "flags", 0, 255),
        np.clip(cdegc, -32768, 32767).astype(np.int64),
        np.clip(sigma, 0, 65535).astype(np.int64),
        {
            "read_as": "table of an export of hil",
            "samples": n,
            **_rate(sheet, node),
            "gyro_fs_dps": int(gyro_fs.max()),
            "accel_fs_g": int(accel_fs.max()),
        },
    )


def _whole(sheet: Sheet, name: str, low: int, high: int) -> Int:
    values = np.asarray(sheet.columns[name], np.float64)
    bad = (values < low) | (values > high) | (values != np.rint(values))
    if bad.any():
        raise RefusedError(
            f"{sheet.where}, {sheet.place(int(np.argmax(bad)))}: '{name}' is "
            f"{values[bad][0]:g}, not a whole number from {low} to {high}",
            "export it again: hil export",
        )
    return values.astype(np.int64)


# Anything else ---------------------------------------------------------------------------------


def _foreign(sheet: Sheet, said: Said) -> Imu:
    found = _pick(sheet, said)
    n = _length(sheet, [name for name, _ in found.values()])
    for name, _ in found.values():
        _finite(sheet, name)
    gyro, gyro_unit = _si(sheet, found, "gyro", said.gyro_unit)
    accel, accel_unit = _si(sheet, found, "accel", said.accel_unit)
    ticks, time_facts = _times(sheet, found, said, n)
    middle = float(np.median(np.linalg.norm(accel, axis=1)))
    if not GRAVITY_MPS2[0] <= middle <= GRAVITY_MPS2[1]:
        raise RefusedError(
            f"{sheet.where}: the specific force is {middle:.4g} m/s^2 in the middle, read as "
            f"{accel_unit}: that is not gravity's 9.8",
            "say the unit: --accel-unit mps2, g or mg\n"
            "give accelerations with gravity in them, as the sensor has them",
        )
    gyro_fs = _full_scale(sheet, "gyro", gyro, gyro_unit)
    accel_fs = _full_scale(sheet, "accel", accel, accel_unit)
    counts = np.concatenate(
        [
            np.rint(gyro / (gyro_fs * GYRO_RADPS_PER_LSB_PER_DPS)),
            np.rint(accel / (accel_fs * ACCEL_MPS2_PER_LSB_PER_G)),
        ],
        axis=1,
    )
    same = np.ones(n, dtype=np.int64)
    return Imu(
        ticks,
        ticks,
        True,
        counts.astype(np.int64),
        gyro_fs * same,
        accel_fs * same,
        np.arange(n),
        IMU_FLAGS["hardware_time"] * same,
        UNKNOWN_CDEGC * same,
        SUBTICKS_PER_TICK * same,
        {
            "read_as": ", ".join(f"{q} '{_shown(name)}'" for q, (name, _) in found.items()),
            "samples": n,
            **time_facts,
            **_rate(sheet, ticks),
            "gyro_unit": gyro_unit,
            "accel_unit": accel_unit,
            "gyro_fs_dps": gyro_fs,
            "accel_fs_g": accel_fs,
        },
    )


def _pick(sheet: Sheet, said: Said) -> dict[str, tuple[str, str | None]]:
    """Quantity -> name of its column, and its unit as far as that says it."""
    found: dict[str, tuple[str, str | None]] = {}
    for quantity, name in said.columns.items():
        by_shown = {_shown(n): n for n in sheet.columns}
        if name not in by_shown:
            raise RefusedError(
                f"{sheet.where}: no column of numbers '{name}' for {quantity}", _have(sheet)
            )
        said_of = meaning(by_shown[name])
        found[quantity] = (by_shown[name], said_of.unit if said_of else None)
    for name in sheet.columns:
        one = meaning(name)
        if one is None or one.quantity in said.columns:
            continue
        if one.quantity in found:
            raise RefusedError(
                f"{sheet.where}: both '{_shown(found[one.quantity][0])}' and '{_shown(name)}' "
                f"could be {one.quantity}",
                f"say which: --column {one.quantity}=NAME",
            )
        found[one.quantity] = (name, one.unit)
    missing = [q for q in QUANTITIES if q not in found]
    if missing:
        raise RefusedError(
            f"{sheet.where}: no column of numbers for {', '.join(missing)}",
            f"{_have(sheet)}\nsay which: --column {missing[0]}=NAME",
        )
    return found


def _shown(name: str) -> str:
    """Of an (n, 3) array's column: ``gyro[x]``."""
    array, _, axis = name.partition("\n")
    return f"{array}[{axis}]" if axis else array


def _have(sheet: Sheet) -> str:
    names = [_shown(name)[:40] for name in sheet.columns][:12]
    texts = [str(name)[:40] for name in sheet.attributes.get("texts", ())][:6]
    return (
        f"columns of numbers: {', '.join(names) or 'none'}"
        + (f"; of anything else: {', '.join(texts)}" if texts else "")
    ).replace("\n", " ")


def _si(
    sheet: Sheet, found: Mapping[str, tuple[str, str | None]], quantity: str, said: str | None
) -> tuple[Float, str]:
    """(n, 3) in SI units, and the unit that they were in."""
    units = {found[f"{quantity}_{axis}"][1] for axis in "xyz"}
    default = {"gyro": "radps", "accel": "mps2"}[quantity] if sheet.is_broad else None
    unit = _unit(sheet, quantity, units, said, default)
    values = [np.asarray(sheet.columns[found[f"{quantity}_{a}"][0]], np.float64) for a in "xyz"]
    return np.stack(values, axis=1) * UNITS[quantity][unit], unit


def _unit(
    sheet: Sheet, quantity: str, named: set[str | None], said: str | None, default: str | None
) -> str:
    known = UNITS[quantity]
    option = {"t": "--time-unit"}.get(quantity, f"--{quantity}-unit")
    choices = f"{option} {', '.join(known)}"
    if said is not None and said not in known:
        raise RefusedError(f"{sheet.where}: {said!r} is no unit of {quantity}", choices)
    if len(named) > 1:
        raise RefusedError(f"{sheet.where}: the axes of {quantity} are in different units")
    name = next(iter(named), None)
    if name is not None and name not in known:
        raise RefusedError(f"{sheet.where}: '{name[:20]}' is no unit of {quantity}", choices)
    if said and name and said != name:
        raise RefusedError(
            f"{sheet.where}: the column of {quantity} says {name}, {option} says {said}",
            f"leave {option} out, or rename the column",
        )
    unit = said or name or default
    if unit is None:
        raise RefusedError(
            f"{sheet.where}: nothing says in which unit {quantity} is", f"say it: {choices}"
        )
    return unit


def _times(
    sheet: Sheet, found: Mapping[str, tuple[str, str | None]], said: Said, n: int
) -> tuple[Int, dict[str, Any]]:
    if "t" not in found:
        rate = said.rate_hz or sheet.attributes.get("sampling_rate")
        if rate is None:
            raise RefusedError(
                f"{sheet.where}: neither times nor a rate",
                "say it: --rate HZ, or --column t=NAME",
            )
        _check_rate(sheet, float(rate))
        ticks = np.rint(np.arange(n) * (TICK_RATE_HZ / float(rate))).astype(np.int64)
        return ticks, {"times": f"sample k at k / {float(rate):.9g} Hz"}
    if said.rate_hz is not None:
        raise RefusedError(
            f"{sheet.where}: has times, '{_shown(found['t'][0])}', and --rate is said too",
            "leave --rate out",
        )
    name, named = found["t"]
    unit = _unit(sheet, "t", {named}, said.time_unit, None)
    raw = np.asarray(sheet.columns[name])
    # Whole nanoseconds since 1970 do not fit a float64: the origin goes first.
    origin = raw[:1] if abs(float(raw[0]) * TIME_UNITS[unit]) > ORIGIN_MAX_S or raw[0] < 0 else 0
    if raw.dtype.kind == "u":
        raw = raw.astype(np.int64) if int(raw.max()) < 1 << 63 else raw.astype(np.float64)
    since = (raw - np.asarray(origin, raw.dtype)).astype(np.float64) * TIME_UNITS[unit]
    ticks = _ticks(sheet, since)
    _increasing(sheet, ticks)
    facts = {"times": f"'{_shown(name)}' in {unit}"}
    if np.ndim(origin):
        facts["times"] += f", counted from its first, {np.asarray(origin)[0]!r}"
    return ticks, facts


def _full_scale(sheet: Sheet, quantity: str, values: Float, unit: str) -> int:
    """The smallest full scale that holds all values below where they would count as clipped."""
    lsb, choices = FULL_SCALES[quantity]
    rows = np.abs(values).max(axis=1)
    for full_scale in choices:
        if float(rows.max()) < (CLIPPED_LSB - 1) * lsb * full_scale:
            return full_scale
    row = int(np.argmax(rows))
    raise RefusedError(
        f"{sheet.where}, {sheet.place(row)}: {quantity} is {rows[row]:.4g} in SI units, read as "
        f"{unit}: beyond any full scale",
        f"say the unit: --{quantity}-unit "
        + ", ".join(GYRO_UNITS if quantity == "gyro" else ACCEL_UNITS),
    )


# Both ------------------------------------------------------------------------------------------


def _length(sheet: Sheet, names: list[str]) -> int:
    lengths = {name: len(sheet.columns[name]) for name in names}
    first = next(iter(lengths))
    for name, length in lengths.items():
        if length != lengths[first]:
            raise RefusedError(
                f"{sheet.where}: '{_shown(name)}' has {length} rows, '{_shown(first)}' "
                f"{lengths[first]}",
                "give all columns the same length",
            )
    if lengths[first] < ROWS_MIN:
        raise RefusedError(f"{sheet.where}: {lengths[first]} rows: there is nothing to import")
    return lengths[first]


def _finite(sheet: Sheet, name: str) -> None:
    values = np.asarray(sheet.columns[name], np.float64)
    bad = ~np.isfinite(values)
    if bad.any():
        row = int(np.argmax(bad))
        raise RefusedError(
            f"{sheet.where}, {sheet.place(row)}: '{_shown(name)}' is {values[row]}",
            "leave rows without a value out: a gap in time is a gap",
        )


def _ticks(sheet: Sheet, t_s: Float) -> Int:
    far = ~((t_s >= 0.0) & (t_s <= ORIGIN_MAX_S))
    if far.any():
        row = int(np.argmax(far))
        raise RefusedError(
            f"{sheet.where}, {sheet.place(row)}: a time of {t_s[row]:g} s from the first",
            "say the unit: --time-unit s, ms, us or ns",
        )
    return np.rint(t_s * TICK_RATE_HZ).astype(np.int64)


def _increasing(sheet: Sheet, ticks: Int) -> None:
    back = np.flatnonzero(np.diff(ticks) <= 0)
    if back.size:
        raise RefusedError(
            f"{sheet.where}, {sheet.place(int(back[0]) + 1)}: the time does not increase",
            "sort the rows by time, and give each time once",
        )


def _rate(sheet: Sheet, ticks: Int) -> dict[str, Any]:
    rate = TICK_RATE_HZ / float(np.median(np.diff(ticks)))
    _check_rate(sheet, rate)
    return {"rate_hz": rate}


def _check_rate(sheet: Sheet, rate: float) -> None:
    if not RATES_HZ[0] <= rate <= RATES_HZ[1]:
        raise RefusedError(
            f"{sheet.where}: {rate:.4g} samples a second are none of an IMU's",
            "say the unit: --time-unit s, ms, us or ns",
        )
