# SPDX-License-Identifier: Apache-2.0
"""Every tracker on every case, in several processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed

from hil.compare.cases import Spec, make
from hil.compare.methods import METHODS, need_extras
from hil.compare.score import Row, score
from hil.process.pool import pool


def run_one(spec: Spec) -> list[Row]:
    """Every tracker on one case."""
    case = make(spec)
    tracks = [(name, method(case)) for name, method in METHODS.items()]
    return [score(case, name, track) for name, track in tracks if track is not None]


def run_all(
    specs: Sequence[Spec],
    jobs: int | None = None,
    progress: Callable[[float, str], None] = lambda share, what: None,
) -> list[Row]:
    """Rows in the order of ``specs``.

    Raises:
        HilError: a case cannot be had, or a package is missing.
    """
    need_extras()
    if len(specs) == 1 or jobs == 1:
        found = {}
        for k, spec in enumerate(specs):
            progress(k / len(specs), spec.title)
            found[spec] = run_one(spec)
    else:
        found = {}
        with pool(jobs) as workers:
            waiting = {workers.submit(run_one, spec): spec for spec in specs}
            for done in as_completed(waiting):
                found[waiting[done]] = done.result()
                progress(len(found) / len(specs), waiting[done].title)
    return [row for spec in specs for row in found[spec]]
