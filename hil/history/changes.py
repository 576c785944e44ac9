# SPDX-License-Identifier: Apache-2.0
"""Where the level of a measurement changed from run to run.

The method, for values :math:`x_1 … x_n` in the order of the runs:

1. *Is there a change?* Each value is replaced by its rank, and with the sums
   :math:`S_k = Σ_{i≤k} (r_i - r̄)` two figures are made: the largest standardised CUSUM
   :math:`|S_k| / sqrt(k (n - k) / n)` over all k, which a step makes large (Pettitt 1979, "A
   non-parametric approach to the change-point problem"), and the range :math:`max S - min S`,
   which a level that comes back makes large (Kuiper 1960). Each is compared with the same of
   ``PERMUTATIONS`` random orders at half of ``ALPHA``. A series without a change is reported with
   a probability of at most ``ALPHA``, whatever the distribution of the values is: outliers, ties
   and heavy tails included. Below ``MIN_RUNS`` runs no order is rare enough, and nothing is said.
2. *Steps or a drift?* One line, one step and two steps are fitted by least squares; the least
   :math:`n ln(S/n) + p ln n` wins, with p = 2 for the line and 1 + 3 for each step, because a step
   may lie anywhere (Zhang and Siegmund 2007, "A modified Bayes information criterion"). A line is
   reported as one drift and not looked into; at steps the series is cut, and the parts go to 1.
   More than two equal steps in one direction read as a drift.
3. *Is it more than the uncertainty?* A change smaller than the root sum of squares of the two
   levels' uncertainties is not reported: the level itself is not known better than that.

The random orders come from a fixed seed: the same history gives the same answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ALPHA: Final = 0.01
PERMUTATIONS: Final = 999
MIN_RUNS: Final = 12
MIN_PART: Final = 3
"""Runs on either side of a step, so that one outlier is no level."""
OUTLIER: Final = 6.0
MAX_RUNS: Final = 600
"""Two steps are sought over all pairs; of a longer series the last runs are looked at."""


@dataclass(frozen=True)
class Change:
    """One change of level.

    Attributes:
        kind: ``step``, or ``drift`` for a steady one.
        start: index of the first run at the new level; of the first run of a drift.
        stop: index after the last run of the part of the series that it was found in.
        before: level before, median; at the start of a drift.
        after: level after, median; at the end of a drift.
    """

    kind: Literal["step", "drift"]
    start: int
    stop: int
    before: float
    after: float


def find(values: Array, uncertainty: Array) -> list[Change]:
    """The changes in ``values``, in order.

    Args:
        values: shape (n,), finite, in the order of the runs.
        uncertainty: shape (n,), half width of the interval that each true value lies in, in the
            unit of the values.

    Raises:
        ValueError: the shapes differ, or something is not finite.
    """
    values, uncertainty = np.asarray(values, float), np.asarray(uncertainty, float)
    if values.ndim != 1 or values.shape != uncertainty.shape:
        raise ValueError(f"shapes {values.shape} and {uncertainty.shape} are not (n,) and (n,)")
    if not (np.isfinite(values).all() and np.isfinite(uncertainty).all()):
        raise ValueError("a value or an uncertainty is not finite")
    first = max(0, values.size - MAX_RUNS)
    found = _within(values, uncertainty, first, values.size, np.random.default_rng(0))
    return sorted(found, key=lambda change: change.start)


def _within(
    values: Array, uncertainty: Array, start: int, stop: int, random: np.random.Generator
) -> Iterator[Change]:
    part = values[start:stop]
    if part.size < MIN_RUNS or not _changes(part, random):
        return
    cuts = _shape(part)
    if not cuts:
        ends = np.polyval(np.polyfit(np.arange(part.size), part, 1), [0, part.size - 1])
        third = max(MIN_PART, part.size // 3)
        unsure = _level(uncertainty[start : start + third], uncertainty[stop - third : stop])
        if abs(ends[1] - ends[0]) > unsure:
            yield Change("drift", start, stop, float(ends[0]), float(ends[1]))
        return
    edges = [start, *(start + cut for cut in cuts), stop]
    for left, cut, right in zip(edges, edges[1:], edges[2:], strict=False):
        before, after = (float(np.median(values[a:b])) for a, b in ((left, cut), (cut, right)))
        if abs(after - before) > _level(uncertainty[left:cut], uncertainty[cut:right]):
            yield Change("step", cut, right, before, after)
    for left, right in pairwise(edges):
        yield from _within(values, uncertainty, left, right, random)


def _level(before: Array, after: Array) -> float:
    """Uncertainty of the difference of two levels: what repeats in every run stays in each."""
    return float(np.hypot(np.median(before), np.median(after)))


def _changes(part: Array, random: np.random.Generator) -> bool:
    """Whether the order of the values is rarer than ``ALPHA`` among all orders of them."""
    ranks = _ranks(part)
    if np.ptp(ranks) == 0:
        return False
    orders = random.permuted(np.tile(ranks, (PERMUTATIONS, 1)), axis=1)
    # What is equal on paper must not differ by a rounding.
    as_rare = np.sum(_figures(orders) >= _figures(ranks[None, :]) * (1 - 1e-9), axis=1)
    return bool((1 + as_rare.min()) / (1 + PERMUTATIONS) <= ALPHA / 2)


def _figures(ranks: Array) -> Array:
    """Shape (2, rows): largest standardised CUSUM of each row, and range of its sums.

    The cuts leave ``MIN_PART`` runs on either side.
    """
    n = ranks.shape[1]
    k = np.arange(1, n)
    sums = np.cumsum(ranks - ranks.mean(axis=1, keepdims=True), axis=1)[:, :-1]
    scaled = (np.abs(sums) / np.sqrt(k * (n - k) / n))[:, MIN_PART - 1 : n - MIN_PART]
    return np.stack((scaled.max(axis=1), np.ptp(sums, axis=1)))


def _ranks(part: Array) -> Array:
    """Ranks from 1; equal values share the mean of theirs."""
    _, inverse, counts = np.unique(part, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    shared: Array = (last - (counts - 1) / 2)[inverse]
    return shared


def _shape(part: Array) -> list[int]:
    """Indices of the cuts of the best fit by one or two steps; empty when a line fits better.

    Fitted to values without their single outliers: what lies further from the median of itself
    and its neighbours than ``OUTLIER`` times the median of such distances is replaced by that
    median (Hampel's identifier), which leaves a step where it is.
    """
    padded = np.concatenate((part[:1], part, part[-1:]))
    middle = np.median(np.stack((padded[:-2], part, padded[2:])), axis=0)
    distance = np.abs(part - middle)
    reach = OUTLIER * float(np.median(distance[distance > 0])) if distance.any() else 0.0
    x = np.where(distance > reach, middle, part)
    n = x.size
    x = x - x.mean()
    t = np.arange(n) - (n - 1) / 2
    total = float(x @ x)
    line = total - float(t @ x) ** 2 / float(t @ t)
    sums, squares = (np.concatenate(([0.0], np.cumsum(v))) for v in (x, x * x))

    def scatter(i: Any, j: Any) -> Any:
        """Sum of squares of x[i:j] about its mean."""
        return squares[j] - squares[i] - (sums[j] - sums[i]) ** 2 / np.maximum(j - i, 1)

    cut = np.arange(MIN_PART, n - MIN_PART + 1)
    one = scatter(0, cut) + scatter(cut, n)
    first, second = np.meshgrid(cut, cut, indexing="ij")
    two = scatter(0, first) + scatter(first, second) + scatter(second, n)
    two = np.where(second - first >= MIN_PART, two, np.inf)
    floor = max(total, 1.0) * 1e-12
    fits: list[tuple[float, list[int]]] = [
        (_schwarz(line, floor, n, 2), []),
        (_schwarz(float(one.min()), floor, n, 4), [int(cut[one.argmin()])]),
    ]
    if np.isfinite(two.min()):
        i, j = np.unravel_index(int(two.argmin()), two.shape)
        fits.append((_schwarz(float(two.min()), floor, n, 7), [int(cut[i]), int(cut[j])]))
    return min(fits, key=lambda fit: fit[0])[1]


def _schwarz(scatter: float, floor: float, n: int, parameters: int) -> float:
    return float(n * np.log(max(scatter, floor) / n) + parameters * np.log(n))
