# SPDX-License-Identifier: Apache-2.0
"""Raw counts -> millimetres: a straight line by least squares through known lengths.

How far the converter is from straight is looked for between neighbouring points: the slope there
against the slope of all is the error that a velocity would have there.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.atomic import write_whole
from hil.stringpot.samples import RAW_MAX, Samples, StringPotError

FORMAT: Final = 1
BYTES_MAX: Final = 1 << 16
POINTS_MAX: Final = 100
RAW_SPREAD_MIN: Final = 20.0
"""Counts between the extreme points, below which a line through them means nothing."""
SLOPE_ERROR_MAX: Final = 0.01
"""Share of velocity: the estimate is asked to be right to a few per cent."""
STILL_COUNTS: Final = 3.0
STILL_SHARE: Final = 0.002


@dataclass(frozen=True)
class Point:
    """A known length and what the converter said there: mean, its standard error, samples."""

    length_mm: float
    raw: float
    sigma_raw: float = 0.0
    samples: int = 1


@dataclass(frozen=True)
class Calibration:
    """length_mm = offset_mm + mm_per_count * raw.

    Attributes:
        points: what it was fitted to, by raw.
        created_utc: ISO 8601.
    """

    mm_per_count: float
    offset_mm: float
    points: tuple[Point, ...]
    created_utc: str = ""

    def mm(self, raw: ArrayLike) -> NDArray[np.float64]:
        """Lengths of raw counts."""
        return self.offset_mm + self.mm_per_count * np.asarray(raw, np.float64)

    @property
    def residuals_mm(self) -> NDArray[np.float64]:
        """float64[points], length less the line's."""
        length = np.array([p.length_mm for p in self.points])
        return length - self.mm([p.raw for p in self.points])

    @property
    def raw_range(self) -> tuple[float, float]:
        """Between the extreme points; outside nothing is known."""
        return self.points[0].raw, self.points[-1].raw


def fit(points: Sequence[Point]) -> Calibration:
    """The line through two or more points.

    Raises:
        StringPotError: too few, or too close together.
    """
    if not 2 <= len(points) <= POINTS_MAX:
        raise StringPotError(
            f"{len(points)} points: a calibration needs 2 to {POINTS_MAX}",
            "give known lengths over the whole travel: --lengths 0,250,500,750,1000",
        )
    raw = np.array([p.raw for p in points])
    length = np.array([p.length_mm for p in points])
    if not (np.all(np.isfinite(raw)) and np.all(np.isfinite(length))):
        raise StringPotError("a point of the calibration is not a number", "give numbers")
    if np.ptp(raw) < RAW_SPREAD_MIN or np.ptp(length) <= 0.0:
        raise StringPotError(
            f"the points span {np.ptp(raw):.0f} counts and {np.ptp(length):g} mm: the string does "
            "not move the potentiometer, or the lengths are all the same",
            "look at the wiper's wire and the ADC's pin; pull the string between the points",
        )
    slope, offset = np.polyfit(raw, length, 1)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    ordered = tuple(sorted(points, key=lambda p: p.raw))
    return Calibration(float(slope), float(offset), ordered, now)


def warnings(found: Calibration) -> list[str]:
    """What to know of a calibration, a sentence each; empty when it is good."""
    if len(found.points) < 3:
        return ["two points always lie on a line: give five or more to see whether the ADC is one"]
    said = []
    for a, b in zip(found.points, found.points[1:], strict=False):
        run = b.raw - a.raw
        if run < RAW_SPREAD_MIN:
            continue
        local = (b.length_mm - a.length_mm) / run
        error = local / found.mm_per_count - 1.0
        noise = math.hypot(a.sigma_raw, b.sigma_raw) / run
        if abs(error) > SLOPE_ERROR_MAX + 3.0 * noise:
            said.append(
                f"the ADC is not linear: from {a.length_mm:g} to {b.length_mm:g} mm the velocity "
                f"is off by {-100.0 * error / (1.0 + error):+.1f} %; use an outer, linear ADC, or "
                "the part of the travel where it is straight"
            )
    return said


def point(length_mm: float, samples: Samples) -> Point:
    """The mean of samples taken at a known length.

    Raises:
        StringPotError: too few, or the string moved.
    """
    raw = samples.raw.astype(np.float64)
    if len(raw) < 100:
        raise StringPotError(
            f"only {len(raw)} samples came at {length_mm:g} mm",
            "look at the port, the baud rate and the ESP32's power",
        )
    tenths = np.array([part.mean() for part in np.array_split(raw, 10)])
    moved = float(np.ptp(tenths))
    if moved > STILL_COUNTS + STILL_SHARE * float(raw.mean()):
        raise StringPotError(
            f"the string moved by {moved:.0f} counts while it was measured at {length_mm:g} mm",
            "clamp it, or hold it against a stop",
        )
    # Tenths of a second are independent where single samples share mains hum.
    sigma = float(tenths.std(ddof=1) / math.sqrt(len(tenths)))
    return Point(length_mm, float(raw.mean()), sigma, len(raw))


def save(found: Calibration, path: Path) -> None:
    """Write a calibration as TOML, whole or not at all.

    Raises:
        StringPotError: the disk says no.
    """
    lines = [
        "# String potentiometer: length_mm = offset_mm + mm_per_count * raw",
        f"format = {FORMAT}",
        f'created_utc = "{found.created_utc}"',
        f"mm_per_count = {found.mm_per_count!r}",
        f"offset_mm = {found.offset_mm!r}",
        f"rms_residual_mm = {float(np.sqrt(np.mean(found.residuals_mm**2)))!r}",
    ]
    for p in found.points:
        lines += [
            "",
            "[[points]]",
            f"length_mm = {float(p.length_mm)!r}",
            f"raw = {float(p.raw)!r}",
            f"sigma_raw = {float(p.sigma_raw)!r}",
            f"samples = {p.samples}",
        ]
    try:
        write_whole(path, ("\n".join(lines) + "\n").encode("ascii"))
    except OSError as error:
        raise StringPotError(
            f"{path}: cannot be written: {error.strerror}", "name another file: -o FILE"
        ) from error


def load(path: Path) -> Calibration:
    """Read a calibration.

    Raises:
        StringPotError: it is missing or wrong; the message names file and key.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(BYTES_MAX + 1)
        if len(content) > BYTES_MAX:
            raise StringPotError(f"{path}: larger than {BYTES_MAX >> 10} KiB", _MEND)
        data = tomllib.loads(content.decode("utf-8"))
    except OSError as error:
        raise StringPotError(f"{path}: {error.strerror}", _MEND) from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise StringPotError(f"{path}: not a TOML file: {error}", _MEND) from error
    if data.get("format") != FORMAT:
        raise StringPotError(f"{path}: format: {FORMAT} is known, not this", _MEND)
    rows = data.get("points")
    if not isinstance(rows, list) or not 2 <= len(rows) <= POINTS_MAX:
        raise StringPotError(f"{path}: points: 2 to {POINTS_MAX} are needed", _MEND)
    points = []
    for k, row in enumerate(rows, 1):
        if not isinstance(row, dict):
            raise StringPotError(f"{path}: points, number {k}: not a table", _MEND)
        length_mm, raw, sigma_raw, samples = (
            _number(path, row, key) for key in ("length_mm", "raw", "sigma_raw", "samples")
        )
        points.append(Point(length_mm, raw, sigma_raw, int(samples)))
    slope, offset = _number(path, data, "mm_per_count"), _number(path, data, "offset_mm")
    if slope == 0.0:
        raise StringPotError(f"{path}: mm_per_count: is zero", _MEND)
    ordered = tuple(sorted(points, key=lambda p: p.raw))
    return Calibration(slope, offset, ordered, str(data.get("created_utc", ""))[:40])


_MEND: Final = "make one: hil stringpot calibrate --port /dev/ttyUSB0 --lengths 0,500,1000"


def _number(path: Path, data: dict[str, Any], key: str) -> float:
    value = data.get(key)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if (
        not number
        or not math.isfinite(float(value or 0.0))
        or abs(float(value or 0.0)) > (RAW_MAX * 1e3)
    ):
        raise StringPotError(f"{path}: {key}: missing, or not a number that makes sense", _MEND)
    return float(value or 0.0)
