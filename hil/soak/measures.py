# SPDX-License-Identifier: Apache-2.0
"""What a long run says of drifts and losses, as measurements and as series for the report."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.budget import judged
from hil.measure import Measurement
from hil.recording import Recording
from hil.series import LimitLine, Series
from hil.soak.figures import LOSSES_LINE, PARTS, Row, figures, is_long, part_edges_s
from hil.streams import conditions


def measure(recording: Recording) -> list[Measurement]:
    """One measurement for each track, and the losses; none of a recording that is not long."""
    if not is_long(recording):
        return []
    found = figures(recording)
    under = conditions(recording)
    lost = sum(found.losses.values())
    return [
        *(
            judged(
                f"soak.{row.track.name}_{row.track.unit.lower()}",
                None if row.trend is None else row.trend.significant,
                row.track.line,
                under,
                _how(row, found.duration_s),
                scale=row.track.scale,
                unit=row.track.unit,
                details=_details(row),
            )
            for row in found.rows
        ),
        judged(
            "soak.lost",
            lost,
            LOSSES_LINE,
            under,
            f"batches and messages that the nodes' counters say were dropped in "
            f"{found.duration_s / 3600:.2f} h, across resets of the counters",
            details=dict(found.losses),
        ),
    ]


def series(recording: Recording) -> list[Series]:
    """The statistic of each part of a long run."""
    if not is_long(recording):
        return []
    found = figures(recording)
    return [
        Series(
            name=f"soak.{row.track.name}",
            title=row.track.title,
            x_unit="s",
            y_unit=row.track.unit,
            x=_middle_s(row, found.duration_s),
            y=np.array(row.parts),
            kind="points",
            limits=_limits(row),
            clock="bench",
            y_label=row.track.title,
            check=f"soak.{row.track.name}_{row.track.unit.lower()}",
            caption=f"Each point is 1/{PARTS} of the run{_since(row)}; the trend is a line through "
            "them.",
        )
        for row in found.rows
    ]


def _middle_s(row: Row, duration_s: float) -> NDArray[np.float64]:
    edges_s = part_edges_s(row.track, duration_s)
    return np.asarray((edges_s[:-1] + edges_s[1:]) / 2, dtype=np.float64)


def _since(row: Row) -> str:
    return f" from {row.track.begin_s:.0f} s on" if row.track.begin_s else ""


def _limits(row: Row) -> tuple[LimitLine, ...]:
    """Where the last part would be after the largest change that is allowed."""
    if row.trend is None or row.track.grows is None:
        return ()
    first = row.parts[0]
    if row.track.grows:
        return (LimitLine(first + row.track.allowed, "first part and what is allowed"),)
    return (LimitLine(first - row.track.allowed, "first part less what is allowed", "below"),)


def _how(row: Row, duration_s: float) -> str:
    change = (
        "some are without a value, so no line was drawn"
        if row.trend is None
        else f"it changes by {row.trend.words} {row.track.unit}; "
        "0 when that interval of 95 % holds zero"
    )
    return (
        f"{row.track.title}: least squares through {PARTS} equal parts of "
        f"{duration_s / 3600:.2f} h{_since(row)}; {change}"
    )


def _details(row: Row) -> dict[str, object]:
    return {"hours": [float(f"{value:.6g}") for value in row.hours if np.isfinite(value)]}
