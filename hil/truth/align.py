# SPDX-License-Identifier: Apache-2.0
"""Two clocks aligned by what both saw: t_leader = t + offset + skew (t - t_mid).

Coarse: normalised cross-correlation of the vertical velocities by FFT, over every shift that
leaves enough overlap; its sign tells a reference that counts downwards. Fine: Gauss-Newton least
squares of offset, skew, gain and a constant velocity, with residuals beyond three robust standard
deviations left out, and from there generalised least squares with the residuals' own spectrum. A
height is compared as its mean velocity over a span, and so is the estimate: the kernel is the same
on both, so it shifts and dulls neither against the other.

With white noise of s m/s at n times and the bar's acceleration a, no unbiased estimator of the skew
has a standard deviation below s / sqrt(sum a^2 (t - t_mid)^2). 10 mm/s at 200 Hz make 14 ppm of a
deadlift of 13 s, 25 ppm of a tilted bench of 19 s and 9 ppm of a bench of 41 s, before the estimate
has any error of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.reps.trace import Trace
from hil.truth.reference import Reference, ReferenceError

Float = NDArray[np.float64]

COARSE_HZ: Final = 100.0
SPAN_S: Final = 0.05
"""Over which a height becomes a velocity that is looked at."""
ALIGN_SPAN_S: Final = 0.3
"""Over which it does to align: 2 mm of noise are 57 mm/s over 50 ms and 9 mm/s over these."""
GAP_S: Final = 0.25
"""A longer pause of the reference is a gap: nothing is interpolated across it."""
LONGEST_S: Final = 4 * 3600.0
CORRELATION_MIN: Final = 0.5
OVERLAP_MIN: Final = 0.5
"""Share of the shorter one that must lie within the longer."""
RIVAL_S: Final = 0.5
ROUNDS: Final = 30
BAND_HZ: Final = 10.0
"""Bars move more slowly; above, prefilter and quantisation are no noise but look alike."""
WIDER: Final = 1.3
"""The spectrum is itself an estimate, and errors grow between rests: two standard deviations then
hold 95 % of the errors over seeded sets (tests/unit/tools/test_truth_align.py)."""
WEIGHED_ROUNDS: Final = 6
SMOOTH_BINS: Final = 7
"""To each side of a frequency: thirty degrees of freedom for its power."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """What the reference says: mean velocities over spans of its own clock.

    Attributes:
        begin_s, end_s: float64[n]; equal where the reference is a velocity.
        velocity_mps: float64[n].
    """

    begin_s: Float
    end_s: Float
    velocity_mps: Float

    @property
    def t_s(self) -> Float:
        return 0.5 * (self.begin_s + self.end_s)


@dataclass(frozen=True, eq=False)
class Alignment:
    """How the reference's clock and axis lie to the estimate's.

    Attributes:
        offset_s: leader's time less the reference's at ``t_mid_s`` of the reference's clock.
        skew: leader's seconds per second of the reference, less one.
        sign: -1 for a reference that counts downwards.
        gain: of the reference over the estimate.
        offset_sigma_s, skew_sigma, gain_sigma: standard deviations, from residuals and how far
            these depend on their neighbours.
        velocity_offset_mps: constant, reference less estimate.
        correlation: of the coarse step; ``rival`` that of the next best shift.
    """

    offset_s: float
    skew: float
    t_mid_s: float
    sign: int
    gain: float
    offset_sigma_s: float
    skew_sigma: float
    gain_sigma: float
    velocity_offset_mps: float
    correlation: float
    rival: float

    def leader_s(self, t_s: Float) -> Float:
        """Times of the reference on the leader's clock."""
        leader: Float = t_s + self.offset_s + self.skew * (t_s - self.t_mid_s)
        return leader


def pieces(reference: Reference, span_s: float = SPAN_S) -> Pieces:
    """The reference as velocities; a height's are means over about ``span_s``, gaps left out."""
    t, x = reference.t_s, reference.value
    if reference.quantity == "velocity":
        return Pieces(t, t, x)
    step = float(np.median(np.diff(t)))
    m = max(1, round(0.5 * span_s / step))
    begin, end = t[: -2 * m], t[2 * m :]
    kept = end - begin <= 2 * m * step * 1.5 + 1e-12
    velocity = (x[2 * m :] - x[: -2 * m]) / (end - begin)
    return Pieces(begin[kept], end[kept], velocity[kept])


@dataclass(frozen=True, eq=False)
class _Curve:
    """The estimate: velocity, and its integral for means over spans."""

    t_s: Float
    v: Float
    z: Float
    a: Float

    @classmethod
    def of(cls, trace: Trace) -> _Curve:
        t, v = trace.t_s, trace.velocity_z_mps
        steps = 0.5 * (v[1:] + v[:-1]) * np.diff(t)
        return cls(t, v, np.concatenate([[0.0], np.cumsum(steps)]), np.gradient(v, t))

    def inside(self, begin_s: Float, end_s: Float) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = (begin_s >= self.t_s[0]) & (end_s <= self.t_s[-1])
        return found

    def mean(self, begin_s: Float, end_s: Float) -> tuple[Float, Float]:
        """Mean velocity over spans and its derivative by a common shift of both ends."""
        span = end_s - begin_s
        if not np.any(span > 0.0):
            return np.interp(begin_s, self.t_s, self.v), np.interp(begin_s, self.t_s, self.a)
        z = np.interp(end_s, self.t_s, self.z) - np.interp(begin_s, self.t_s, self.z)
        v = np.interp(end_s, self.t_s, self.v) - np.interp(begin_s, self.t_s, self.v)
        return z / span, v / span


def estimate_at(trace: Trace, found: Pieces, a: Alignment) -> tuple[Float, NDArray[np.bool_]]:
    """Mean velocity of the estimate over each piece, and whether the estimate covers it."""
    curve = _Curve.of(trace)
    begin, end = a.leader_s(found.begin_s), a.leader_s(found.end_s)
    return curve.mean(begin, end)[0], curve.inside(begin, end)


def align(trace: Trace, reference: Reference) -> Alignment:
    """The alignment of a reference with an estimate.

    Raises:
        ReferenceError: nothing in common, or too long to be one recording.
    """
    found = pieces(reference, ALIGN_SPAN_S)
    if len(found.t_s) < 2:
        raise ReferenceError(
            "the reference has no two neighbouring samples", "give one without gaps"
        )
    for name, t in (("reference", found.t_s), ("estimate", trace.t_s)):
        if t[-1] - t[0] > LONGEST_S:
            raise ReferenceError(
                f"the {name} is {(t[-1] - t[0]) / 3600.0:.1f} h long", "cut it to the set"
            )
    offset_s, sign, correlation, rival = _coarse(trace, found)
    return _fine(_Curve.of(trace), found, offset_s, sign, (correlation, rival))


def _grid(t_s: Float, v: Float) -> tuple[Float, Float]:
    """Velocity on a grid of ``COARSE_HZ`` from the first time on, and its mask: 0 in gaps."""
    n = int((t_s[-1] - t_s[0]) * COARSE_HZ) + 1
    at = t_s[0] + np.arange(n) / COARSE_HZ
    # Means over grid cells, so that noise of a fast reference does not alias.
    cell = np.minimum(((t_s - t_s[0]) * COARSE_HZ + 0.5).astype(np.int64), n - 1)
    count = np.bincount(cell, minlength=n)
    total = np.bincount(cell, weights=v, minlength=n)
    have = count > 0
    filled = np.interp(at, at[have], total[have] / count[have])
    right = np.clip(np.searchsorted(t_s, at), 1, len(t_s) - 1)
    mask = (t_s[right] - t_s[right - 1] <= GAP_S).astype(np.float64)
    return (filled - np.median(filled[mask > 0]) if mask.any() else filled) * mask, mask


def _coarse(trace: Trace, found: Pieces) -> tuple[float, int, float, float]:
    """Offset at equal rates, sign, correlation, and the correlation of the best other shift."""
    ours, ours_mask = _grid(trace.t_s, trace.velocity_z_mps)
    theirs, theirs_mask = _grid(found.t_s, found.velocity_mps)
    size = 1 << (len(ours) + len(theirs)).bit_length()

    def correlate(a: Float, b: Float) -> Float:
        both = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)
        # Shift k of the reference against the estimate, from -(len(theirs) - 1) upwards.
        shifted: Float = np.concatenate([both[size - len(theirs) + 1 :], both[: len(ours)]])
        return shifted

    overlap = correlate(ours_mask, theirs_mask)
    energy = correlate(ours**2, theirs_mask) * correlate(ours_mask, theirs**2)
    least = 1e-6 * float(np.sum(ours**2) * np.sum(theirs**2))
    usable = (overlap >= OVERLAP_MIN * min(ours_mask.sum(), theirs_mask.sum())) & (energy > least)
    if not usable.any():
        raise ReferenceError(
            "nothing moves in the reference or in the estimate: there is nothing to align by",
            "look at the column and the unit, or give the reference of this recording",
        )
    ratio = np.where(usable, correlate(ours, theirs) / np.sqrt(np.maximum(energy, least)), 0.0)
    # What little a short overlap shows counts for less than the same correlation over all.
    weighed = np.abs(ratio) * np.sqrt(np.maximum(overlap, 0.0) / overlap.max())
    best = int(np.argmax(weighed))
    near = np.abs(np.arange(len(ratio)) - best) < RIVAL_S * COARSE_HZ
    correlation = float(abs(ratio[best]))
    if correlation < CORRELATION_MIN:
        raise ReferenceError(
            f"the reference is nowhere like the estimate: correlation {correlation:.2f} at best",
            "look at the column and the unit, or give the reference of this recording",
        )
    shift_s = (best - (len(theirs) - 1)) / COARSE_HZ
    offset_s = float(trace.t_s[0]) + shift_s - float(found.t_s[0])
    rival = float(np.max(np.where(near, 0.0, weighed), initial=0.0))
    return offset_s, int(np.sign(ratio[best])), correlation, rival


def _fine(
    curve: _Curve, found: Pieces, offset_s: float, sign: int, seen: tuple[float, float]
) -> Alignment:
    t = found.t_s
    t_mid = 0.5 * float(t[0] + t[-1])
    # offset, skew, gain, constant velocity
    x = np.array([offset_s, 0.0, 1.0, 0.0])
    H, residual, kept = np.zeros((0, 4)), np.zeros(0), np.zeros(0, bool)  # noqa: N806
    for k in range(ROUNDS):
        begin, end = (s + x[0] + x[1] * (s - t_mid) for s in (found.begin_s, found.end_s))
        inside = curve.inside(begin, end)
        if inside.sum() < 20:
            raise ReferenceError(
                "the reference and the estimate do not overlap", "give the reference of this set"
            )
        v, slope = curve.mean(begin[inside], end[inside])
        residual = sign * found.velocity_mps[inside] - (x[2] * v + x[3])
        spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        # The first rounds are off by a step of the coarse grid: all residuals are needed.
        kept = np.abs(residual - np.median(residual)) <= (3.0 if k > 5 else np.inf) * spread + 1e-9
        H = np.stack(  # noqa: N806 (as in the equations of least squares)
            [x[2] * slope, x[2] * slope * (t[inside] - t_mid), v, np.ones(len(v))], axis=1
        )[kept]
        step, _, rank, _ = np.linalg.lstsq(H / (norms := np.linalg.norm(H, axis=0)), residual[kept])
        if rank < 4 or not np.all(np.isfinite(step)):
            raise ReferenceError(
                "the motion does not tell offset, skew and gain apart", "give a longer reference"
            )
        step = step / norms
        x = x + step
        if k > 8 and abs(step[0]) < 1e-7 and abs(step[1]) < 1e-9:
            break
    x, sigma = _weighed(curve, found, x, sign)
    return Alignment(
        offset_s=float(x[0]),
        skew=float(x[1]),
        t_mid_s=t_mid,
        sign=sign,
        gain=float(x[2]),
        offset_sigma_s=float(sigma[0]),
        skew_sigma=float(sigma[1]),
        gain_sigma=float(sigma[2]),
        velocity_offset_mps=float(x[3]),
        correlation=seen[0],
        rival=seen[1],
    )


def _weighed(curve: _Curve, found: Pieces, x: Float, sign: int) -> tuple[Float, Float]:
    """Generalised least squares from ``x``, and standard deviations of the four parameters.

    The estimate's error is an integral and the reference's a difference, so residuals lean on
    their neighbours. Where they have much power the frequencies count for little (Whittle's
    likelihood; Kay 1993, section 15.9): the spectrum is that of the residuals, smoothed.
    """
    t_mid = 0.5 * float(found.t_s[0] + found.t_s[-1])
    step_s = float(np.median(np.diff(found.t_s)))
    sigma = np.zeros(4)
    for _ in range(WEIGHED_ROUNDS):
        begin, end = (s + x[0] + x[1] * (s - t_mid) for s in (found.begin_s, found.end_s))
        inside = curve.inside(begin, end)
        t = found.t_s[inside]
        v, slope = curve.mean(begin[inside], end[inside])
        residual = sign * found.velocity_mps[inside] - (x[2] * v + x[3])
        centre = np.median(residual)
        spread = 1.4826 * float(np.median(np.abs(residual - centre))) + 1e-9
        kept = np.abs(residual - centre) <= 4.0 * spread
        H = np.stack([x[2] * slope, x[2] * slope * (t - t_mid), v, np.ones(len(v))], 1)  # noqa: N806
        H, residual = H * kept[:, None], residual * kept  # noqa: N806
        power = np.abs(np.fft.rfft(residual)) ** 2
        kernel = np.full(2 * SMOOTH_BINS + 1, 1.0 / (2 * SMOOTH_BINS + 1))
        smooth = np.convolve(np.pad(power, SMOOTH_BINS, mode="reflect"), kernel, "valid")
        weight = 2.0 / (smooth + 1e-12 * smooth.max())
        weight[np.fft.rfftfreq(len(residual), step_s) > BAND_HZ] = 0.0
        F, f = np.fft.rfft(H, axis=0), np.fft.rfft(residual)  # noqa: N806
        information = np.real(F.conj().T @ (weight[:, None] * F))
        norms = np.sqrt(np.diag(information))
        covariance = np.linalg.inv(information / np.outer(norms, norms)) / np.outer(norms, norms)
        x = x + covariance @ np.real(F.conj().T @ (weight * f))
        sigma = np.sqrt(np.diag(covariance))
    return x, WIDER * sigma
