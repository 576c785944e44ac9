# SPDX-License-Identifier: Apache-2.0
"""Traces of a bar that moves in half sines of velocity, whose figures are known by hand."""

from __future__ import annotations

import numpy as np

from hil.reps import Trace

STAND = (0.0, 1.0)
DOWN, UP = (-0.5, 1.0), (0.5, 0.8)


def strokes(*parts: tuple[float, float], rate_hz: float) -> Trace:
    """(travel_m, seconds) each: a half sine of velocity; travel 0 is a stand."""
    v = []
    for travel, seconds in parts:
        n = round(seconds * rate_hz)
        phase = np.pi * (np.arange(n) + 0.5) / n
        v.append(travel * np.pi / (2.0 * seconds) * np.sin(phase))
    velocity = np.concatenate(v)
    t = 100.0 + np.arange(velocity.size) / rate_hz
    height = np.cumsum(velocity) / rate_hz
    return Trace(t, velocity, height, np.zeros(t.size), np.zeros(t.size, bool))
