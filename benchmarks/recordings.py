# SPDX-License-Identifier: Apache-2.0
"""The recordings that are measured: synthetic runs of two nodes, kept in ``build/bench``."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parents[1] / "build" / "bench"


def minutes(duration: int) -> Path:
    """A recording of so many minutes; made when it is not there."""
    from hil.synthesis import Plan, save, synthesise

    path = FOLDER / f"minutes-{duration}.mcap"
    if not path.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part.mcap")
        part.unlink(missing_ok=True)
        save(synthesise(Plan(duration_s=60.0 * duration)), part)
        part.rename(path)
    return path
