# SPDX-License-Identifier: Apache-2.0
"""A sound capture is trusted; each fault made on purpose is found, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from captures import pulses_of_two_nodes, sampled

from hil.bench.analyser.capture import CaptureEdges, Progress
from hil.bench.analyser.selfcheck import check_capture

PERIOD_S = 0.1
RATE_HZ = 4e6


def kinds(capture: CaptureEdges) -> list[str]:
    return [finding.kind for finding in check_capture(capture, pulse_period_s=PERIOD_S)]


@pytest.fixture(scope="module")
def sound() -> CaptureEdges:
    return sampled(pulses_of_two_nodes())


def on_time(capture: CaptureEdges, missing: int = 0, at: float = 0.5) -> CaptureEdges:
    """With arrival times: 20 ms a piece, up to 8 ms late, ``missing`` samples lost at ``at``."""
    rng = np.random.default_rng(1)
    samples = np.arange(1, 401, dtype=np.int64) * 80_000
    taken = samples + np.where(samples > at * samples[-1], missing, 0)
    t_ns = (taken / RATE_HZ * 1e9 + rng.uniform(1e6, 8e6, samples.size)).astype(np.int64)
    return replace(capture, progress=Progress(t_ns, samples))


def test_a_sound_capture_is_trusted(sound: CaptureEdges) -> None:
    assert kinds(sound) == []
    assert kinds(on_time(sound)) == []


def test_every_finding_says_what_to_do(sound: CaptureEdges) -> None:
    for finding in check_capture(replace(sound, samplerate_hz=2e6), pulse_period_s=PERIOD_S):
        assert finding.message
        assert finding.mend


@pytest.mark.parametrize("factor", [2.0, 0.5, 1.001, 0.9995, 12.0])
def test_a_wrong_rate(sound: CaptureEdges, factor: float) -> None:
    findings = check_capture(
        replace(sound, samplerate_hz=RATE_HZ * factor), pulse_period_s=PERIOD_S
    )
    (rate,) = [finding for finding in findings if finding.kind == "rate"]
    assert "sample at 4e+06 Hz" in rate.message


def test_crystals_within_tolerance_are_no_wrong_rate(sound: CaptureEdges) -> None:
    assert kinds(replace(sound, samplerate_hz=RATE_HZ * (1 + 90e-6))) == []


def test_samples_lost_within_the_capture(sound: CaptureEdges) -> None:
    """1,000 samples, 250 us, vanish in the middle: seen by the pulses, too little for the host."""
    sample = np.where(sound.sample > 16_000_000, sound.sample - 1000, sound.sample)
    findings = check_capture(replace(sound, sample=sample), pulse_period_s=PERIOD_S)
    assert [finding.kind for finding in findings] == ["dropped"]
    assert "-1000 samples" in findings[0].message


@pytest.mark.parametrize("at", [0.4, 0.6])
def test_samples_that_came_too_late_for_their_number(sound: CaptureEdges, at: float) -> None:
    findings = check_capture(on_time(sound, missing=400_000, at=at), pulse_period_s=PERIOD_S)
    assert [finding.kind for finding in findings] == ["dropped"]
    assert 390_000 < int(findings[0].message.split()[1]) < 410_000


def test_a_glitch_of_one_sample(sound: CaptureEdges) -> None:
    assert kinds(inserted(sound, "follower.radio_end", 20_000_000, 1)) == ["glitch"]


def test_a_toggle_sooner_than_the_radio_can(sound: CaptureEdges) -> None:
    """90 us are many samples, but no packet is that short."""
    assert kinds(inserted(sound, "leader.radio_end", 20_005_000, 360)) == ["glitch"]


def test_a_pulse_that_is_too_short(sound: CaptureEdges) -> None:
    assert kinds(inserted(sound, "follower.pulse", 20_300_000, 1600)) == ["glitch"]


def inserted(capture: CaptureEdges, name: str, at: int, length: int) -> CaptureEdges:
    """The capture with two more changes of one channel, as a disturbance makes them."""
    index = capture.channels.index(name)
    sample, level = capture.select(name)
    before = int(level[np.searchsorted(sample, at) - 1])
    where = np.searchsorted(capture.sample, [at, at + length])
    return replace(
        capture,
        sample=np.insert(capture.sample, where, [at, at + length]),
        channel=np.insert(capture.channel, where, index),
        level=np.insert(capture.level, where, [1 - before, before]),
    )


def test_a_wire_that_is_off() -> None:
    changes = pulses_of_two_nodes()
    changes["follower.radio_end"] = np.zeros(0)
    (finding,) = check_capture(sampled(changes), pulse_period_s=PERIOD_S)
    assert finding.kind == "stuck"
    assert "follower.radio_end is low throughout" in finding.message


def test_two_inputs_on_one_pin() -> None:
    changes = pulses_of_two_nodes()
    changes["follower.radio_end"] = changes["leader.radio_end"]
    assert kinds(sampled(changes)) == ["same"]


def test_both_pulse_inputs_on_one_pin_would_look_like_perfect_sync() -> None:
    changes = pulses_of_two_nodes()
    changes["follower.pulse"] = changes["leader.pulse"]
    assert kinds(sampled(changes)) == ["same"]


def test_pulses_in_the_same_coarse_samples_are_no_fault() -> None:
    """At 200 kHz two pulses 60 ns apart are one; the verdict's uncertainty covers that."""
    changes = pulses_of_two_nodes(jitter_s=0.0)
    # Between two samples, not upon one.
    between = {name: times + 2e-6 for name, times in changes.items()}
    capture = sampled(between, samplerate_hz=200e3)
    leader, follower = (capture.select(f"{role}.pulse")[0] for role in ("leader", "follower"))
    assert np.array_equal(leader, follower)
    assert "same" not in kinds(capture)


def test_wires_swapped_within_a_node() -> None:
    changes = pulses_of_two_nodes()
    names = ("follower.radio_end", "follower.pulse")
    changes.update(dict(zip(names, [changes[name] for name in reversed(names)], strict=True)))
    findings = check_capture(sampled(changes), pulse_period_s=PERIOD_S)
    swapped = [finding for finding in findings if finding.kind == "swapped"]
    assert len(swapped) == 1
    assert "they are on follower.radio_end" in swapped[0].message


def test_pulses_that_are_missing() -> None:
    changes = pulses_of_two_nodes()
    pulse = changes["leader.pulse"]
    changes["leader.pulse"] = np.delete(pulse, slice(20, 24))
    (finding,) = check_capture(sampled(changes), pulse_period_s=PERIOD_S)
    assert finding.kind == "missing"
    assert f"{pulse.size // 2 - 2} of {pulse.size // 2} pulses" in finding.message


def test_no_pulses_at_all() -> None:
    changes = pulses_of_two_nodes()
    changes["leader.pulse"] = np.zeros(0)
    assert kinds(sampled(changes)) == ["stuck", "missing"]


def test_a_run_without_pulses_asks_for_none() -> None:
    changes = pulses_of_two_nodes()
    del changes["leader.pulse"], changes["follower.pulse"]
    assert check_capture(sampled(changes), pulse_period_s=None) == []
