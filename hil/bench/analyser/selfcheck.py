# SPDX-License-Identifier: Apache-2.0
"""Is the capture to be believed? Asked before any edge of it is.

Everything that is held against the capture is known beforehand: the firmware's pins (see
``boards/README.md``), the period of its pulses on the leader's clock, and the host's clock while
the samples came. Leader and follower swapped as wholes look alike here: both make the same edges.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hil.bench.analyser.capture import CaptureEdges

RATE_TOLERANCE_PPM = 150.0
"""Leader's crystal 40 ppm, analyser's 50 ppm, and as much again."""

PULSE_HIGH_S = 0.5e-3
PULSE_HIGH_TOLERANCE_S = 50e-6
RADIO_END_APART_S = 100e-6
"""An END follows another after a frame space of 150 us and a packet of 44 us at least."""
GLITCH_SAMPLES = 2

LAG_TOLERANCE_S = 0.05
"""A host that is busy reads late by some 10 ms."""
STEP_TOLERANCE_S = 50e-6
"""A pulse comes within 1 us; a USB packet that is lost takes 64 us at 8 MHz with it."""

SAME_EDGES_MIN = 50
RATE_TO_TELL_NODES_HZ = 4e6
"""From this rate on, 50 edges of two nodes never fall all into the same samples."""


@dataclass(frozen=True)
class Finding:
    """What makes a capture doubtful.

    Attributes:
        kind: ``rate``, ``dropped``, ``glitch``, ``missing``, ``stuck``, ``same`` or ``swapped``.
        message: one sentence.
        mend: what to do about it.
    """

    kind: str
    message: str
    mend: str


def check_capture(capture: CaptureEdges, *, pulse_period_s: float | None) -> list[Finding]:
    """Everything that is wrong with a capture; an empty list is trust.

    Args:
        pulse_period_s: of the scheduled pulses; None when the run has none.
    """
    return [
        *stuck(capture),
        *same(capture),
        *swapped(capture),
        *glitches(capture),
        *late_arrival(capture),
        *(() if pulse_period_s is None else pulse_train(capture, pulse_period_s)),
    ]


def stuck(capture: CaptureEdges) -> Iterator[Finding]:
    """Channels on which nothing ever happens."""
    for name in capture.channels:
        if capture.select(name)[0].size == 0:
            level = "high" if capture.initial[capture.channels.index(name)] else "low"
            yield Finding(
                "stuck",
                f"{name} is {level} throughout: nothing arrives there",
                f"connect the analyser's input to the pin of {name} (boards/README.md)\n"
                "connect the grounds; set the threshold to half of the board's VDD",
            )


def same(capture: CaptureEdges) -> Iterator[Finding]:
    """Pairs of channels that cannot be two pins."""
    for one, other in combinations(capture.channels, 2):
        a, b = capture.select(one)[0], capture.select(other)[0]
        # Both nodes act at the same time by design: a coarse sample cannot tell them apart.
        twins = _signal(one) == _signal(other)
        enough = SAME_EDGES_MIN if twins else 2
        if twins and capture.samplerate_hz < RATE_TO_TELL_NODES_HZ:
            continue
        if a.size >= enough and np.array_equal(a, b):
            yield Finding(
                "same",
                f"{one} and {other} change in the same {a.size} samples: both inputs see one pin",
                f"take the wires of {one} and {other} apart and connect each to its own pin",
            )


def swapped(capture: CaptureEdges) -> Iterator[Finding]:
    """Pulse channels without pulses, where another channel of the same node has them."""
    for name in capture.channels:
        if _signal(name) != "pulse" or _has_pulses(capture, name) is not False:
            continue
        node = name.rpartition(".")[0]
        others = [
            other
            for other in capture.channels
            if other.rpartition(".")[0] == node
            and _signal(other) != "pulse"
            and _has_pulses(capture, other)
        ]
        where = f"they are on {others[0]}" if others else "nor has another channel of its node"
        yield Finding(
            "swapped",
            f"{name} has no pulses of {PULSE_HIGH_S * 1e3:g} ms; {where}",
            f"swap the wires of {name} and {others[0]}"
            if others
            else f"connect the analyser's input to the pin of {name} (boards/README.md)\n"
            "set the rate that the analyser really uses",
        )


def glitches(capture: CaptureEdges) -> Iterator[Finding]:
    """Levels that last shorter than two samples, or than the firmware can make them last."""
    for name in capture.channels:
        sample, level = capture.select(name)
        lasted = np.diff(sample)
        floor = np.full(lasted.size, float(GLITCH_SAMPLES))
        if _signal(name) == "radio_end":
            floor = np.maximum(floor, RADIO_END_APART_S * capture.samplerate_hz - 1)
        elif _signal(name) == "pulse":
            high = (PULSE_HIGH_S - PULSE_HIGH_TOLERANCE_S) * capture.samplerate_hz - 1
            floor[level[:-1] == 1] = max(high, GLITCH_SAMPLES)
        short = np.flatnonzero(lasted < floor)
        if short.size:
            worst_us = lasted[short].min() / capture.samplerate_hz * 1e6
            at_s = sample[short[0]] / capture.samplerate_hz
            yield Finding(
                "glitch",
                f"{name} has {short.size} levels too short to be the firmware's, the shortest "
                f"{worst_us:.3g} us, the first {at_s:.6f} s after the start",
                "shorten the wires and give each board a ground wire to the analyser\n"
                "set the threshold to half of the board's VDD\n"
                "sample at 4 MHz or more",
            )


def late_arrival(capture: CaptureEdges) -> Iterator[Finding]:
    """Samples that came ever later than their number says: some before them are missing."""
    progress = capture.progress
    if progress is None or progress.samples.size < 2:
        return
    due_s = progress.samples / capture.samplerate_hz
    lag_s = (progress.t_ns_host - progress.t_ns_host[0]) / 1e9 - due_s
    passed_s = float(progress.t_ns_host[-1] - progress.t_ns_host[0]) / 1e9
    third = max(1, lag_s.size // 3)
    # The least lag of each end is the one that no busy host has added to.
    grown_s = float(np.min(lag_s[-third:]) - np.min(lag_s[:third]))
    if abs(grown_s) > LAG_TOLERANCE_S + passed_s * RATE_TOLERANCE_PPM * 1e-6:
        what = "are missing" if grown_s > 0 else "are too many"
        count = abs(grown_s) * capture.samplerate_hz
        yield Finding(
            "dropped",
            f"about {count:.0f} samples {what}: {capture.samples} came within {passed_s:.3f} s",
            "connect the analyser to a USB port of its own, not through a hub\n"
            "lower the sample rate, or close what else uses the bus",
        )


def pulse_train(capture: CaptureEdges, period_s: float) -> Iterator[Finding]:
    """The known clock: rate, lost samples and lost pulses, from the leader's pulses."""
    name = "leader.pulse"
    if name not in capture.channels:
        return
    sample, level = capture.select(name)
    rising = sample[level == 1]
    due = int(capture.duration_s / period_s)
    if rising.size < 3:
        if due >= 3:
            yield _missing(name, rising.size, due)
        return
    nominal = period_s * capture.samplerate_hz
    distance = np.diff(rising)
    step = float(np.median(distance))
    if abs(step / nominal - 1.0) > RATE_TOLERANCE_PPM * 1e-6 + 2.0 / nominal:
        # A rate far off would make the counts below nonsense.
        yield Finding(
            "rate",
            f"the pulses of the leader are {step / capture.samplerate_hz:.6g} s apart instead of "
            f"{period_s:g} s: the analyser seems to sample at {step / period_s:.6g} Hz, not "
            f"{capture.samplerate_hz:g} Hz",
            "set a rate that the analyser has\nstate the rate that the file was captured with",
        )
        return
    periods = np.maximum(np.rint(distance / step), 1.0)
    yield from _lost_between(capture, rising, distance - periods * step)
    lost = int(np.sum(periods - 1.0))
    if lost:
        yield _missing(name, rising.size, rising.size + lost)


def _lost_between(
    capture: CaptureEdges, rising: NDArray[np.int64], beside: NDArray[np.float64]
) -> Iterator[Finding]:
    off = np.flatnonzero(np.abs(beside) > STEP_TOLERANCE_S * capture.samplerate_hz)
    if off.size:
        first = off[0]
        yield Finding(
            "dropped",
            f"{off.size} distances between pulses of the leader are wrong, the first by "
            f"{beside[first]:+.0f} samples after sample {rising[first]}: samples are missing, or "
            "the schedule was changed",
            "connect the analyser to a USB port of its own, not through a hub\n"
            "lower the sample rate",
        )


def _missing(name: str, came: int, due: int) -> Finding:
    return Finding(
        "missing",
        f"{name} shows {came} of {due} pulses",
        "look whether the firmware reports them (PULSE frames)\n"
        f"connect the analyser's input to the pin of {name} (boards/README.md)",
    )


def _signal(name: str) -> str:
    return name.rpartition(".")[2]


def _has_pulses(capture: CaptureEdges, name: str) -> bool | None:
    """Are most of its high levels 0.5 ms long? None when there is none."""
    sample, level = capture.select(name)
    high_s = np.diff(sample)[level[:-1] == 1] / capture.samplerate_hz
    if high_s.size == 0:
        return None
    tolerance_s = PULSE_HIGH_TOLERANCE_S + 1.0 / capture.samplerate_hz
    return bool(np.mean(np.abs(high_s - PULSE_HIGH_S) <= tolerance_s) > 0.5)
