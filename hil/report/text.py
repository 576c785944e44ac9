# SPDX-License-Identifier: Apache-2.0
"""Numbers as a person reads them: one unit for a value and its limits, no more digits than help.

Non-finite numbers arrive as the strings that ``report.json`` holds: ``"nan"``, ``"inf"``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

Number = float | int | str | None

_PREFIXED_UNITS = ("s", "m", "Hz", "V", "A")
_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_DIGITS = 4


@dataclass(frozen=True)
class Scale:
    """How to show numbers of one unit: divide by ``factor`` and write ``unit``."""

    factor: float
    unit: str


def scale(unit: str, values: Iterable[Number]) -> Scale:
    """The scale in which the largest of ``values`` (in ``unit``) reads as 1 to 999."""
    finite = [abs(float(v)) for v in values if v is not None and math.isfinite(float(v))]
    largest = max(finite, default=0.0)
    if largest == 0.0:
        return Scale(1.0, "" if unit == "1" else unit)
    if unit == "1":
        if largest >= 1e-3:
            return Scale(1.0, "")
        return Scale(1e-6, "ppm") if largest >= 1e-7 else Scale(1e-9, "ppb")
    if unit in _PREFIXED_UNITS:
        exponent = 3 * math.floor(math.log10(largest * (1 + 1e-12)) / 3)
        exponent = min(max(exponent, min(_PREFIXES)), max(_PREFIXES))
        if unit == "s":
            exponent = min(exponent, 0)
        return Scale(10.0**exponent, _PREFIXES[exponent] + unit)
    return Scale(1.0, {"us": "µs", "degC": "°C", "ohm": "Ω"}.get(unit, unit))


def number(value: Number, digits: int = _DIGITS) -> str:
    """``value`` with ``digits`` significant digits; whole numbers keep all of theirs."""
    if value is None:
        return "–"
    x = float(value)
    if math.isnan(x):
        return "not a number"
    if math.isinf(x):
        return "∞" if x > 0 else "−∞"
    if x == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(x)))
    if magnitude >= 9 or magnitude < -5:
        mantissa, exponent = f"{x:.{digits - 1}e}".split("e")
        return f"{_trim(mantissa)}e{int(exponent)}".replace("-", "−")
    decimals = max(0, digits - 1 - magnitude)
    return _trim(f"{x:,.{decimals}f}").replace(",", "\u202f").replace("-", "−")


def scalar(value: Any) -> str:
    """A plain value of a document in words: none, yes and no, a number, or what it says."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value, 6)
    return str(value)


def _trim(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


@dataclass(frozen=True)
class Quantity:
    """One measurement in words: ``value``, ``uncertainty`` and ``limits`` share ``unit``."""

    value: str
    uncertainty: str
    limits: str
    unit: str

    @property
    def measured(self) -> str:
        """Value with uncertainty and unit."""
        if not self.uncertainty:
            return _join(self.value, self.unit if self.value != "–" else "")
        if not self.unit:
            return f"{self.value} ± {self.uncertainty}"
        return f"{self.value} ± {self.uncertainty} {self.unit}"

    @property
    def allowed(self) -> str:
        """Limits with unit."""
        return _join(self.limits, self.unit if self.limits != "none" else "")


def _join(value: str, unit: str) -> str:
    return f"{value} {unit}" if unit else value


def quantity(measurement: Mapping[str, Any]) -> Quantity:
    """The words for one measurement of ``report.json``.

    The unit follows the limits, so that values of one check compare from run to run. A value
    close to a limit gets as many digits as it takes to be seen on its own side of it.
    """
    limits = measurement["limits"]
    low, high, value = limits["low"], limits["high"], measurement["value"]
    bounds = [b for b in (low, high) if b not in (None, 0, 0.0)]
    shown = scale(measurement["unit"], bounds or [value])

    def scaled(x: Number) -> float | None:
        return None if x is None else float(x) / shown.factor

    uncertainty = scaled(measurement["uncertainty"])
    return Quantity(
        value=_beside(scaled(value), [b for b in (scaled(low), scaled(high)) if b is not None]),
        uncertainty=number(uncertainty, 2) if uncertainty else "",
        limits=_limits(scaled(low), scaled(high)),
        unit=shown.unit,
    )


def _beside(value: float | None, bounds: list[float]) -> str:
    for digits in range(_DIGITS, 16):
        text = number(value, digits)
        if value is None or not math.isfinite(value):
            return text
        if all(b == value or text != number(b, digits) for b in bounds):
            return text
    return text


def _limits(low: float | None, high: float | None) -> str:
    if low is None and high is None:
        return "none"
    if low is None:
        return f"≤ {number(high, 6)}"
    if high is None:
        return f"≥ {number(low, 6)}"
    if low == high:
        return f"= {number(low, 6)}"
    return f"{number(low, 6)} … {number(high, 6)}"


def duration(seconds: float | None) -> str:
    """``seconds`` as 45.2 s, 12 min 30 s or 1 h 02 min."""
    if seconds is None:
        return "–"
    if seconds < 120:
        return f"{number(seconds, 3)} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def moment(iso: str) -> str:
    """An ISO 8601 time as 2026-11-22 08:30 UTC; whatever is none stays as it is."""
    try:
        when = datetime.fromisoformat(iso)
    except ValueError:
        return iso
    if when.tzinfo is None:
        return iso
    return f"{when.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def size(n_bytes: float) -> str:
    """``n_bytes`` as B, kB or MB (powers of ten)."""
    for unit, factor in (("MB", 1e6), ("kB", 1e3)):
        if n_bytes >= factor:
            return f"{number(n_bytes / factor, 3)} {unit}"
    return f"{number(n_bytes)} B"
