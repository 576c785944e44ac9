# SPDX-License-Identifier: Apache-2.0
"""A comparison with a reference for the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from hil.truth.reference import Reference
from hil.truth.score import Comparison


def render(reference: Reference, found: Comparison, console: Console) -> None:
    """Alignment, errors, repetitions, suggestions."""
    a = found.alignment
    down = ", counts downwards" if a.sign < 0 else ""
    gaps = f", {reference.gaps} rows without a value" if reference.gaps else ""
    lines = (
        f"reference: {reference.quantity}, {reference.read_as}, {len(reference.t_s)} samples"
        f"{gaps}{down}",
        f"clock: leader = reference {a.offset_s:+.4f} s ± {1e3 * a.offset_sigma_s:.2f} ms at "
        f"{a.t_mid_s:.3f} s, skew {1e6 * a.skew:+.1f} ± {1e6 * a.skew_sigma:.1f} ppm "
        f"(correlation {a.correlation:.3f})",
        f"vertical velocity, estimate less reference: RMSE {1e3 * found.rmse_mps:.1f} mm/s, "
        f"bias {1e3 * found.bias_mps:+.1f} mm/s, 95 % within {1e3 * found.p95_mps:.1f} mm/s",
    )
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)
    console.print(_table(found))
    if found.missed or found.invented:
        console.print(
            f"only in the reference: {len(found.missed)}, only in the estimate: "
            f"{len(found.invented)}"
        )
    for one in found.suggestions or ("nothing in the errors justifies other parameters",):
        console.print(f"- {one}", highlight=False, soft_wrap=True)


def _table(found: Comparison) -> Table:
    shown = Table(title="Repetitions", title_justify="left")
    for heading in (
        *("begins, s", "mean, m/s", "reference", "mm/s"),
        *("peak, m/s", "reference", "mm/s", "travel, m", "reference"),
    ):
        shown.add_column(heading, justify="right")
    for theirs, ours in found.pairs:
        shown.add_row(
            f"{ours.t_start_s:.2f}",
            f"{ours.mean_mps:.3f}",
            f"{theirs.mean_mps:.3f}",
            f"{1e3 * (ours.mean_mps - theirs.mean_mps):+.1f}",
            f"{ours.peak_mps:.3f}",
            f"{theirs.peak_mps:.3f}",
            f"{1e3 * (ours.peak_mps - theirs.peak_mps):+.1f}",
            f"{ours.travel_m:.3f}",
            f"{theirs.travel_m:.3f}",
        )
    return shown
