# SPDX-License-Identifier: Apache-2.0
"""What a figure shows: panels of traces over the leader's clock, spans, and where from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import printable
from hil.exchange.contents import STATE, VARIANCE, contents
from hil.exchange.table import Contents, ExchangeError, Table
from hil.recording import Recording
from hil.reference.estimator import Flag
from hil.reps.trace import GAP_MAX_S
from hil.tuning.rerun import zupt_spans_s
from hil.wire.messages import TICK_RATE_HZ

Float = NDArray[np.float64]
Span = tuple[float, float]

WHATS: Final = ("velocity", "imu", "state", "zupt")
LABELS: Final = {
    "sim": "SIMULATION",
    "bench": "BENCH",
    "synthetic": "SYNTHETIC",
    "import": "IMPORTED",
}
FLAGS: Final = {
    Flag.STILL: "still",
    Flag.ZUPT: "zero velocity",
    Flag.ZUPT_GATED: "…refused",
    Flag.GRAVITY: "gravity",
    Flag.RIGID: "rigid body",
    Flag.RIGID_GATED: "…refused",
    Flag.ROUND_TRIP: "round trip",
    Flag.ROUND_TRIP_GATED: "…refused",
    Flag.IMPACT: "impact",
    Flag.CLIPPED: "clipped",
    Flag.FOLLOWER_LOST: "follower lost",
}
"""Flags of a step that are drawn as rows, from above."""
_TITLES: Final = ("Position", "Velocity", "Attitude", "Accelerometer bias", "Gyroscope bias")


@dataclass(frozen=True, eq=False)
class Trace:
    """One curve: ``t_s`` and ``y`` float64[n], NaN where there is a gap; ``sigma`` or None."""

    label: str
    t_s: Float
    y: Float
    sigma: Float | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with traces of one unit. ``rows``: names of the rows of a panel of spans, from above."""

    title: str
    unit: str
    traces: Sequence[Trace]
    rows: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Figure:
    """What is drawn.

    Attributes:
        label: in capitals, what kind of source: never left out.
        name: of the recording.
        note: build ids, estimator, and when it was recorded.
        panels: rows of panels side by side, all over the same times.
        still: spans of zero-velocity updates, s; repetitions: start and end of each.
        span_s: first and last time drawn.
    """

    label: str
    name: str
    note: str
    panels: Sequence[Sequence[Panel]]
    still: Sequence[Span]
    repetitions: Sequence[Span]
    span_s: Span


def figure(recording: Recording, what: Sequence[str] = WHATS) -> Figure:
    """The figure of a recording.

    Args:
        what: of :data:`WHATS`, drawn in this order.

    Raises:
        ExchangeError: there is nothing of it in the recording.
    """
    found = contents(recording)
    makers = {"velocity": _velocity, "imu": _imu, "state": _state, "zupt": _zupt}
    panels = [row for one in dict.fromkeys(what) for row in makers[one](found)]
    if not panels:
        raise ExchangeError(
            f"{recording.name}: nothing to draw of {', '.join(what)}; its estimator's output: "
            f"{found.provenance['estimator']}",
            "draw something else: --what " + ",".join(WHATS),
        )
    times = [t.t_s[np.isfinite(t.t_s)] for row in panels for p in row for t in p.traces]
    ends = [(float(t[0]), float(t[-1])) for t in times if t.size]
    known = found.provenance
    builds = ", ".join(f"{role} {build}" for role, build in known["build_ids"].items())
    repetitions = found.tables.get("repetitions")
    return Figure(
        LABELS[known["source"]],
        printable(recording.name),
        printable(
            f"{known['source_label']} · build ids: {builds or 'none: no firmware ran'} · "
            f"estimate: {known['estimator']} · recorded {known['created_utc']}"
        ),
        panels,
        _still(found.tables.get("ekf")),
        []
        if repetitions is None
        else list(
            zip(
                repetitions["t_start_s_leader"].tolist(),
                repetitions["t_end_s_leader"].tolist(),
                strict=True,
            )
        ),
        (min(a for a, _ in ends), max(b for _, b in ends)) if ends else (0.0, 1.0),
    )


def _still(ekf: Table | None) -> list[Span]:
    if ekf is None:
        return []
    ticks = np.rint(ekf["t_leader_s"] * TICK_RATE_HZ).astype(np.int64)
    outputs: NDArray[np.void] = np.zeros(len(ekf), [("flags", "i8"), ("t_ticks", "i8")])
    outputs["flags"], outputs["t_ticks"] = ekf["flags"], ticks
    return zupt_spans_s(outputs)


def trace(label: str, t_s: Float, y: Float, sigma: Float | None = None) -> Trace:
    """A trace in order of time, without rows of unknown time, and broken where time jumps."""
    known = np.isfinite(t_s)
    order = np.argsort(t_s[known], kind="stable")
    t, v = t_s[known][order], y[known][order]
    s = None if sigma is None else sigma[known][order]
    jumps = np.flatnonzero(np.diff(t) > GAP_MAX_S) + 1
    if jumps.size:
        # The hole is at the time before, so that times stay ascending.
        v = np.insert(v, jumps, np.nan)
        s = None if s is None else np.insert(s, jumps, np.nan)
        t = np.insert(t, jumps, t[jumps - 1])
    return Trace(label, t, v, s)


def _velocity(found: Contents) -> list[list[Panel]]:
    ekf = found.tables.get("ekf")
    if ekf is None:
        return []
    t = ekf["t_leader_s"]
    ends = [
        trace(
            axis,
            t,
            ekf[f"velocity_{axis}_mps"],
            np.sqrt(np.maximum(ekf[f"variance_velocity_{axis}_m2ps2"], 0.0)),
        )
        for axis in "xyz"
    ]
    centre = trace("centre", t, ekf["centre_velocity_z_mps"])
    height = trace("centre", t, ekf["centre_height_m"])
    return [
        [Panel("Vertical velocity of the bar's centre", "m/s", [centre])],
        [Panel("Velocity of the leader's end, ±1 σ", "m/s", ends)],
        [Panel("Height of the bar's centre", "m", [height])],
    ]


def _imu(found: Contents) -> list[list[Panel]]:
    rows = []
    for role in ("leader", "follower"):
        table = found.tables.get(f"imu_{role}")
        if table is None or not np.isfinite(table["t_leader_s"]).any():
            continue
        t = table["t_leader_s"]
        for title, name, unit in (
            ("angular rate", "gyro_{}_radps", "rad/s"),
            ("specific force", "accel_{}_mps2", "m/s²"),
        ):
            traces = [trace(axis, t, table[name.format(axis)]) for axis in "xyz"]
            rows.append([Panel(f"{role.capitalize()}: {title}", unit, traces)])
    return rows


def _state(found: Contents) -> list[list[Panel]]:
    """The 16 states, each with the square root of its variance."""
    ekf = found.tables.get("ekf")
    if ekf is None:
        return []
    rows = []
    for n, ((_, name, axes, unit, _), title) in enumerate(zip(STATE, _TITLES, strict=True)):
        variance = VARIANCE[n][0]
        sigmas = (
            quaternion_sigma(ekf)
            if axes == "wxyz"
            else [np.sqrt(np.maximum(ekf[variance.format(axis)], 0.0)) for axis in axes]
        )
        rows.append(
            [
                Panel(
                    f"{title} {axis}, ±1 σ",
                    unit.replace("^2", "²").removesuffix("1"),
                    [trace(axis, ekf["t_leader_s"], ekf[name.format(axis)], sigma)],
                )
                for axis, sigma in zip(axes, sigmas, strict=True)
            ]
        )
    return rows


def quaternion_sigma(ekf: Table) -> list[Float]:
    """Standard deviations of w, x, y, z from those of the small turn in the world frame.

    q_true = Exp(dtheta) q, so dq = (0, dtheta / 2) q to first order; variances only, as the frame
    has no more of the covariance (docs/estimator.md, section 1).
    """
    w, x, y, z = (ekf[f"quaternion_{axis}"] for axis in "wxyz")
    a, b, c = (np.maximum(ekf[f"variance_attitude_{axis}_rad2"], 0.0) for axis in "xyz")
    return [
        0.5 * np.sqrt(p * p * a + q * q * b + r * r * c)
        for p, q, r in ((x, y, z), (w, z, y), (z, w, x), (y, x, w))
    ]


def _zupt(found: Contents) -> list[list[Panel]]:
    """Which updates ran, row by row."""
    ekf = found.tables.get("ekf")
    if ekf is None:
        return []
    count = len(FLAGS)
    rows = []
    for k, (flag, label) in enumerate(FLAGS.items()):
        on = (ekf["flags"] & int(flag)) != 0
        rows.append(trace(label, ekf["t_leader_s"], np.where(on, float(count - 1 - k), np.nan)))
    return [[Panel("Updates and events, frame by frame", "", rows, tuple(FLAGS.values()))]]
