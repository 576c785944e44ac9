# SPDX-License-Identifier: Apache-2.0
"""The crystal of a simulated node: true time to local time and back.

Symbols: t true time, d drift, A_k, T_k, p_k amplitude, period and phase of wander term k,
o start offset. The fractional frequency error is

    y(t) = d + sum_k A_k sin(2 pi t / T_k + p_k)

and its integral over true time gives the local clock, exactly:

    local(t) = t (1 + d) + sum_k A_k T_k / (2 pi) (cos(p_k) - cos(2 pi t / T_k + p_k)) - o
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.errors import RecordingError

MAX_FREQUENCY_ERROR: Final = 0.1
"""Bound on |d| and on sum |A_k|: keeps the clock monotone and Newton's method a contraction."""

_MAX_ITERATIONS: Final = 60


@dataclass(frozen=True)
class WanderTerm:
    """One sinusoid of frequency wander: ``amplitude`` as a fraction, not ppm."""

    amplitude: float
    period_s: float
    phase_rad: float = 0.0


@dataclass(frozen=True)
class ClockModel:
    """Local clock of one node as an analytic function of true time.

    Args:
        drift: constant fractional frequency error (1).
        start_offset_us: how far local time lags true time at true time zero.
        wander: sinusoidal terms.

    Raises:
        RecordingError: a value that is not finite, a period that is not positive, or
            |drift| or the summed amplitudes above :data:`MAX_FREQUENCY_ERROR`.
    """

    drift: float = 0.0
    start_offset_us: float = 0.0
    wander: tuple[WanderTerm, ...] = ()

    def __post_init__(self) -> None:
        numbers = [self.drift, self.start_offset_us]
        for term in self.wander:
            numbers += [term.amplitude, term.period_s, term.phase_rad]
        if not all(math.isfinite(x) for x in numbers):
            raise _bad("holds a number that is not finite")
        if any(term.period_s <= 0 for term in self.wander):
            raise _bad("has a wander period that is not positive")
        wander_max = sum(abs(term.amplitude) for term in self.wander)
        if max(abs(self.drift), wander_max) > MAX_FREQUENCY_ERROR:
            raise _bad(f"is off by more than {MAX_FREQUENCY_ERROR:.0%}")

    @classmethod
    def from_mapping(cls, node: Mapping[str, Any]) -> ClockModel:
        """From the node part of a scenario: ``drift_ppm``, ``start_offset_us``, ``wander``.

        Raises:
            RecordingError: a value of the wrong type, or as the constructor.
        """
        try:
            return cls(
                drift=_number(node.get("drift_ppm", 0.0)) * 1e-6,
                start_offset_us=_number(node.get("start_offset_us", 0)),
                wander=tuple(
                    WanderTerm(
                        amplitude=_number(term["amplitude_ppm"]) * 1e-6,
                        period_s=_number(term["period_s"]),
                        phase_rad=_number(term.get("phase_rad", 0.0)),
                    )
                    for term in node.get("wander", ())
                ),
            )
        except (AttributeError, KeyError, TypeError, OverflowError) as error:
            raise _bad(f"is not as a scenario writes it ({error!r})") from error

    def local_us(self, true_us: ArrayLike) -> NDArray[np.float64]:
        """Local time, microseconds, of true time, microseconds; any shape, same shape back."""
        t_us = np.asarray(true_us, dtype=np.float64)
        # The small part is summed first: one rounding at the size of t_us, not several.
        return t_us + self._ahead_us(t_us)

    def true_us(self, local_us: ArrayLike) -> NDArray[np.float64]:
        """Inverse of :meth:`local_us` by Newton's method, to the last bit or two of a float64.

        One step shrinks the error at least by 2 sum|A_k| / (1 + d - sum|A_k|), so a crystal
        of ppm size is done after two or three.
        """
        target_us = np.asarray(local_us, dtype=np.float64)
        t_us = np.asarray((target_us + self.start_offset_us) / (1.0 + self.drift))
        for _ in range(_MAX_ITERATIONS if self.wander else 2):
            step_us = ((t_us - target_us) + self._ahead_us(t_us)) / self._rate(t_us)
            t_us = np.asarray(t_us - step_us)
            if not np.any(np.abs(step_us) > 2.0 * np.spacing(np.abs(t_us))):
                break
        return t_us

    def _ahead_us(self, t_us: NDArray[np.float64]) -> NDArray[np.float64]:
        ahead_us = self.drift * t_us - self.start_offset_us
        for term in self.wander:
            omega = 2.0 * math.pi / (term.period_s * 1e6)
            ahead_us = ahead_us + term.amplitude / omega * (
                math.cos(term.phase_rad) - np.cos(omega * t_us + term.phase_rad)
            )
        return np.asarray(ahead_us)

    def _rate(self, t_us: NDArray[np.float64]) -> NDArray[np.float64]:
        rate = np.full_like(t_us, 1.0 + self.drift)
        for term in self.wander:
            omega = 2.0 * math.pi / (term.period_s * 1e6)
            rate = rate + term.amplitude * np.sin(omega * t_us + term.phase_rad)
        return rate


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return float(value)


def _bad(what: str) -> RecordingError:
    return RecordingError(
        f"the clock model of a simulated node {what}",
        "correct drift_ppm, start_offset_us and wander under [nodes.<role>] of the scenario",
    )
