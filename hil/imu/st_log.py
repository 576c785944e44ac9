# SPDX-License-Identifier: Apache-2.0
"""Logs of real LSM6DSOX chips as ST's tools write them: tab-separated columns with a header.

The header names quantity, axis and unit of each column (``A_X [LSB]``, ``G_Z [dps]``). Some logs
hold counts and, beside them, ST's own conversion; others the conversion alone, without time.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import RigError
from hil.motion.imu_model import ACCEL_LSB_G, GYRO_LSB_DPS

Float = NDArray[np.float64]
Counts = NDArray[np.int16]

RAIL_LSB: Final = 32_700
"""From here on a count may stand for anything beyond.

The chip's trim moves the ends of its range: in ST's log of a serve one axis stays at 32,742 for
as long as it clips, and never reaches 32,767.
"""
_HEADING: Final = re.compile(r"(\w+)\s*\[(\w+)\]")


@dataclass(frozen=True, eq=False)
class StLog:
    """One log of n samples; a quantity that it does not hold is None.

    Attributes:
        t_us: float64[n], logger's clock.
        accel_lsb, gyro_lsb: int16[n, 3], counts.
        accel_mg, gyro_dps: float64[n, 3], as printed in the log: ST's conversion.
        temperature_lsb: float64[n]; temperature_degc: float64[n], as printed.
    """

    t_us: Float | None
    accel_lsb: Counts | None
    gyro_lsb: Counts | None
    accel_mg: Float | None
    gyro_dps: Float | None
    temperature_lsb: Float | None
    temperature_degc: Float | None

    @property
    def rate_hz(self) -> float:
        """True sample rate by the logger's clock: slope of a line; NaN without a time column."""
        if self.t_us is None or self.t_us.size < 2:
            return float("nan")
        return float(1e6 / np.polyfit(np.arange(self.t_us.size), self.t_us, 1)[0])

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """bool[n]: samples with a count at an end of the chip's range; empty without counts."""
        if self.accel_lsb is None or self.gyro_lsb is None:
            return np.zeros(0, dtype=bool)
        both = np.concatenate([self.accel_lsb, self.gyro_lsb], axis=1).astype(np.int64)
        return np.asarray(np.any(np.abs(both) >= RAIL_LSB, axis=1), dtype=bool)


def accel_mg(counts: Counts, full_scale_g: int) -> Float:
    """Counts of any shape in mg, by our own scale factors."""
    return counts.astype(np.float64) * (ACCEL_LSB_G[full_scale_g] * 1e3)


def gyro_dps(counts: Counts, full_scale_dps: int) -> Float:
    """Counts of any shape in degrees per second, by our own scale factors."""
    return counts.astype(np.float64) * GYRO_LSB_DPS[full_scale_dps]


def temperature_degc(counts: Float) -> Float:
    """256 counts per degree from 25 degC (LSM6DSOX datasheet DS12814, table 4)."""
    return 25.0 + counts / 256.0


def load(path: Path) -> StLog:
    """Read a log.

    Raises:
        RigError: it cannot be read, has no header, or a row that does not fit it.
    """
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RigError(f"{path}: cannot be read: {error}", "name one of ST's text logs") from error
    rows = [line for line in lines if line.strip()]
    headings = _HEADING.findall(rows[0]) if rows else []
    if not headings:
        raise RigError(f"{path}: the first line names no columns", "name one of ST's text logs")
    try:
        table = np.array([row.split() for row in rows[1:]], dtype=np.float64)
    except ValueError as error:
        raise RigError(f"{path}: a row is not as long as the others: {error}") from error
    if table.ndim != 2 or table.shape[1] != len(headings):
        raise RigError(f"{path}: rows do not have the {len(headings)} columns of the header")
    columns = {heading: table[:, i] for i, heading in enumerate(headings)}
    accel_lsb, gyro_lsb = (_axes(columns, sensor, "LSB") for sensor in "AG")
    return StLog(
        t_us=columns.get(("Timestamp", "us")),
        accel_lsb=None if accel_lsb is None else accel_lsb.astype(np.int16),
        gyro_lsb=None if gyro_lsb is None else gyro_lsb.astype(np.int16),
        accel_mg=_axes(columns, "A", "mg"),
        gyro_dps=_axes(columns, "G", "dps"),
        temperature_lsb=columns.get(("T", "LSB")),
        temperature_degc=columns.get(("T", "degC")),
    )


def _axes(columns: Mapping[tuple[str, str], Float], sensor: str, unit: str) -> Float | None:
    found = [columns.get((f"{sensor}_{axis}", unit)) for axis in "XYZ"]
    present = [column for column in found if column is not None]
    return np.stack(present, axis=1) if len(present) == 3 else None
