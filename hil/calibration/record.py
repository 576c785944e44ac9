# SPDX-License-Identifier: Apache-2.0
"""A calibration on disk: JSON, one file per device and time, with what it was made from.

Reading is strict: a file is hostile until each key has its type and each number its range.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.atomic import write_whole
from hil.calibration.poses import Face, Pose
from hil.calibration.solve import GRAVITY_LIMITS_MPS2, Calibration, Method, check
from hil.errors import HilError
from hil.wire.messages import ROLES

SCHEMA_VERSION: Final = 1
MAX_FILE_BYTES: Final = 1 << 20
MAX_POSES: Final = 1000
FOLDER: Final = Path("calibrations")

_HEX64: Final = re.compile(r"[0-9a-f]{16}")
_UTC: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_MEND: Final = "calibrate again, or take an earlier record of this device"


@dataclass(frozen=True, eq=False)
class Record:
    """One calibration of one device.

    Attributes:
        device_id: FICR DEVICEID, 16 hexadecimal digits as in reports.
        role: ``leader`` or ``follower``.
        created_utc: ``2026-01-31T12:00:00Z``.
        temperature_degc: of the die; not a number when unknown, ``null`` in the file.
        firmware_build_id: of the image that sent the samples, 16 hexadecimal digits.
        poses: raw means, in the order of ``calibration.residuals_mg``.
        gyro_samples: length of the rest.
        calibration: the result.
    """

    device_id: str
    role: str
    created_utc: str
    temperature_degc: float
    firmware_build_id: str
    poses: tuple[Pose, ...]
    gyro_samples: int
    calibration: Calibration

    @property
    def path(self) -> Path:
        """Where it belongs, below the working folder."""
        stamp = self.created_utc.replace("-", "").replace(":", "")
        return FOLDER / f"{self.device_id}-{stamp}.json"

    @property
    def created_unix_s(self) -> int:
        """``created_utc`` in seconds since 1970."""
        return int(datetime.fromisoformat(self.created_utc).timestamp())

    def save(self, path: Path) -> None:
        """Write it whole or not at all.

        Raises:
            HilError: the record would not be readable again, or the disk says no.
        """
        text = json.dumps(_as_json(self), indent=2, allow_nan=False) + "\n"
        _parse(text, str(path))
        try:
            write_whole(path, text.encode("utf-8"))
        except OSError as error:
            raise HilError(
                f"{path} could not be written: {error.strerror or error}",
                "give a folder that you may write to, with room on its disk",
            ) from error


def load(path: Path) -> Record:
    """Read a record.

    Raises:
        HilError: no such file, or one that is no sound record; the message names file and key.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise HilError(
            f"{path} could not be read: {error.strerror or error}",
            f"records are in {FOLDER}/, named <device id>-<UTC>.json",
        ) from error
    if len(data) > MAX_FILE_BYTES:
        raise HilError(f"{path} is larger than {MAX_FILE_BYTES} bytes: no record is", _MEND)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise HilError(f"{path} is not UTF-8 at byte {error.start}", _MEND) from error
    return _parse(text, str(path))


def check_device(record: Record, device_id: str) -> None:
    """Refuse a calibration of another device.

    Raises:
        HilError: ``device_id`` is not the record's.
    """
    if record.device_id != device_id.lower().removeprefix("0x").zfill(16):
        raise HilError(
            f"this calibration is of device {record.device_id}, the one here is {device_id}",
            f"calibrate this device, or take a record {FOLDER}/{device_id}-*.json",
        )


def _as_json(record: Record) -> dict[str, Any]:
    c = record.calibration
    return {
        "schema_version": SCHEMA_VERSION,
        "device_id": record.device_id,
        "role": record.role,
        "created_utc": record.created_utc,
        "temperature_degc": _or_null(record.temperature_degc),
        "firmware_build_id": record.firmware_build_id,
        "poses": [
            {
                "face": pose.face,
                "mean_mps2": list(pose.mean_mps2),
                "std_mps2": list(pose.std_mps2),
                "gyro_mean_radps": list(pose.gyro_mean_radps),
                "n": pose.n,
                "temperature_degc": _or_null(pose.temperature_degc),
            }
            for pose in record.poses
        ],
        "residuals_mg": c.residuals_mg.tolist(),
        "gyro_samples": record.gyro_samples,
        "calibration": {
            "method": c.method,
            "gravity_mps2": c.gravity_mps2,
            "accel_bias_mps2": c.accel_bias_mps2.tolist(),
            "accel_bias_sigma_mps2": c.accel_bias_sigma_mps2.tolist(),
            "accel_matrix": c.accel_matrix.tolist(),
            "accel_matrix_sigma": c.accel_matrix_sigma.tolist(),
            "gyro_bias_radps": c.gyro_bias_radps.tolist(),
            "gyro_bias_sigma_radps": c.gyro_bias_sigma_radps.tolist(),
        },
    }


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _no_double(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"key '{next(n for n in names if names.count(n) > 1)}' stands twice")
    return found


def _parse(text: str, where: str) -> Record:
    try:
        tree = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_no_double)
    except json.JSONDecodeError as error:
        raise HilError(f"{where}, line {error.lineno}: no JSON: {error.msg}", _MEND) from error
    except (ValueError, RecursionError) as error:
        raise HilError(f"{where}: {error}", _MEND) from error
    top = _Object(where, "", tree)
    version = top.integer("schema_version", 0, 1 << 31)
    if version != SCHEMA_VERSION:
        raise HilError(
            f"{where}: schema_version is {version}, this hil reads {SCHEMA_VERSION}",
            "use the hil that wrote it, or calibrate again",
        )
    pose_trees = top.array("poses", 0, MAX_POSES)
    poses = tuple(_pose(_Object(where, f"poses[{i}].", pose)) for i, pose in enumerate(pose_trees))
    residuals_mg = top.numbers("residuals_mg", (len(poses),), 1e4)
    record = Record(
        top.pattern("device_id", _HEX64),
        top.one_of("role", ROLES),
        top.pattern("created_utc", _UTC),
        top.temperature("temperature_degc"),
        top.pattern("firmware_build_id", _HEX64),
        poses,
        top.integer("gyro_samples", 0, 1 << 40),
        _calibration(_Object(where, "calibration.", top.take("calibration")), residuals_mg),
    )
    top.done()
    try:
        datetime.fromisoformat(record.created_utc)
    except ValueError as error:
        raise top.wrong("created_utc", f"no date: {error}") from error
    return record


def _pose(tree: _Object) -> Pose:
    face = tree.take("face")
    if face is not None and face not in list(Face):
        raise tree.wrong("face", f"give null or one of {', '.join(Face)}")
    pose = Pose(
        _triple(tree.numbers("mean_mps2", (3,), 400.0)),
        _triple(tree.numbers("std_mps2", (3,), 400.0, low=0.0)),
        _triple(tree.numbers("gyro_mean_radps", (3,), 100.0)),
        tree.integer("n", 1, 1 << 40),
        None if face is None else Face(face),
        tree.temperature("temperature_degc"),
    )
    tree.done()
    return pose


def _calibration(tree: _Object, residuals_mg: np.ndarray[Any, np.dtype[np.float64]]) -> Calibration:
    low, high = GRAVITY_LIMITS_MPS2
    calibration = Calibration(
        accel_bias_mps2=tree.numbers("accel_bias_mps2", (3,), 400.0),
        accel_matrix=tree.numbers("accel_matrix", (3, 3), 10.0),
        gyro_bias_radps=tree.numbers("gyro_bias_radps", (3,), 100.0),
        accel_bias_sigma_mps2=tree.numbers("accel_bias_sigma_mps2", (3,), 400.0, low=0.0),
        accel_matrix_sigma=tree.numbers("accel_matrix_sigma", (3, 3), 10.0, low=0.0),
        gyro_bias_sigma_radps=tree.numbers("gyro_bias_sigma_radps", (3,), 100.0, low=0.0),
        residuals_mg=residuals_mg,
        method=Method(tree.one_of("method", {str(m): 0 for m in Method})),
        gravity_mps2=float(tree.numbers("gravity_mps2", (), high, low=low)),
    )
    tree.done()
    try:
        check(calibration)
    except HilError as error:
        raise HilError(f"{tree.where}: calibration: {error.message}", error.mend) from error
    return calibration


def _triple(x: np.ndarray[Any, np.dtype[np.float64]]) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])


class _Object:
    """A JSON object whose keys are taken one by one; what is left over is refused."""

    def __init__(self, where: str, prefix: str, tree: Any) -> None:
        self.where, self.prefix = where, prefix
        if not isinstance(tree, dict):
            raise HilError(f"{where}: {prefix.rstrip('.') or 'the file'} is no object", _MEND)
        self._left: dict[str, Any] = dict(tree)

    def wrong(self, key: str, what: str) -> HilError:
        return HilError(f"{self.where}: {self.prefix}{key}: {what}", _MEND)

    def take(self, key: str) -> Any:
        if key not in self._left:
            raise self.wrong(key, "is missing")
        return self._left.pop(key)

    def done(self) -> None:
        for key in self._left:
            raise self.wrong(key[:80], "is no key of a record")

    def pattern(self, key: str, pattern: re.Pattern[str]) -> str:
        value = self.take(key)
        if not isinstance(value, str) or not pattern.fullmatch(value):
            raise self.wrong(key, f"{_short(value)} is not of the form {pattern.pattern}")
        return value

    def one_of(self, key: str, allowed: Mapping[str, int]) -> str:
        value = self.take(key)
        if not isinstance(value, str) or value not in allowed:
            raise self.wrong(key, f"{_short(value)} is none of {', '.join(allowed)}")
        return value

    def integer(self, key: str, low: int, high: int) -> int:
        value = self.take(key)
        if type(value) is not int or not low <= value <= high:
            raise self.wrong(key, f"{_short(value)} is no integer from {low} to {high}")
        return value

    def array(self, key: str, low: int, high: int) -> list[Any]:
        value = self.take(key)
        if not isinstance(value, list) or not low <= len(value) <= high:
            raise self.wrong(key, f"is no list of {low} to {high}")
        return value

    def temperature(self, key: str) -> float:
        """-40 to 85 deg C is the sensor's range; ``null`` is unknown."""
        if self._left.get(key, 0) is None:
            self.take(key)
            return math.nan
        return float(self.numbers(key, (), 125.0, low=-60.0))

    def numbers(
        self, key: str, shape: tuple[int, ...], high: float, low: float | None = None
    ) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Finite numbers of this shape from ``low`` (by default ``-high``) to ``high``."""
        value = self.take(key)
        low = -high if low is None else low
        flat = list(_flat(value, shape))
        for number in flat:
            # bool is an int in Python, and a huge int does not fit a float.
            if type(number) not in (int, float) or not low <= number <= high:
                raise self.wrong(key, f"{_short(number)} is no number from {low:g} to {high:g}")
        if len(flat) != math.prod(shape):
            raise self.wrong(key, f"give numbers of shape {shape}")
        return np.array(flat, dtype=np.float64).reshape(shape)


def _flat(value: Any, shape: tuple[int, ...]) -> list[Any]:
    """Elements in order, each list of its right length; empty where one is not."""
    if not shape:
        return [value]
    if not isinstance(value, list) or len(value) != shape[0]:
        return []
    parts = [_flat(element, shape[1:]) for element in value]
    wanted = math.prod(shape[1:])
    return [x for part in parts for x in part] if all(len(p) == wanted for p in parts) else []


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def record_of(
    calibration: Calibration,
    poses: tuple[Pose, ...],
    *,
    device_id: int,
    role: str,
    firmware_build_id: int,
    created: datetime,
    gyro_samples: int,
) -> Record:
    """A record of numbers as the wire has them; the temperature is the mean over the poses."""
    known = [p.temperature_degc for p in poses if math.isfinite(p.temperature_degc)]
    return Record(
        f"{device_id:016x}",
        role,
        created.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        sum(known) / len(known) if known else math.nan,
        f"{firmware_build_id:016x}",
        poses,
        gyro_samples,
        calibration,
    )
