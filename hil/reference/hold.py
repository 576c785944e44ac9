# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""A bar held at one height: its mean vertical velocity is zero but for sway.

A clean or a snatch turns the bar over in the hands by 60 to 120 deg. That turns what hides at rest,
the horizontal accelerometer bias and the misalignment, upwards: 10 to 40 mm/s^2 for which there
is no measurement until the bar is back on the floor. But the bar is then held, on the shoulders or
overhead, and a height that hands keep within a centimetre for a third of a second is a mean
velocity of zero within 2 cm/s.

A span of ``hold_span_s`` is steady when the estimated vertical velocity has stayed within
``hold_range_mps``: errors grow slowly, so steadiness is right even where the velocity is wrong. A
slow eccentric is just as steady. Two things tell it from a hold: it does not follow a turnover, so
only a bar that has turned faster than ``hold_turn_radps`` since its last rest is taken to be
held; and a filter that knows its velocity does not believe in a zero, so there is a gate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil.reference.attitude import FloatArray
from hil.reference.params import Params
from hil.reference.state import V_


@dataclass
class Hold:
    """The present span of steady vertical velocity."""

    count: int = 0
    t_first_s: float = 0.0
    least_mps: float = 0.0
    most_mps: float = 0.0
    sum_mps: float = 0.0

    def clear(self) -> None:
        self.count = 0

    def steady(self, params: Params, t_s: float, v_mps: float) -> bool:
        """Feed the centre's vertical velocity; True when the span is long enough for a hold."""
        if self.count > 0:
            self.least_mps = min(self.least_mps, v_mps)
            self.most_mps = max(self.most_mps, v_mps)
        if self.count == 0 or self.most_mps - self.least_mps > params.hold_range_mps:
            self.count = 0
            self.t_first_s = t_s
            self.least_mps = self.most_mps = v_mps
            self.sum_mps = 0.0
        self.count += 1
        self.sum_mps += v_mps
        # Half a sample of room: where the rate divides the span, rounding must not decide.
        return t_s - self.t_first_s >= params.hold_span_s - 0.5 * params.dt_s


def measurement(params: Params, hold: Hold) -> tuple[FloatArray, FloatArray, FloatArray]:
    """0 = mean of v_z over the span + n: returns H, innovation, R.

    The error at the middle of the span is taken for the present one: they differ by an
    acceleration error times a sixth of a second, a few mm/s.
    """
    H = np.zeros((1, 15))
    H[0, V_.stop - 1] = 1.0
    innovation = np.array([-hold.sum_mps / hold.count])
    return H, innovation, np.array([params.hold_sigma_mps**2])
