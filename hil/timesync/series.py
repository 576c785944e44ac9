# SPDX-License-Identifier: Apache-2.0
"""What of the time sync is worth looking at: timelines, histograms and the Allan deviation."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import line
from hil.budget.sources import (
    CALM,
    LONG_AGE_S,
    LONG_INTERVAL_S,
    SHORT_AGE_S,
    SHORT_INTERVAL_S,
    WARMING,
    sync_rms_ns,
)
from hil.recording import Recording
from hil.series import LimitLine, Series, histogram
from hil.streams import ROLES
from hil.timesync import connection_series
from hil.timesync import model as clock_model
from hil.timesync.analysis import NS_PER_TICK, WRONG_PAIR_NS, Sync
from hil.timesync.fit import allan_deviation
from hil.timesync.judge_pulses import (
    EDGE_AT_COMPARE_NS,
    edge_lateness_ns,
    settled_edge_pairs,
    settled_pulse_error_ns,
)
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]

SHORT_BELOW_US: Final = 10_000
"""Connection intervals up to this one are judged by the budget's first case."""


def series(recording: Recording, sync: Sync) -> list[Series]:
    """All series of the sync suite; those whose stream is absent are left out."""
    return [
        *pulse_error(sync),
        *model_error(sync),
        *skew(sync),
        *offset(sync),
        *edges(recording, sync),
        *schedule(recording, sync),
        *connection_series.series(recording, sync),
    ]


def _both_sides(sync: Sync, line_id: str) -> tuple[LimitLine, ...]:
    budget_line = line(line_id)
    high = budget_line.limits(sync.conditions).high
    assert high is not None
    label = f"{high:g} {budget_line.unit}, {line_id}"
    return LimitLine(high, f"+{label}"), LimitLine(-high, f"−{label}", "below")


def _on_leader(
    name: str, title: str, t_ticks: NDArray[Any], y: Float, unit: str, **more: Any
) -> Series:
    """A series over the leader's clock, put in ascending order."""
    order = np.argsort(t_ticks, kind="stable")
    return Series(
        name=name,
        title=title,
        x_unit="s",
        y_unit=unit,
        x=np.asarray(t_ticks, dtype=np.float64)[order] / TICK_RATE_HZ,
        y=np.asarray(y, dtype=np.float64)[order],
        clock="leader",
        **more,
    )


def pulse_error(sync: Sync) -> list[Series]:
    """Sync error at the scheduled pulses, in exact ticks."""
    t, error_ns = settled_pulse_error_ns(sync)
    if error_ns.size == 0:
        return []
    limits = _both_sides(sync, "T1")
    check = "sync.error_p99_ns"
    return [
        _on_leader(
            "sync.error",
            "Sync error at the pulses",
            t,
            error_ns,
            "ns",
            kind="points",
            limits=limits,
            y_label="leader minus follower",
            check=check,
            caption="Each pulse's programmed COMPARE of both nodes, in exact ticks, put on true "
            "time.",
        ),
        *distribution(sync, error_ns, limits, check),
    ]


def distribution(
    sync: Sync, error_ns: Float, limits: tuple[LimitLine, ...], check: str
) -> list[Series]:
    """Histogram of the sync error; in simulation beside what the budget expects of it."""
    measured = histogram(
        "sync.error_histogram",
        "measured",
        error_ns,
        "ns",
        bins=40,
        limits=limits,
        x_label="leader minus follower",
        check=check,
        caption=f"{error_ns.size} pulses; measured rms {np.sqrt(np.mean(error_ns**2)):.3g} ns.",
    )
    shared: dict[str, Any] = {
        "plot": "sync.error_histogram",
        "plot_title": "Sync error at the pulses, distribution",
    }
    if not sync.conditions.simulated:
        return [replace(measured, **shared)]
    short = sync.conditions.conn_interval_us <= SHORT_BELOW_US
    crystals, interval_s, age_s = (
        (CALM, SHORT_INTERVAL_S, SHORT_AGE_S) if short else (WARMING, LONG_INTERVAL_S, LONG_AGE_S)
    )
    sigma_ns = sync_rms_ns(crystals, interval_s, age_s)
    below = np.array([0.5 * math.erfc(-x / sigma_ns / math.sqrt(2.0)) for x in measured.x])
    expected = replace(
        measured,
        name="sync.error_expected",
        title=f"normal, {sigma_ns:.1f} ns rms",
        y=error_ns.size * np.diff(below),
        caption="The line is a normal distribution with the rms that the error budget works out "
        "for T3 in simulation: the grid of the radio simulator, crystal wander within the window, "
        "COMPARE in whole ticks. Jitter of a real radio's END event is in neither.",
    )
    return [replace(one, **shared) for one in (measured, expected)]


def model_error(sync: Sync) -> list[Series]:
    """Error of the clock model in use."""
    m = sync.models
    if not sync.truth or not np.any(m.locked):
        return []
    error = clock_model.model_error(m, sync.truth)
    return [
        _on_leader(
            "sync.model_error",
            "Error of the clock model in use",
            error.t_ticks_leader,
            error.offset_ns,
            "ns",
            limits=_both_sides(sync, "T1"),
            y_label="model minus truth",
            check="sync.model_error_p99_ns",
            caption="Every locked model, between its frame and the next, against the simulated "
            "crystals. What RX END jitters on silicon is not in it.",
        )
    ]


def skew(sync: Sync) -> list[Series]:
    """Skew: reported, recomputed, true."""
    m, fit = sync.models, sync.refit
    rows = np.flatnonzero(m.locked)
    if rows.size == 0:
        return []
    now = m.now_ticks_leader[rows]
    common: dict[str, Any] = {
        "y_label": "follower's rate over leader's, minus one",
        "plot": "sync.skew",
        "plot_title": "Skew",
    }
    result = [
        _on_leader(
            "sync.skew_reported",
            "reported by the leader",
            now,
            m.skew[rows] * 1e6,
            "ppm",
            check="sync.skew_error_ppb" if sync.truth else "sync.skew_vs_refit_ppb",
            **common,
        ),
        _on_leader(
            "sync.skew_refit", "recomputed here", now, fit.slope[rows] * 1e6, "ppm", **common
        ),
    ]
    if sync.truth:
        true = sync.truth.skew(now) * 1e6
        result.append(_on_leader("sync.skew_true", "true", now, true, "ppm", **common))
    return result


def offset(sync: Sync) -> list[Series]:
    """Offset of the pairs without its straight line, their residuals, and Allan deviation."""
    near = np.abs(sync.pair_error_ns) <= WRONG_PAIR_NS
    pairs = sync.pairs.take(near)
    if len(pairs) < 3:
        return []
    t = pairs.t_ticks_leader
    ticks = pairs.offset_ticks
    u = t - t.mean()
    straight = np.dot(u, ticks - ticks.mean()) / np.dot(u, u) * u + ticks.mean()
    residual_ns = sync.pair_error_ns[near]
    against = "the truth" if sync.truth else "the line of its neighbours"
    result = [
        _on_leader(
            "sync.offset",
            "Offset over time, straight line taken out",
            t,
            (ticks - straight) * NS_PER_TICK,
            "ns",
            y_label="follower minus leader",
            caption="From the nodes' own captures; the straight line is the mean drift.",
        ),
        _on_leader(
            "sync.residual",
            "Residuals of the pairs",
            t,
            residual_ns,
            "ns",
            kind="points",
            y_label=f"pair minus {against}",
            check="sync.pairs_wrong",
            caption=f"Two-way offset of each pair minus {against}.",
        ),
        histogram(
            "sync.residual_histogram",
            "Residuals of the pairs, distribution",
            residual_ns,
            "ns",
            x_label=f"pair minus {against}",
            check="sync.pair_bias_ns",
        ),
    ]
    tau_s, deviation = allan_deviation(t / TICK_RATE_HZ, ticks / TICK_RATE_HZ)
    if tau_s.size:
        result.append(
            Series(
                name="sync.allan",
                title="Allan deviation of the offset",
                x_unit="s",
                y_unit="1",
                x=tau_s,
                y=deviation,
                x_log=True,
                y_log=True,
                x_label="averaging time",
                y_label="Allan deviation",
                caption="Of the pairs' offset: falls with the averaging time while stamps are the "
                "noise, rises where the crystals' wander takes over. The window of the fit "
                "belongs near the lowest point.",
            )
        )
    return result


def edges(recording: Recording, sync: Sync) -> list[Series]:
    """Pulses on the analyser."""
    found = settled_edge_pairs(recording, sync)
    if found is None or found.difference_ns.size == 0:
        return []
    return [
        Series(
            name="sync.edges",
            title="Pulses on the analyser",
            x_unit="s",
            y_unit="ns",
            x=found.t_ns_bench / 1e9,
            y=found.difference_ns,
            kind="points",
            limits=_both_sides(sync, "G1"),
            clock="bench",
            y_label="leader's edge minus follower's",
            check="sync.edge_error_max_ns",
            caption=f"Resolution {recording.edges.resolution_ns:g} ns.",
        )
    ]


def schedule(recording: Recording, sync: Sync) -> list[Series]:
    """Each node's pulse edge on the analyser against the COMPARE that was programmed for it."""
    high = line("G2").limits(sync.conditions).high
    assert high is not None
    found = []
    for role in ROLES:
        at_ns, late_ns = edge_lateness_ns(recording, sync, role)
        seen = np.abs(late_ns) <= EDGE_AT_COMPARE_NS
        if not np.any(seen):
            continue
        order = np.argsort(at_ns[seen], kind="stable")
        found.append(
            Series(
                name=f"sync.schedule_{role}",
                title=role,
                x_unit="s",
                y_unit="ns",
                x=at_ns[seen][order] / 1e9,
                y=late_ns[seen][order],
                kind="points",
                limits=(
                    LimitLine(high, f"+{high:g} ns, G2"),
                    LimitLine(-high, f"−{high:g} ns, G2", "below"),
                ),
                clock="bench",
                y_label="edge minus programmed COMPARE",
                plot="sync.schedule",
                plot_title="Pulses on the analyser against their schedule",
                check="sync.compare_to_edge_max_ns",
                caption="Nearest edge of each node's pulse pin minus the true time of the COMPARE "
                "that the node programmed. The simulator floors edges to its grid of 1 µs, so the "
                "figure shows that COMPARE makes the edge, and nothing of a pin's delay.",
            )
        )
    return found
