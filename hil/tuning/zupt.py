# SPDX-License-Identifier: Apache-2.0
"""Thresholds of the ZUPT detector over recordings: counted, proposed, and tried on other lifts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil import library
from hil.core import TICKS_PER_S
from hil.errors import RecordingError
from hil.fusion.inputs import runs
from hil.motion.bar import Bar, at_point
from hil.motion.lifts import Lift, seeded_set
from hil.parity import batch, run_core
from hil.recording import load
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.reference.study import STILL_SPEED_MPS, simulate
from hil.tuning import case, kept
from hil.tuning.case import Case
from hil.tuning.grid import Grid, KnownMotion, Table, around, count
from hil.tuning.plateau import Plateau, plateau
from hil.tuning.statistics import statistics
from hil.tuning.workers import locally, workers

SEEN_S: Final = 0.15
"""A rest is held to be detectable when it lasts so much longer than window and dwell together."""
UNSEEN_SEED: Final = 5000
"""First of the seeded sets that a proposal is tried on; recordings and studies use lower ones."""


@dataclass(frozen=True, eq=False)
class Tuning:
    """Counts of every run, and what they propose.

    Attributes:
        names: of the runs, one for each of ``tables``.
        now: thresholds of the first run's image, (m/s^2)^2 and (rad/s)^2.
        plateau: None where no cell is acceptable.
        params: of the first run.
    """

    grid: Grid
    names: Sequence[str]
    tables: Sequence[Table]
    now: tuple[float, float]
    plateau: Plateau | None
    params: Params

    @property
    def proposal(self) -> tuple[float, float] | None:
        """``zupt_accel_var`` and ``zupt_gyro_var`` to take."""
        if self.plateau is None:
            return None
        return (
            float(self.grid.accel_var[self.plateau.row]),
            float(self.grid.gyro_var[self.plateau.column]),
        )


@dataclass(frozen=True)
class Trial:
    """Thresholds on one set that they were not chosen on: all of the estimator, gates and all.

    Attributes:
        rests: true rests long enough to be seen; ``missed``: those without an accepted update.
        false_zupt: steps with an accepted update while either sensor truly moved.
    """

    name: str
    seed: int
    rests: int
    missed: int
    false_zupt: int

    @property
    def passed(self) -> bool:
        return self.missed == 0 and self.false_zupt == 0


def tune(
    paths: Sequence[Path],
    grid: Grid | None = None,
    folder: Path | None = None,
    jobs: int = 2,
    scheduler: str | None = None,
) -> Tuning:
    """Count over recordings and propose.

    Args:
        grid: around the first image's thresholds if left out.
        folder: where counts of each recording are kept for the next time; nowhere if left out.
        scheduler: address of a Dask cluster that counts in place of this machine.

    Raises:
        RecordingError: a recording has no batches of the leader's IMU.
        ParameterError: an image has the SHOE detector.
        RigError: the cluster cannot be had.
    """
    if not paths:
        raise RecordingError("no recording to tune on", "name one or more")
    files = [library.resolve(path) for path in paths]
    params = _params(files[0])
    grid = grid or around(params.zupt_accel_var, params.zupt_gyro_var)
    found = _tables(files, grid, folder, jobs, scheduler)
    names = [
        f"{file.parent.name}{f', start {k + 1}' if len(tables) > 1 else ''}"
        for file, tables in zip(files, found, strict=True)
        for k in range(len(tables))
    ]
    return proposed(grid, names, [t for tables in found for t in tables], params)


def _tables(
    files: Sequence[Path], grid: Grid, folder: Path | None, jobs: int, scheduler: str | None
) -> list[list[Table]]:
    """Of each file, from ``folder`` where they are kept; one by one they are kept there."""
    one = partial(tables_of, grid=grid, folder=folder)
    if scheduler is None:
        return list(locally(jobs, one, files))
    inputs = [kept.of_file(file, grid) for file in files]
    found = [None if folder is None else kept.read_tables(folder, key, grid) for key in inputs]
    missing = [k for k, tables in enumerate(found) if tables is None]
    if not missing:
        return [tables or [] for tables in found]
    with workers(scheduler=scheduler) as cluster:
        cluster.share(list(locally(jobs, case.of_recording, [files[k] for k in missing])))
        tasks = [(n, grid) for n in range(len(missing))]
        for k, tables in zip(missing, cluster.map(_counted, tasks), strict=True):
            found[k] = tables
            if folder is not None:
                kept.write_tables(folder, inputs[k], tables)
    return [tables or [] for tables in found]


def _counted(cases: Sequence[Case], grid: Grid) -> list[Table]:
    return [table_of(one, grid) for one in cases]


def thresholds_of(file: Path) -> tuple[float, float]:
    """``zupt_accel_var`` and ``zupt_gyro_var`` of the image that made a recording."""
    params = _params(file)
    return params.zupt_accel_var, params.zupt_gyro_var


def _params(file: Path) -> Params:
    found = runs(load(file))
    if not found:
        raise case.nothing(file)
    return found[0].params


def proposed(grid: Grid, names: Sequence[str], tables: Sequence[Table], params: Params) -> Tuning:
    """Tables with the plateau that they have in common."""
    now = (params.zupt_accel_var, params.zupt_gyro_var)
    return Tuning(grid, names, tables, now, plateau(grid, tables), params)


def tables_of(file: Path, grid: Grid, folder: Path | None = None) -> list[Table]:
    """Counts of every start in one recording, kept ones where they are of the same inputs."""
    inputs = kept.of_file(file, grid)
    if folder is not None:
        before = kept.read_tables(folder, inputs, grid)
        if before is not None:
            return before
    tables = _counted(case.of_recording(file), grid)
    if folder is not None:
        kept.write_tables(folder, inputs, tables)
    return tables


def table_of(one: Case, grid: Grid) -> Table:
    """Counts of one start; against the truth, where it is known."""
    s = statistics(one.run)
    known = None
    if one.known is not None:
        t_s = one.known.t_s(s.outputs["t_ticks"])
        known = known_motion(one.known.lift, t_s, one.run.params)
    return count(s, grid, known)


def known_motion(lift: Lift, t_s: NDArray[np.float64], params: Params) -> KnownMotion:
    """What a lift truly does at times since its beginning; nothing is claimed outside of it."""
    inside = (t_s >= 0.0) & (t_s <= lift.duration_s)
    motion = lift.trajectory(np.clip(t_s, 0.0, lift.duration_s))
    ends = [at_point(motion, mount).velocity_mps for mount in Bar().mounts.values()]
    speed = np.max([np.linalg.norm(v, axis=1) for v in ends], axis=0)
    least_s = (params.zupt_window + params.zupt_dwell) / params.rate_hz + SEEN_S
    rests = []
    for begin_s, end_s in lift.still_spans_s:
        first, end = np.searchsorted(t_s, [begin_s, end_s]).tolist()
        if end - first > 1 and t_s[end - 1] - t_s[first] > least_s:
            rests.append((first, end))
    return KnownMotion(inside & (speed > STILL_SPEED_MPS), rests)


def trial(seed: int, thresholds: tuple[float, float], params: Params, rests: bool) -> Trial:
    """One seeded set through the core with ``thresholds``."""
    lift = seeded_set(seed, rests)
    p = replace(
        Params(),
        **{
            name: getattr(params, name)
            for name in ("zupt_window", "zupt_dwell", "zupt_release", "zupt_level_mps2")
        },
        zupt_accel_var=thresholds[0],
        zupt_gyro_var=thresholds[1],
    )
    outputs = run_core(batch(*simulate(lift, seed)), p)
    known = known_motion(lift, outputs["t_ticks"] / TICKS_PER_S, p)
    zupt = (outputs["flags"] & int(Flag.ZUPT)) != 0
    return Trial(
        lift.name,
        seed,
        len(known.rests),
        sum(not zupt[first:end].any() for first, end in known.rests),
        int(np.sum(zupt & known.moving)),
    )


def trials(
    thresholds: tuple[float, float], params: Params, sets: int, jobs: int = 2
) -> list[Trial]:
    """``sets`` sets of each kind that nothing was chosen on."""
    seeds = [UNSEEN_SEED + k for k in range(sets)]
    one = partial(_trial, thresholds=thresholds, params=params)
    return list(locally(jobs, one, [(seed, rests) for seed in seeds for rests in (False, True)]))


def _trial(which: tuple[int, bool], thresholds: tuple[float, float], params: Params) -> Trial:
    return trial(which[0], thresholds, params, which[1])
