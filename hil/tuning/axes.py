# SPDX-License-Identifier: Apache-2.0
"""Which parameters are searched, and between which values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from hil.reference.params import Params
from hil.tuning.parameters import PARAMETERS, ParameterError, known

NOISE: Final = (
    *("accel_noise_mps2_rthz", "gyro_noise_radps_rthz"),
    *("accel_walk_mps2_rts", "gyro_walk_radps_rts"),
    *("accel_scale_sigma", "gyro_scale_sigma"),
    *("rigid_accel_sigma_mps2", "rigid_gyro_sigma_radps"),
    *("zupt_variance", "height_sigma_m"),
)
"""What is searched unless something else is asked for: all noise of the model and of its updates.

No gate, no detector's threshold: without truth a detector that fires in motion looks excellent.
"""
REACH: Final = 10.0
"""Factor up and down from the image's value."""
DIGITS: Final = 4


@dataclass(frozen=True)
class Axis:
    """A parameter between two values; ``log``: equal steps are equal factors."""

    name: str
    low: float
    high: float
    log: bool
    whole: bool = False

    def at(self, share: float) -> float:
        """The value at a share of the way from ``low`` to ``high``, in four digits."""
        x = min(max(share, 0.0), 1.0)
        if self.log:
            value = self.low * (self.high / self.low) ** x
        else:
            value = self.low + x * (self.high - self.low)
        # Digits that a person can copy; the same on every machine.
        value = min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value

    def share(self, value: float) -> float:
        """Where a value lies; outside, the nearer end."""
        inside = min(max(value, self.low), self.high)
        if self.log:
            return math.log(inside / self.low) / math.log(self.high / self.low)
        return (inside - self.low) / (self.high - self.low)


def around(params: Params) -> list[Axis]:
    """:data:`NOISE`, each ten times up and down from now, as far as it may go."""
    found = []
    for name in NOISE:
        now, about = float(getattr(params, name)), PARAMETERS[name]
        low, high = max(about.low, now / REACH), min(about.high, now * REACH)
        found.append(Axis(name, low, high, log=True))
    return found


def parse(params: Params, wanted: Sequence[str]) -> list[Axis]:
    """Axes of NAME=LOW:HIGH[:log]; :func:`around` where nothing is wanted.

    Raises:
        ParameterError: no such parameter, one that is no number, a range that is none or goes
            beyond what the parameter can take, or a name given twice.
    """
    if not wanted:
        return around(params)
    found = [_axis(params, text) for text in wanted]
    names = [axis.name for axis in found]
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"{name} is given twice", "give each parameter once")
    return found


def _axis(params: Params, text: str) -> Axis:
    name, _, span = (part.strip() for part in text.partition("="))
    about = known(name)
    now = getattr(params, name)
    if isinstance(now, bool) or not isinstance(now, int | float):
        raise ParameterError(
            f"{name} is not one number: it cannot be searched", f"set it: hil replay --param {name}"
        )
    parts = span.split(":")
    mend = f"for example: --param {name}={about.low:g}:{about.high:g}"
    try:
        low, high = (float(part) for part in parts[:2])
    except ValueError:
        raise ParameterError(
            f"{text[:80]!r} is not NAME=LOW:HIGH or NAME=LOW:HIGH:log", mend
        ) from (None)
    log = parts[2:] == ["log"]
    if parts[2:] and not log:
        raise ParameterError(f"{text[:80]!r} is not NAME=LOW:HIGH or NAME=LOW:HIGH:log", mend)
    if not about.low <= low < high <= about.high:
        raise ParameterError(
            f"{name}={low:g}:{high:g} is no range within {about.low:g} to {about.high:g}", mend
        )
    if log and low <= 0.0:
        raise ParameterError(f"{name}: a logarithmic range begins above zero", mend)
    return Axis(name, low, high, log, isinstance(now, int))
