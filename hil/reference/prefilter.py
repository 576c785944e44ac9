# SPDX-License-Identifier: Apache-2.0
"""Low-pass prefilters with a known delay, so that results can be given their true time.

Both run on all six channels alike, so force and rate stay aligned with each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hil.reference.attitude import FloatArray

MAX_LENGTH = 16


@dataclass
class MovingAverage:
    """Mean of the last ``length`` samples; delay (length - 1) / 2 samples at every frequency.

    The first sample fills the whole memory, so there is no start-up transient on a constant.
    """

    length: int
    _memory: FloatArray = field(init=False)
    _next: int = field(init=False, default=0)
    _primed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        if not 1 <= self.length <= MAX_LENGTH:
            raise ValueError(f"moving average length {self.length} is not in 1..{MAX_LENGTH}")
        self._memory = np.zeros((self.length, 6))

    @property
    def delay_samples(self) -> float:
        return 0.5 * (self.length - 1)

    def __call__(self, x: FloatArray) -> FloatArray:
        if not self._primed:
            self._memory[:] = x
            self._primed = True
        self._memory[self._next] = x
        self._next = (self._next + 1) % self.length
        total = self._memory[0].copy()
        for row in self._memory[1:]:  # fixed order, so that the core can add alike
            total += row
        mean: FloatArray = total / self.length
        return mean


@dataclass
class Butterworth2:
    """Second-order Butterworth low-pass, bilinear transform with pre-warping, DF2T.

    With K = tan(pi f_c / f_s): b = K^2 / D (1, 2, 1), a1 = 2 (K^2 - 1) / D,
    a2 = (1 - sqrt(2) K + K^2) / D, D = 1 + sqrt(2) K + K^2.
    Delay at zero frequency: (b1 + 2 b2) / sum(b) - (a1 + 2 a2) / (1 + a1 + a2) samples, which
    comes to 1 / (sqrt(2) K).
    """

    cutoff_hz: float
    rate_hz: float
    b: tuple[float, float, float] = field(init=False)
    a: tuple[float, float] = field(init=False)
    _s1: FloatArray = field(init=False)
    _s2: FloatArray = field(init=False)
    _primed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.cutoff_hz < 0.5 * self.rate_hz:
            raise ValueError(
                f"cut-off {self.cutoff_hz} Hz must lie below half of the rate {self.rate_hz} Hz"
            )
        k = math.tan(math.pi * self.cutoff_hz / self.rate_hz)
        d = 1.0 + math.sqrt(2.0) * k + k * k
        self.b = (k * k / d, 2.0 * k * k / d, k * k / d)
        self.a = (2.0 * (k * k - 1.0) / d, (1.0 - math.sqrt(2.0) * k + k * k) / d)
        self._s1, self._s2 = np.zeros(6), np.zeros(6)

    @property
    def delay_samples(self) -> float:
        b0, b1, b2 = self.b
        a1, a2 = self.a
        return (b1 + 2.0 * b2) / (b0 + b1 + b2) - (a1 + 2.0 * a2) / (1.0 + a1 + a2)

    def __call__(self, x: FloatArray) -> FloatArray:
        (b0, b1, b2), (a1, a2) = self.b, self.a
        if not self._primed:  # steady state for a constant x, so that a start is no step
            self._s2 = (b2 - a2) * x
            self._s1 = (b1 - a1) * x + self._s2
            self._primed = True
        y: FloatArray = b0 * x + self._s1
        self._s1 = b1 * x - a1 * y + self._s2
        self._s2 = b2 * x - a2 * y
        return y


Prefilter = MovingAverage | Butterworth2
