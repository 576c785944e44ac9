# SPDX-License-Identifier: Apache-2.0
"""The error budget as tables: what each line allows beside what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

_GRAVEST_FIRST = ("fail", "inconclusive", "marginal", "pass", "unset")

Row = dict[str, Any]


def anchor(run_id: str, line_id: str) -> str:
    """Where the line stands in a run's table."""
    return f"{run_id}/budget/{line_id}"


def of_run(lines: Sequence[Mapping[str, Any]], run_id: str, rows: Sequence[Row]) -> list[Row]:
    """The lines that the run's checks cite, each with them, the gravest first."""
    found = []
    for line in lines:
        mine = _ranked([row for row in rows if row["budget"] == line["id"]])
        if mine:
            found.append(
                {
                    "id": line["id"],
                    "quantity": line["quantity"],
                    "anchor": anchor(run_id, line["id"]),
                    "first": mine[0],
                    "others": mine[1:],
                    "verdict": mine[0]["verdict"],
                }
            )
    return found


def of_all(lines: Sequence[Mapping[str, Any]], runs: Sequence[Row]) -> list[Row]:
    """Each line with the measurement that came closest to its limit, of all runs.

    Runs that were made to fail are counted and do not compete, unless there are no others.
    """
    found = []
    for line in lines:
        cited = [(run, row) for run in runs for row in run["rows"] if row["budget"] == line["id"]]
        sound = [(run, row) for run, row in cited if not run["entry"]["expect_fail"]]
        closest = _ranked([{**row, "run": run} for run, row in sound or cited])
        tally = {v: sum(row["verdict"] == v for _, row in cited) for v in _GRAVEST_FIRST}
        found.append(
            {
                **line,
                "closest": closest[0] if closest else None,
                "tally": [(v, n) for v, n in tally.items() if n],
                "runs": len({run["id"] for run, _ in cited}),
            }
        )
    return found


def _ranked(rows: Sequence[Row]) -> list[Row]:
    return sorted(
        rows,
        key=lambda row: (
            _GRAVEST_FIRST.index(row["verdict"]),
            -(-1.0 if row["used"] is None else row["used"]),
        ),
    )
