# SPDX-License-Identifier: Apache-2.0
"""What a column's name says: quantity, axis and unit. Nothing is guessed from sizes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

STANDARD_GRAVITY_MPS2: Final = 9.80665
TIME_UNITS: Final[Mapping[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
GYRO_UNITS: Final[Mapping[str, float]] = {"radps": 1.0, "dps": math.pi / 180.0}
ACCEL_UNITS: Final[Mapping[str, float]] = {
    "mps2": 1.0,
    "g": STANDARD_GRAVITY_MPS2,
    "mg": STANDARD_GRAVITY_MPS2 * 1e-3,
}
UNITS: Final = {"t": TIME_UNITS, "gyro": GYRO_UNITS, "accel": ACCEL_UNITS}
"""Quantity -> unit -> SI units in one of it."""

_WORDS: Final = {
    "t": ("t", "time", "timestamp", "t leader", "t node"),
    "gyro": (
        *("gyro", "gyr", "gyroscope", "imu gyr", "imu gyro", "g"),
        *("angular velocity", "angular rate", "omega", "w"),
    ),
    "accel": (
        *("accel", "acc", "accelerometer", "acceleration", "imu acc", "imu accel", "a"),
        *("linear acceleration", "specific force"),
    ),
}
_SPELT: Final = {
    **dict.fromkeys(("s", "sec", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec"), "ms"),
    **dict.fromkeys(("us", "µs", "μs", "usec"), "us"),
    **dict.fromkeys(("ns", "nsec"), "ns"),
    **dict.fromkeys(("radps", "rad/s", "rad s", "rads"), "radps"),
    **dict.fromkeys(("dps", "deg/s", "deg s", "degps", "°/s"), "dps"),
    **dict.fromkeys(("mps2", "m/s2", "m/s^2", "m/s²", "m s2", "ms2"), "mps2"),
    "g": "g",
    "mg": "mg",
}
NAME_MAX: Final = 200


@dataclass(frozen=True)
class Meaning:
    """What a name says: ``quantity`` ``t``, ``gyro_x`` … ``accel_z``; ``unit`` None: not said."""

    quantity: str
    unit: str | None


def meaning(name: str) -> Meaning | None:
    """What ``name`` says, or None when it is none of the quantities.

    The axis of a column of an (n, 3) array stands behind a line feed.
    """
    text, _, axis = name[:NAME_MAX].lower().partition("\n")
    text = " ".join(re.split(r"[\s_.\-]+", text.strip()))
    unit = None
    match = re.fullmatch(r"([^(\[]*?) ?[(\[]([^()\[\]]*)[)\]] ?([xyz]?)", text)
    if match:
        text, unit = match[1], match[2].strip() or None
        axis = axis or match[3]
        if unit is not None:
            unit = _SPELT.get(unit, unit)
    else:
        words = text.split(" ")
        for count in (2, 1):
            tail = " ".join(words[-count:])
            if len(words) > count and tail in _SPELT:
                text, unit = " ".join(words[:-count]), _SPELT[tail]
                break
    return _known(text, axis, unit)


def _known(text: str, axis: str, unit: str | None) -> Meaning | None:
    if not axis and text in _WORDS["t"]:
        return Meaning("t", unit)
    if not axis and len(text) > 1 and text[-1] in "xyz":
        text, axis = text[:-1].rstrip(), text[-1]
    for quantity in ("gyro", "accel"):
        if axis and text in _WORDS[quantity]:
            return Meaning(f"{quantity}_{axis}", unit)
    return None
