# SPDX-License-Identifier: Apache-2.0
"""Measurements of the leader's clock model: error, skew, convergence, lock."""

from __future__ import annotations

import math

import numpy as np

from hil.budget import judged
from hil.measure import Measurement
from hil.timesync import model as clock_model
from hil.timesync.analysis import NS_PER_TICK, Sync
from hil.timesync.judging import absent, error_family
from hil.wire.messages import SYNC_STATES, TICK_RATE_HZ, name_of


def model_errors(sync: Sync) -> list[Measurement]:
    """The leader's clock model against the truth, between updates: offset and skew."""
    m = sync.models
    nothing = "no locked sync_state frame"
    if sync.truth and np.any(m.locked):
        error = clock_model.model_error(m, sync.truth)
        offset_ns, skew_ppb = error.offset_ns, error.skew_ppb
    else:
        offset_ns = skew_ppb = np.zeros(0)
    how = (
        f"{int(np.sum(m.locked))} locked models, each evaluated at 4 instants between its frame "
        "and the next, against the true clocks"
    )
    result = error_family(sync, "sync.model_error", offset_ns, how, nothing)
    if skew_ppb.size:
        value: float | None = float(np.percentile(np.abs(skew_ppb), 99))
        details = {"mean_ppb": float(np.mean(skew_ppb)), "max_ppb": float(np.abs(skew_ppb).max())}
    else:
        value, how = absent(sync, nothing)
        details = {}
    result.append(judged("sync.skew_error_ppb", value, "T5", sync.conditions, how, details=details))
    return result


def model_against_refit(sync: Sync) -> list[Measurement]:
    """The leader's model against a fit of the same captures made here; needs no truth."""
    m, fit = sync.models, sync.refit
    full = fit.points >= 0.5 * np.max(fit.points, initial=0)
    use = m.locked & np.isfinite(fit.value) & full
    how = (
        f"{int(np.sum(use))} locked models against a least-squares line through the nodes' own "
        "captures of the same window, at the time of the frame; no truth needed"
    )
    if not np.any(use):
        how = "no locked model with enough captures of both nodes to fit a line"
        return [
            judged("sync.model_vs_refit_p99_ns", math.nan, "T4", sync.conditions, how),
            judged("sync.skew_vs_refit_ppb", math.nan, "T5", sync.conditions, how),
        ]
    rows = np.flatnonzero(use)
    offset = m.offset_at(rows, m.now_ticks_leader[rows]) - fit.value[rows]
    skew_ppb = (m.skew - fit.slope)[rows] * 1e9
    return [
        judged(
            "sync.model_vs_refit_p99_ns",
            float(np.percentile(np.abs(offset), 99)) * NS_PER_TICK,
            "T4",
            sync.conditions,
            how,
            details={"mean_ns": float(np.mean(offset)) * NS_PER_TICK},
        ),
        judged(
            "sync.skew_vs_refit_ppb",
            float(np.percentile(np.abs(skew_ppb), 99)),
            "T5",
            sync.conditions,
            how,
            details={"mean_ppb": float(np.mean(skew_ppb))},
        ),
    ]


def convergence(sync: Sync) -> Measurement:
    """Time from the first connection event to a locked model, the slowest connection."""
    leader = sync.own["leader"]
    if len(leader) == 0:
        how = "the leader reported no capture, so there was no connection to converge on"
        return judged("sync.convergence_s", math.inf, "T6", sync.conditions, how, clock="leader")
    generation = leader.key >> 32
    first = {int(g): int(leader.tx[generation == g].min()) for g in np.unique(generation)}
    # A connection that ended sooner than a lock may take says nothing about convergence.
    last = {int(g): int(leader.tx[generation == g].max()) for g in np.unique(generation)}
    longest = 5 * TICK_RATE_HZ
    judged_generations = {g: t for g, t in first.items() if last[g] - t > longest} or first
    times = clock_model.time_to_lock_s(sync.models, judged_generations)
    return judged(
        "sync.convergence_s",
        max(times.values()),
        "T6",
        sync.conditions,
        f"leader's clock, first capture to first locked model, slowest of {len(times)} "
        "connection(s); infinite when one never locked",
        clock="leader",
        details={"by_generation": {str(g): t for g, t in times.items() if math.isfinite(t)}},
    )


def locked(sync: Sync) -> Measurement:
    """Share of the time after the first lock in which the model was locked."""
    counts = {
        name_of(SYNC_STATES, s): int(n)
        for s, n in zip(*np.unique(sync.models.state, return_counts=True), strict=True)
    }
    return judged(
        "sync.locked_share",
        clock_model.locked_share(sync.models, sync.away_ticks_leader),
        "T7",
        sync.conditions,
        "leader's clock, time covered by locked models since the first lock, less "
        f"{len(sync.away_ticks_leader)} times that the leader was told to stay away, each until "
        "the lock after it",
        details={"states": counts},
    )


def model_age(sync: Sync) -> Measurement:
    """Longest time that a locked model was in use before the next one came."""
    m = sync.models
    ages = (m.until_ticks_leader - m.now_ticks_leader)[m.locked] / TICK_RATE_HZ
    how = "leader's clock, from each locked sync_state frame to the next, or to the end of the run"
    if ages.size == 0:
        return judged("sync.model_age_max_s", math.nan, "T8", sync.conditions, "never locked")
    return judged(
        "sync.model_age_max_s",
        float(np.max(ages)),
        "T8",
        sync.conditions,
        how,
        clock="leader",
        details={"median_s": float(np.median(ages)), "models": int(ages.size)},
    )
