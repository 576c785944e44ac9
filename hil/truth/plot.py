# SPDX-License-Identifier: Apache-2.0
"""A comparison with a reference as a picture: both velocities, the error, the repetitions."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError
from hil.report import sheet
from hil.report.decimate import min_max
from hil.truth.align import GAP_S
from hil.truth.score import Comparison

POINTS: Final = 1500


def drawn(file: Path, title: str, found: Comparison) -> bytes:
    """The picture in the form that the file's name asks for.

    Raises:
        HilError: neither .svg nor .html.
    """
    if file.suffix not in (".svg", ".html"):
        raise HilError(f"no picture can be drawn as {file.name}", "name an .svg or .html file")
    drawing = sheet.svg(_figures(title, found))
    return (drawing if file.suffix == ".svg" else sheet.page(title, drawing)).encode("utf-8")


def _figures(title: str, found: Comparison) -> list[tuple[str, dict[str, Any]]]:
    t, ours = found.t_s, found.estimate_mps
    theirs = ours - found.error_mps
    means = [(p.t_start_s, 1e3 * (p.mean_mps - r.mean_mps)) for r, p in found.pairs]
    peaks = [(p.t_peak_s, 1e3 * (p.peak_mps - r.peak_mps)) for r, p in found.pairs]
    figures = [
        (
            f"{title}: estimate (blue) over reference (vermilion)",
            _figure("vertical velocity, m/s", [_trace(t, ours), _trace(t, theirs)]),
        ),
        (
            f"Estimate less reference: RMSE {1e3 * found.rmse_mps:.1f} mm/s",
            _figure("mm/s", [_trace(t, 1e3 * found.error_mps)]),
        ),
    ]
    if means:
        figures.append(
            (
                "Errors of repetitions, mm/s: mean (blue) and peak velocity (vermilion)",
                _figure("mm/s", [_steps(means), _steps(peaks)]),
            )
        )
    return figures


def _figure(label: str, traces: list[dict[str, Any]]) -> dict[str, Any]:
    zero = {"value": 0.0, "label": label, "side": "above"}
    return {
        "kind": "timeline",
        "xLog": False,
        "yLog": False,
        "xLabel": "leader's clock, s",
        "traces": traces,
        "limits": [zero],
    }


def _trace(t: NDArray[np.float64], y: NDArray[np.float64]) -> dict[str, Any]:
    """Thinned, with nothing drawn across a gap."""
    cuts = np.flatnonzero(np.diff(t) > GAP_S) + 1
    x, shown = min_max(np.insert(t, cuts, t[cuts]), np.insert(y, cuts, np.nan), POINTS)
    return {"x": x.tolist(), "y": [None if np.isnan(v) else v for v in shown.tolist()]}


def _steps(points: list[tuple[float, float]]) -> dict[str, Any]:
    return {"x": [x for x, _ in points], "y": [y for _, y in points]}
