# SPDX-License-Identifier: Apache-2.0
"""What of the estimate is worth looking at."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import line
from hil.fusion.consistency import nees
from hil.fusion.inputs import Run, runs
from hil.fusion.measures import expected
from hil.fusion.parity import STATES, repeat, state_errors
from hil.fusion.truth import Judged, judge
from hil.recording import Recording
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.reference.study import NEES_BAND
from hil.series import LimitLine, Series
from hil.streams import frames
from hil.timesync.analysis import Sync
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]

UPDATES: Final = {
    "stillness": (Flag.ZUPT | Flag.ZUPT_GATED, "zupt_gate"),
    "rigid body": (Flag.RIGID | Flag.RIGID_GATED, "rigid_gate"),
    "round trip": (Flag.ROUND_TRIP | Flag.ROUND_TRIP_GATED, "round_trip_gate"),
}
"""Kind of update -> the flags of a step on which it ran, and the parameter that is its gate."""

PARITY_STEPS: Final = 8
BELOW: Final = 0.12
"""Where spans are drawn: so far below the curve, as a share of its height."""


def series(recording: Recording, sync: Sync) -> list[Series]:
    """Velocity with stillness, errors, innovations, NEES, and parity with the reference."""
    states = frames(recording, "leader", "ekf_state")
    found = runs(recording) if expected(recording) else []
    if states.size == 0 or not found:
        return []
    run = found[-1]
    states = states[states["offset"] >= run.begin]
    judged = judge(recording, sync, states)
    if judged is None or judged.t_s.size == 0:
        shown = alone(states)
    else:
        shown = [*against_truth(judged), *consistency(recording, sync, run)]
    return [*shown, *innovations(states, run.params), *parity(run, sync)]


def _t_s(states: NDArray[Any]) -> Float:
    return np.maximum.accumulate(states["t_ticks_leader"].astype(np.float64)) / TICK_RATE_HZ


def alone(states: NDArray[Any]) -> list[Series]:
    """Vertical velocity and stillness where no truth is known."""
    v = states["centre_velocity_mps"][:, 2].astype(np.float64)
    still = (states["flags"] & int(Flag.ZUPT)) != 0
    return _velocity(
        _t_s(states), {"estimate": v}, still, ("leader", "time", ""), "No truth is known here."
    )


def against_truth(judged: Judged) -> list[Series]:
    """Vertical velocity of the bar's centre beside the truth; errors of velocity and attitude."""
    error_mmps = (judged.velocity_z_mps - judged.true_velocity_z_mps) * 1e3
    common: dict[str, Any] = {
        "x_unit": "s",
        "x": judged.t_s,
        "clock": "bench",
        "x_label": "time since the lift began",
    }
    traces = {"estimate": judged.velocity_z_mps, "truth": judged.true_velocity_z_mps}
    return [
        *_velocity(
            judged.t_s,
            traces,
            judged.zupt,
            ("bench", "time since the lift began", "ekf.peak_velocity_rmse_mmps"),
            "Truth is the trajectory that the simulated bar followed: a rigid bar, sensors without "
            "soft mounts. Real plates rattle and bars bend, which nothing here shows.",
        ),
        Series(
            name="ekf.velocity_error",
            title="Error of the vertical velocity",
            y_unit="mm/s",
            y=error_mmps,
            y_label="estimate less truth",
            check="ekf.mean_velocity_rmse_mmps",
            caption="Error of the vertical velocity of the bar's centre, frame by frame; the check "
            "judges the means over concentric phases, in which much of it cancels.",
            **common,
        ),
        Series(
            name="ekf.tilt_error",
            title="Error of the inclination",
            y_unit="deg",
            y=np.degrees(judged.tilt_error_rad),
            y_label="angle to the true vertical",
            check="ekf.inclination_rmse_deg",
            caption="Angle between the estimated and the true vertical.",
            **common,
        ),
    ]


def _velocity(
    t_s: Float,
    traces: dict[str, Float],
    still: NDArray[np.bool_],
    said: tuple[str, str, str],
    more: str,
) -> list[Series]:
    """``said``: clock, label of the time axis, and the check that judges the traces."""
    clock, x_label, check = said
    low = min(float(v.min()) for v in traces.values())
    high = max(float(v.max()) for v in traces.values())
    level = low - BELOW * ((high - low) or 1.0)
    spans = np.where(still, level, np.nan)
    shown = {**traces, "zero-velocity updates": spans}
    return [
        Series(
            name=f"ekf.velocity_{title.replace(' ', '_').replace('-', '_')}",
            title=title,
            x_unit="s",
            y_unit="m/s",
            x=t_s,
            y=values,
            kind="points" if values is spans else "line",
            clock=clock,
            x_label=x_label,
            y_label="vertical velocity",
            plot="ekf.velocity",
            plot_title="Vertical velocity of the bar's centre",
            check=check,
            caption="EKF frames of the leader, causal, at the times that they refer to; the spans "
            f"below are those of zero-velocity updates. {more}",
        )
        for title, values in shown.items()
    ]


def innovations(states: NDArray[Any], params: Params) -> list[Series]:
    """Normalised innovation squared of each kind of update, with the gate it was held against."""
    t_s, nis = _t_s(states), states["nis"].astype(np.float64)
    kinds = [(states["flags"] & int(flags)) != 0 for flags, _ in UPDATES.values()]
    # Of several updates on a step the frame has the last, and they run in this order.
    last = np.select(kinds[::-1], range(len(kinds))[::-1], -1)
    found = []
    for number, (title, (_, field)) in enumerate(UPDATES.items()):
        gate = float(getattr(params, field))
        ran = (last == number) & np.isfinite(nis) & (states["gate"] == np.float32(gate))
        if not ran.any():
            continue
        found.append(
            Series(
                name=f"ekf.nis_{title.replace(' ', '_')}",
                title=title,
                x_unit="s",
                y_unit="1",
                x=t_s[ran],
                y=nis[ran],
                kind="points",
                y_log=True,
                limits=(LimitLine(gate, f"gate {gate:.4g}"),),
                clock="leader",
                y_label="normalised innovation squared",
                plot="ekf.nis",
                plot_title="Innovations and their gate",
                caption="Each frame's last update: its innovation squared over the variance "
                "expected of it; beyond the gate it is refused. Values far below 1 mean that the "
                "update's noise is set larger than a simulated bar's: people and floors shake.",
            )
        )
    return found


def consistency(recording: Recording, sync: Sync, run: Run) -> list[Series]:
    """NEES of velocity and tilt over the lift."""
    t_s, value = nees(recording, sync, run)
    if t_s.size == 0:
        return []
    low, high = NEES_BAND
    return [
        Series(
            name="ekf.nees",
            title="NEES of velocity and tilt",
            x_unit="s",
            y_unit="1",
            x=t_s,
            y=value,
            y_log=True,
            limits=(
                LimitLine(high, f"97.5 %, {high:g}"),
                LimitLine(low, f"2.5 %, {low:g}", "below"),
            ),
            clock="bench",
            x_label="time since the lift began",
            y_label="error squared over its variance",
            caption="Velocity and tilt, five degrees of freedom, by the host's core with its full "
            "covariance. Between the lines lie 95 % of an estimator that is as sure as it may be; "
            "above, it is too sure. A chip's errors are drawn once per run, so one run is one "
            "draw, and no verdict is taken from it.",
        )
    ]


def parity(run: Run, sync: Sync) -> list[Series]:
    """Relative difference of every state between core and reference, step by step."""
    repeated = repeat(run)
    if not repeated.comparable:
        return []
    limit = line("K3").limits(sync.conditions).high
    t_s = repeated.reference["t_ticks"].astype(np.float64) / TICK_RATE_HZ
    begins = np.arange(0, t_s.size, PARITY_STEPS)
    return [
        Series(
            name=f"ekf.parity_{state}",
            title=title,
            x_unit="s",
            y_unit="1",
            x=t_s[begins],
            y=np.maximum.reduceat(state_errors(repeated.double, repeated.reference, state), begins),
            y_log=True,
            limits=(LimitLine(limit, f"{limit:g}, K3"),) if limit else (),
            clock="leader",
            y_label="relative difference",
            plot="ekf.parity",
            plot_title="Core against the NumPy reference, state by state",
            check="ekf.reference_error",
            caption=f"Core in double and reference over the run's first {t_s.size} steps, the same "
            f"samples in both, relative to each state's scale, the largest of {PARITY_STEPS} "
            "steps each; where there is no difference at all nothing is drawn. The firmware's own "
            "arithmetic is float32: ekf.core_mismatches compares "
            "its frames with the host's core bit by bit.",
        )
        for state, title in STATES.items()
    ]
