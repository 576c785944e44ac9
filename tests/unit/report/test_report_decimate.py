# SPDX-License-Identifier: Apache-2.0
"""Thinning keeps what a person must see: excursions, gaps, ends, order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.report.decimate import min_max


@settings(deadline=None)
@given(
    n=st.integers(0, 3000),
    limit=st.integers(8, 500),
    gaps=st.lists(st.integers(0, 2999), max_size=20),
    seed=st.integers(0, 2**32 - 1),
)
def test_laws(n: int, limit: int, gaps: list[int], seed: int) -> None:
    random = np.random.default_rng(seed)
    x = np.cumsum(random.uniform(0.0, 1.0, n))
    y = random.normal(size=n)
    y[[g for g in gaps if g < n]] = np.nan
    thin_x, thin_y = min_max(x, y, limit)
    assert thin_x.size == thin_y.size <= min(n, limit)
    assert np.all(np.diff(thin_x) >= 0)
    original = {(a, b) for a, b in zip(x.tolist(), np.nan_to_num(y, nan=1e9).tolist(), strict=True)}
    kept = zip(thin_x.tolist(), np.nan_to_num(thin_y, nan=1e9).tolist(), strict=True)
    assert all(point in original for point in kept)
    if n:
        assert thin_x[0] == x[0]
        assert thin_x[-1] == x[-1]
    if np.isfinite(y).any():
        assert np.nanmin(thin_y) == np.nanmin(y)
        assert np.nanmax(thin_y) == np.nanmax(y)
    assert np.isnan(thin_y).any() == np.isnan(y).any()


def test_a_single_spike_in_an_hour_survives() -> None:
    t = np.arange(480_000) * 7.5e-3
    y = np.zeros(t.size)
    y[333_333] = 1.0
    thin_t, thin_y = min_max(t, y, 6000)
    assert thin_t.size <= 6000
    assert thin_t[thin_y == 1.0].tolist() == [t[333_333]]


def test_a_short_series_is_left_alone() -> None:
    x = np.arange(10.0)
    assert min_max(x, x, 10)[0] is x


def test_an_absurd_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 8"):
        min_max(np.arange(10.0), np.arange(10.0), 3)
