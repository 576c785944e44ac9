# SPDX-License-Identifier: Apache-2.0
"""A comparison with a reference as CSV and JSON: one row per repetition."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from typing import Any, Final

from hil.motion.repetitions import Concentric
from hil.truth.score import Comparison

COLUMNS: Final = (
    *("seen_by", "t_start_s_leader"),
    *("mean_mps", "mean_reference_mps", "mean_error_mps"),
    *("peak_mps", "peak_reference_mps", "peak_error_mps"),
    *("travel_m", "travel_reference_m"),
)
"""``seen_by`` is both, reference or estimate; what only one has seen is empty of the other."""


def rows(found: Comparison) -> Iterator[dict[str, Any]]:
    """One mapping per concentric phase, by the names of :data:`COLUMNS`, in order of time."""
    both: list[tuple[str, Concentric | None, Concentric | None]] = [
        *(("both", ours, theirs) for theirs, ours in found.pairs),
        *(("reference", None, theirs) for theirs in found.missed),
        *(("estimate", ours, None) for ours in found.invented),
    ]
    for seen_by, ours, theirs in sorted(
        both, key=lambda row: next(p.t_start_s for p in row[1:] if p is not None)
    ):
        first = ours or theirs
        assert first is not None
        row: dict[str, Any] = {"seen_by": seen_by, "t_start_s_leader": round(first.t_start_s, 3)}
        for name, column in (("mean_mps", "mean"), ("peak_mps", "peak"), ("travel_m", "travel")):
            a, b = (None if p is None else float(getattr(p, name)) for p in (ours, theirs))
            unit = name.rpartition("_")[2]
            row[name] = _rounded(a)
            row[f"{column}_reference_{unit}"] = _rounded(b)
            if unit == "mps":
                error = None if a is None or b is None else a - b
                row[f"{column}_error_mps"] = _rounded(error)
        yield {name: row[name] for name in COLUMNS}


def as_csv(found: Comparison) -> str:
    """One line per repetition below one of names."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows(found))
    return text.getvalue()


def as_json(found: Comparison) -> str:
    """Alignment with its standard deviations, errors, repetitions and suggestions."""
    document = {
        "alignment": dict(vars(found.alignment)),
        "velocity": {
            "rmse_mps": found.rmse_mps,
            "bias_mps": found.bias_mps,
            "p95_mps": found.p95_mps,
        },
        "repetitions": list(rows(found)),
        "suggestions": list(found.suggestions),
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
