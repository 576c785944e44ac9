# SPDX-License-Identifier: Apache-2.0
"""The Allan deviation: against its definition, published values and noise of known density."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from hil.calibration.allan import allan_of
from hil.calibration.solve import gyro_rest
from hil.core import calib

NBS9 = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
"""NBS Monograph 140, annex 8.E; deviations in Riley, NIST SP 1065, section 12.3."""


def riley_1000():
    """The 1000-point set of SP 1065, section 12.4: a prime modulus generator."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


def by_definition(y, m):
    """Half the mean square of differences of adjacent averages over m, from every start."""
    terms = [
        (np.mean(y[j + m : j + 2 * m]) - np.mean(y[j : j + m])) ** 2
        for j in range(len(y) - 2 * m + 1)
    ]
    return 0.5 * np.mean(terms)


def flicker(rng, n, h):
    """Samples whose one-sided spectrum is h / f below Nyquist, shaped in the Fourier domain."""
    spectrum = np.fft.rfft(rng.standard_normal(n))
    f = np.fft.rfftfreq(n)
    f[0] = np.inf
    return np.fft.irfft(spectrum * np.sqrt(h / (2.0 * f)), n)


@pytest.mark.parametrize(("m", "deviation"), [(1, 91.22945), (2, 85.95287)])
def test_nbs_monograph_140(m, deviation):
    assert math.sqrt(calib.allan_variance(NBS9, m)) == pytest.approx(deviation, abs=6e-6)


@pytest.mark.parametrize(
    ("m", "deviation"), [(1, 2.922319e-1), (10, 9.159953e-2), (100, 3.241343e-2)]
)
def test_riley_1000_points(m, deviation):
    assert math.sqrt(calib.allan_variance(riley_1000(), m)) == pytest.approx(deviation, rel=2e-7)


@pytest.mark.parametrize("n", [8, 97, 1000])
def test_the_definition(n):
    y = np.random.default_rng(n).standard_normal(n).cumsum() + 1e3
    for m in sorted({1, 2, 3, n // 4, n // 2}):
        assert calib.allan_variance(y, m) == pytest.approx(by_definition(y, m), rel=1e-9)


def test_averaging_times_are_log_spaced_up_to_a_quarter():
    tau_s, deviation, _ = calib.allan_deviation(
        np.random.default_rng(0).standard_normal(40_000), 400.0
    )
    assert tau_s[0] == 1.0 / 400.0
    assert tau_s[-1] == pytest.approx(10_000 / 400.0)
    steps = np.diff(np.log10(tau_s[tau_s > 0.1]))
    np.testing.assert_allclose(steps, 0.1, atol=0.01)
    assert len(deviation) == len(tau_s)


@pytest.mark.parametrize(("sensor", "unit_si"), [("accel", 9.80665e-6), ("gyro", math.pi / 180e3)])
def test_white_noise_of_a_datasheet_density_comes_back(sensor, unit_si):
    """Density d, one-sided: each sample has the variance d^2 rate / 2."""
    rate_hz, density = 417.0, 3.8
    rng = np.random.default_rng(1)
    samples = density * unit_si * math.sqrt(rate_hz / 2.0) * rng.standard_normal((100_000, 3))
    found = allan_of(samples, rate_hz, sensor)
    np.testing.assert_allclose(found.density, density, rtol=0.01)
    slope = np.polyfit(np.log(found.tau_s[:25]), np.log(found.deviation[:25]), 1)[0]
    np.testing.assert_allclose(slope, -0.5, atol=0.02)
    # Whatever is no white noise stays below a tenth of it at 1 s.
    for noise in found.noise:
        assert noise.floor < 0.1 * noise.white


def test_flicker_noise_shows_its_instability():
    """IEEE 952: S = B^2 / (2 pi f), two-sided, has the floor sqrt(2 ln 2 / pi) B."""
    rate_hz, instability = 100.0, 0.02
    h = instability**2 / math.pi  # one-sided
    rng = np.random.default_rng(2)
    n = 1 << 19
    # Unit spacing in frequency: the spectrum h / f has no scale, so the rate drops out.
    y = flicker(rng, n, h) + 0.01 * rng.standard_normal(n)
    tau_s, deviation, noise = calib.allan_deviation(y, rate_hz)
    floor = math.sqrt(2.0 * math.log(2.0) / math.pi) * instability
    assert np.median(deviation[(tau_s > 1.0) & (tau_s < 100.0)]) == pytest.approx(floor, rel=0.06)
    assert noise.floor == pytest.approx(floor, rel=0.06)
    assert noise.instability == pytest.approx(instability, rel=0.06)
    assert math.sqrt(2.0 * math.log(2.0) / math.pi) == pytest.approx(
        calib.FLOOR_OF_INSTABILITY, rel=1e-3
    )


def test_a_walking_bias_is_told_from_a_floor():
    """sigma^2 = K^2 tau / 3 (IEEE 952, annex C)."""
    rate_hz, white, walk = 100.0, 1e-3, 1e-3
    rng = np.random.default_rng(3)
    n = 400_000
    y = white * math.sqrt(rate_hz) * rng.standard_normal(n)
    y += np.cumsum(walk / math.sqrt(rate_hz) * rng.standard_normal(n))
    _, _, noise = calib.allan_deviation(y, rate_hz)
    assert noise.white == pytest.approx(white, rel=0.02)
    assert noise.walk == pytest.approx(walk, rel=0.1)
    assert noise.floor < 0.5 * white


def test_an_hour_takes_well_under_a_second():
    y = np.random.default_rng(4).standard_normal(3600 * 417)
    start = time.process_time()
    calib.allan_deviation(y, 417.0)
    assert time.process_time() - start < 1.0


def test_rest_of_white_noise_has_the_error_of_a_mean():
    rng = np.random.default_rng(5)
    n, rate_hz, sigma = 60 * 417, 417.0, 1e-3
    rests = [gyro_rest(0.01 + sigma * rng.standard_normal((n, 3)), rate_hz) for _ in range(40)]
    usual = sigma / math.sqrt(n)
    assert np.median([r.bias_sigma_radps for r in rests]) == pytest.approx(usual, rel=0.5)
    errors = np.concatenate([r.bias_radps - 0.01 for r in rests])
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(usual, rel=0.2)


def test_rest_of_a_wandering_bias_is_not_believed_like_white_noise():
    """Flicker five times above the error of the mean: sigma / sqrt(n) would be five times off."""
    rng = np.random.default_rng(6)
    n, rate_hz, white = 1 << 15, 417.0, 1e-3
    usual = white / math.sqrt(n)
    h = (5.0 * usual) ** 2 / (2.0 * math.log(2.0))
    found = []
    for _ in range(30):
        y = white * rng.standard_normal(n) + flicker(rng, n, h)
        found.append(calib.rest(y, rate_hz)[1])
    assert 3.0 * usual < np.median(found) < 9.0 * usual


def test_constant_samples_have_no_noise():
    _, deviation, noise = calib.allan_deviation(np.full(1000, 0.3), 100.0)
    np.testing.assert_array_equal(deviation, 0.0)
    assert noise == calib.Noise(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("y", "rate_hz", "why"),
    [
        (np.zeros(7), 1.0, "8 or more"),
        (np.zeros((8, 3)), 1.0, r"give \(n,\)"),
        (np.full(8, np.nan), 1.0, "not finite"),
        (np.zeros(8), 0.0, "measured sample rate"),
    ],
)
def test_what_is_no_record(y, rate_hz, why):
    with pytest.raises(ValueError, match=why):
        calib.allan_deviation(y, rate_hz)


def test_averages_longer_than_half_are_refused():
    with pytest.raises(ValueError, match="half"):
        calib.allan_variance(np.zeros(10), 6)
    with pytest.raises(ValueError, match="give"):
        allan_of(np.zeros((10, 2)), 1.0, "gyro")
