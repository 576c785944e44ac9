# SPDX-License-Identifier: Apache-2.0
"""What a sample is worth in time, by simulated sampling, and what a verdict makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from captures import in_memory, pulses_of_two_nodes, sampled

from hil.bench.analyser.edges import extract
from hil.bench.analyser.uncertainty import (
    bench_edges,
    difference_rms_ns,
    difference_uncertainty_ns,
    edge_rms_ns,
)
from hil.budget import Conditions, judged
from hil.measure import Limits, Measurement, Verdict
from hil.timesync.pulses import edge_pairs


def test_the_formulas_against_a_million_sampled_edges() -> None:
    rng = np.random.default_rng(2)
    rate_hz, n = 8e6, 1_000_000
    true_ns = rng.uniform(0, 1e9, (2, n))
    seen_ns = np.ceil(true_ns * rate_hz / 1e9) * 1e9 / rate_hz
    error = seen_ns - true_ns
    assert np.std(error) == pytest.approx(edge_rms_ns(rate_hz), rel=0.01)
    difference = error[0] - error[1]
    assert np.std(difference) == pytest.approx(difference_rms_ns(rate_hz), rel=0.01)
    assert np.max(np.abs(difference)) <= difference_uncertainty_ns(rate_hz)
    assert np.max(np.abs(difference)) > 0.99 * difference_uncertainty_ns(rate_hz)


def test_the_crystal_scales_intervals() -> None:
    """1 ms at 50 ppm is 50 ns; a pulse difference of 1 us changes by 0.05 ns."""
    assert difference_uncertainty_ns(1e9, 1e6) == pytest.approx(1 + 50)
    assert difference_uncertainty_ns(1e9, 1e3) == pytest.approx(1 + 0.05)


def test_sample_k_is_at_round_k_periods() -> None:
    words = np.zeros(20, dtype=np.uint8)
    words[1:4] = 1
    words[11:] = 2
    edges = extract(in_memory(words, {"D0": 0, "D1": 1}, 12e6))
    bench = bench_edges(edges, {"D1": "leader.pulse", "D0": "x"}, start_ns_bench=1000)
    assert bench.channels == ("leader.pulse", "x")
    # k / 12 MHz: 83.33, 333.33 and 916.67 ns.
    assert bench.t_ns_bench.tolist() == [1083, 1333, 1917]
    assert bench.channel.tolist() == [1, 1, 0]
    assert bench.level.tolist() == [1, 0, 1]
    assert bench.resolution_ns == pytest.approx(83.3333, abs=1e-3)


def test_times_of_a_long_capture_are_exact() -> None:
    """An hour at 24 MHz: the product of sample number and 1e9 does not fit 64 bits."""
    words = np.array([0, 1], dtype=np.uint8)
    edges = extract(in_memory(words, {"a": 0}, 24e6))
    k = 24_000_000 * 3600 + 7
    edges.sample[0] = k
    assert bench_edges(edges).t_ns_bench[0] == round(k * 10**9 / 24_000_000)


@pytest.mark.parametrize(
    ("rate_hz", "verdict"),
    [(200e3, Verdict.INCONCLUSIVE), (8e6, Verdict.PASS)],
)
def test_the_pulse_check_needs_an_analyser_that_can_tell(rate_hz: float, verdict: Verdict) -> None:
    """Pulses 60 ns apart with 200 ns of jitter: sound, but 200 kHz cannot know."""
    changes = pulses_of_two_nodes()
    edges = bench_edges(sampled(changes, rate_hz))
    leader, _ = edges.select("leader.pulse")
    follower, _ = edges.select("follower.pulse")
    pairs = edge_pairs(leader, follower, 0.1e9, 0.0, 8e9)
    assert pairs.difference_ns.size == 80
    worst_ns = float(np.max(np.abs(pairs.difference_ns)))
    uncertainty_ns = difference_uncertainty_ns(rate_hz, worst_ns)
    conditions = Conditions(simulated=False, phy=2, conn_interval_us=7500)
    name = "sync.edge_error_max_ns"
    budget = judged(name, worst_ns, "G1", conditions, "", uncertainty=uncertainty_ns)
    assert budget.verdict is verdict
    plain = Measurement(
        name, worst_ns, "ns", Limits(high=1500.0), "", "", uncertainty=uncertainty_ns
    )
    assert plain.verdict is verdict


def test_pulses_really_too_far_apart_fail_at_8_mhz() -> None:
    changes = pulses_of_two_nodes(follower_late_s=3e-6)
    edges = bench_edges(sampled(changes, 8e6))
    pairs = edge_pairs(
        edges.select("leader.pulse")[0], edges.select("follower.pulse")[0], 0.1e9, 0.0, 8e9
    )
    worst_ns = float(np.max(np.abs(pairs.difference_ns)))
    uncertainty_ns = difference_uncertainty_ns(8e6, worst_ns)
    plain = Measurement(
        "x", worst_ns, "ns", Limits(high=1500.0), "", "", uncertainty=uncertainty_ns
    )
    assert plain.verdict is Verdict.FAIL
