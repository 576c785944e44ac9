# SPDX-License-Identifier: Apache-2.0
"""Smooth scalar functions of time with exact first and second derivatives.

A trajectory is six of these (three coordinates, three angles). Everything is analytic, so
that truth has no integration error: velocity, acceleration and angular acceleration are
derivatives of closed forms, not differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Jet = tuple[FloatArray, FloatArray, FloatArray]
"""Value, first and second time derivative, each of the shape of ``t_s``."""


class Curve(Protocol):
    """A twice differentiable function of time; ``t_s`` has shape (n,)."""

    def __call__(self, t_s: FloatArray) -> Jet: ...


@dataclass(frozen=True)
class Key:
    """A knot: the value and its first three derivatives at ``t_s``."""

    t_s: float
    value: float
    rate: float = 0.0
    accel: float = 0.0
    jerk: float = 0.0


class Spline:
    """Piecewise septic polynomial through :class:`Key` knots: C3 everywhere inside.

    Each piece is the unique polynomial of degree seven that meets value, rate, acceleration
    and jerk at both of its ends (Hermite interpolation). Two knots on one parabola therefore
    give that parabola exactly, which is how free fall is written. Outside the knots the curve
    holds its end values, so the end knots should be at rest.

    Raises:
        ValueError: fewer than one key, or times that do not increase.
    """

    def __init__(self, keys: Sequence[Key]) -> None:
        if not keys:
            raise ValueError("a spline needs at least one key")
        t = np.array([k.t_s for k in keys], dtype=np.float64)
        if np.any(np.diff(t) <= 0):
            at = int(np.flatnonzero(np.diff(t) <= 0)[0])
            raise ValueError(f"key times must increase: {t[at]} s is followed by {t[at + 1]} s")
        self.keys = tuple(keys)
        self.t_knots_s = t
        self.coefficients = np.array([_septic(a, b) for a, b in pairwise(keys)]).reshape(-1, 8)

    def __call__(self, t_s: FloatArray) -> Jet:
        t = np.asarray(t_s, dtype=np.float64)
        if len(self.keys) == 1:
            return np.full_like(t, self.keys[0].value), np.zeros_like(t), np.zeros_like(t)
        inside = np.clip(t, self.t_knots_s[0], self.t_knots_s[-1])
        piece = np.clip(
            np.searchsorted(self.t_knots_s, inside, side="right") - 1, 0, len(self.keys) - 2
        )
        tau = inside - self.t_knots_s[piece]
        c = self.coefficients[piece]
        value = np.zeros_like(t)
        rate = np.zeros_like(t)
        accel = np.zeros_like(t)
        for power in range(7, -1, -1):  # Horner, derivatives alongside
            accel = accel * tau + 2.0 * rate
            rate = rate * tau + value
            value = value * tau + c[:, power]
        held = inside != t
        return value, np.where(held, 0.0, rate), np.where(held, 0.0, accel)


def _septic(a: Key, b: Key) -> FloatArray:
    """Coefficients, constant first, of the Hermite septic from ``a`` to ``b`` in t - a.t_s."""
    h = b.t_s - a.t_s
    # In u = (t - a.t) / h the system is the same for every piece.
    start = np.array([a.value, a.rate * h, a.accel * h**2 / 2.0, a.jerk * h**3 / 6.0])
    target = np.array([b.value, b.rate * h, b.accel * h**2, b.jerk * h**3])
    reached = np.array(
        [
            start.sum(),
            start[1] + 2 * start[2] + 3 * start[3],
            2 * start[2] + 6 * start[3],
            6 * start[3],
        ]
    )
    rest = np.linalg.solve(_SEPTIC_END, target - reached)
    unit = np.concatenate([start, rest])
    scaled: FloatArray = unit / h ** np.arange(8)
    return scaled


_SEPTIC_END = np.array(
    [
        [1.0, 1.0, 1.0, 1.0],
        [4.0, 5.0, 6.0, 7.0],
        [12.0, 20.0, 30.0, 42.0],
        [24.0, 60.0, 120.0, 210.0],
    ]
)


class Integral:
    """The integral of a spline from its first knot on: a rate is given, and the value follows.

    Before the first knot the value is zero, and the rate is what the spline holds there; both are
    meant for splines that begin and end at zero.
    """

    def __init__(self, rate: Spline) -> None:
        self.rate = rate
        c, t = rate.coefficients, rate.t_knots_s
        self._powers = c / np.arange(1, 9)
        spans = np.diff(t)[:, None] ** np.arange(1, 9)
        self._at_knots = np.concatenate([[0.0], np.cumsum(np.sum(self._powers * spans, axis=1))])

    def __call__(self, t_s: FloatArray) -> Jet:
        t = np.asarray(t_s, dtype=np.float64)
        rate, accel, _ = self.rate(t)
        knots = self.rate.t_knots_s
        inside = np.clip(t, knots[0], knots[-1])
        piece = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, len(knots) - 2)
        tau = inside - knots[piece]
        value = np.zeros_like(t)
        for power in range(7, -1, -1):
            value = (value + self._powers[piece, power]) * tau
        return self._at_knots[piece] + value, rate, accel


@dataclass(frozen=True)
class Fourier:
    """Sum of sines: sum_k amplitude_k sin(2 pi frequency_k t + phase_k)."""

    amplitude: tuple[float, ...]
    frequency_hz: tuple[float, ...]
    phase_rad: tuple[float, ...]

    def __call__(self, t_s: FloatArray) -> Jet:
        t = np.asarray(t_s, dtype=np.float64)
        value, rate, accel = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
        for a, f, phase in zip(self.amplitude, self.frequency_hz, self.phase_rad, strict=True):
            w = 2.0 * np.pi * f
            s, c = np.sin(w * t + phase), np.cos(w * t + phase)
            value += a * s
            rate += a * w * c
            accel -= a * w * w * s
        return value, rate, accel


@dataclass(frozen=True)
class Product:
    """``left * right`` by Leibniz' rule."""

    left: Curve
    right: Curve

    def __call__(self, t_s: FloatArray) -> Jet:
        f, df, ddf = self.left(t_s)
        g, dg, ddg = self.right(t_s)
        return f * g, df * g + f * dg, ddf * g + 2.0 * df * dg + f * ddg


@dataclass(frozen=True)
class Sum:
    """Sum of curves."""

    terms: tuple[Curve, ...]

    def __call__(self, t_s: FloatArray) -> Jet:
        jets = [term(t_s) for term in self.terms]
        return (
            np.sum([j[0] for j in jets], axis=0),
            np.sum([j[1] for j in jets], axis=0),
            np.sum([j[2] for j in jets], axis=0),
        )


def window(spans_s: Sequence[tuple[float, float]], ramp_s: float) -> Spline:
    """1 inside each span, 0 outside, with C3 ramps of ``ramp_s`` inside the span's ends.

    Raises:
        ValueError: a span shorter than two ramps, or spans out of order.
    """
    keys: list[Key] = []
    for begin, end in spans_s:
        if end - begin <= 2.0 * ramp_s:
            raise ValueError(f"span {begin}..{end} s is shorter than two ramps of {ramp_s} s")
        keys += [
            Key(begin, 0.0),
            Key(begin + ramp_s, 1.0),
            Key(end - ramp_s, 1.0),
            Key(end, 0.0),
        ]
    return Spline(keys or [Key(0.0, 0.0)])
