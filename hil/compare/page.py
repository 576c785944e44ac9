# SPDX-License-Identifier: Apache-2.0
"""The committed league: ``python -m hil.compare.page [--check | --text]``.

Runs every tracker on every motion and on BROAD, and writes ``fixtures/league.json``,
``docs/league.svg`` and the marked regions of ``docs/estimators.md`` and ``README.md``. ``--text``
writes the last three from the first. ``--check`` compares them with it, and the figures of one case
with a run of today. Cost is a machine's own: it stands in the JSON with the machine's name and as
one table in the page, and is never compared.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from hil.atomic import write_whole
from hil.compare import machine, plot, show
from hil.compare.cases import TRIALS, Spec, motion_specs
from hil.compare.run import run_all
from hil.compare.score import Row, as_mapping, league
from hil.errors import HilError
from hil.progress import bar

ROOT: Final = Path(__file__).resolve().parents[2]
LEAGUE: Final = ROOT / "fixtures" / "league.json"
PICTURE: Final = ROOT / "docs" / "league.svg"
PAGE: Final = ROOT / "docs" / "estimators.md"
README: Final = ROOT / "README.md"
SEEDS: Final = 3
TRIED: Final = (Spec("sprint", "sprint_8.12", 1), Spec("motion", "still", 1))
"""What ``--check`` runs anew: seconds, not minutes."""
TOLERANCE: Final = 0.02
"""Relative: sums in another order, and packages that compute in float, on other machines."""
BEGIN, END = "<!-- league: begin -->", "<!-- league: end -->"


def specs(data: str) -> list[Spec]:
    """Every case of the committed league."""
    return [*motion_specs("all", SEEDS), *(Spec("broad", trial, 0, data) for trial in TRIALS)]


def full(rows: Sequence[Row], made_on: str) -> str:
    """The region of docs/estimators.md: a table for each case, places, cost."""
    tables = league(rows)
    parts = [
        f"{SEEDS} seeded sets of each motion, RMSE over all of them; BROAD's trials as they are. "
        "Missing values: no truth for it, or nothing found to measure.",
        *(f"### {case}\n\n{show.markdown(members)}" for case, members in tables.items()),
        "### Where ours is third or worse",
        "\n".join(f"* {line}" for line in show.behind(tables)) or "Nowhere.",
        "### Cost",
        f"Processor time a sample, median over all runs, on {made_on}. Ours, VQF and Fusion are "
        "compiled; the others are NumPy, written to be read.",
        _cost(show.cost(rows)),
    ]
    return "\n\n".join(parts)


def _cost(found: Mapping[str, float]) -> str:
    lines = ["| tracker | us a sample |", "|---|---|"]
    return "\n".join(
        lines
        + [f"| {name} | {value:.{1 if value < 10 else 0}f} |" for name, value in found.items()]
    )


def short(rows: Sequence[Row]) -> str:
    """The region of README.md: one line for each case."""
    return show.summary(league(rows))


def with_region(text: str, region: str, where: Path) -> str:
    """``text`` with what stands between its marks replaced.

    Raises:
        HilError: the marks are not there, once each and in order.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end or BEGIN in rest or END in after:
        raise HilError(f"{where}: no region for the league", f"put {BEGIN} and {END} on two lines")
    return f"{before}{BEGIN}\n\n{region}\n\n{END}{after}"


def texts(rows: Sequence[Row], made_on: str) -> dict[Path, str]:
    """What each file should be."""
    return {
        PAGE: with_region(PAGE.read_text(encoding="utf-8"), full(rows, made_on), PAGE),
        README: with_region(README.read_text(encoding="utf-8"), short(rows), README),
        PICTURE: plot.svg(league(rows)),
    }


def differences(kept: Sequence[Row], now: Sequence[Row]) -> list[str]:
    """What of today's rows is not as it was kept, but for cost."""
    found = []
    before = {(row.case, row.seed, row.method): as_mapping(row) for row in kept}
    for row in now:
        old = before.get((row.case, row.seed, row.method))
        new = as_mapping(row)
        name = f"{row.case}, seed {row.seed}, {row.method}"
        if old is None:
            found.append(f"{name}: not in the league")
            continue
        for key in sorted((old.keys() | new.keys()) - {"cost_us"}):
            a, b = old.get(key), new.get(key)
            same = a == b
            if isinstance(a, float) and isinstance(b, float):
                same = math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=1e-4)
            if not same:
                found.append(f"{name}: {key} was {a}, is {b}")
    return found


def check() -> int:
    """0 when all is as committed."""
    kept, made_on = show.read_json(LEAGUE)
    wrong = [
        f"{path} is not what {LEAGUE.name} says: python -m hil.compare.page --text"
        for path, text in texts(kept, made_on).items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]
    found = differences(kept, run_all(TRIED))
    if found:
        wrong += [*found[:8], "if that is meant: python -m hil.compare.page"]
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


def main(arguments: list[str] | None = None) -> int:
    """Write, or check; 0 when all is well."""
    parser = argparse.ArgumentParser(prog="python -m hil.compare.page", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, and fail on a difference")
    parser.add_argument("--text", action="store_true", help="write the texts from the JSON only")
    parser.add_argument("--data", default=os.environ.get("HIL_DATA", ""), metavar="FOLDER")
    parser.add_argument("--jobs", type=int, help="processes; all processors if left out")
    options = parser.parse_args(arguments)
    try:
        if options.check:
            return check()
        if not options.text:
            if not options.data:
                raise HilError("BROAD is part of the league", "give --data FOLDER, or set HIL_DATA")
            with bar("league") as progress:
                rows = run_all(specs(options.data), options.jobs, progress)
            write_whole(LEAGUE, show.as_json(rows, machine.name()).encode("utf-8"))
        for path, text in texts(*show.read_json(LEAGUE)).items():
            write_whole(path, text.encode("utf-8"))
    except HilError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
