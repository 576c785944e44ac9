# SPDX-License-Identifier: Apache-2.0
"""Thresholds of the ZUPT detector over recordings: counted, proposed, and tried on other lifts."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil import library, timesync
from hil.core import TICKS_PER_S
from hil.errors import RecordingError
from hil.fusion.inputs import Run, runs
from hil.fusion.truth import lift_of
from hil.motion.bar import Bar, at_point
from hil.motion.lifts import Lift, seeded_set
from hil.parity import batch, run_core
from hil.recording import Recording, load
from hil.reference.estimator import Flag
from hil.reference.params import Params
from hil.reference.study import STILL_SPEED_MPS, simulate
from hil.tuning import kept
from hil.tuning.grid import Grid, KnownMotion, Table, around, count
from hil.tuning.plateau import Plateau, plateau
from hil.tuning.statistics import statistics

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
    paths: Sequence[Path], grid: Grid | None = None, folder: Path | None = None, jobs: int = 2
) -> Tuning:
    """Count over recordings and propose.

    Args:
        grid: around the first image's thresholds if left out.
        folder: where counts of each recording are kept for the next time; nowhere if left out.

    Raises:
        RecordingError: a recording has no batches of the leader's IMU.
        ParameterError: an image has the SHOE detector.
    """
    if not paths:
        raise RecordingError("no recording to tune on", "name one or more")
    files = [library.resolve(path) for path in paths]
    params = _params(files[0])
    grid = grid or around(params.zupt_accel_var, params.zupt_gyro_var)
    one = partial(tables_of, grid=grid, folder=folder)
    if len(files) > 1 and jobs > 1:
        with ProcessPoolExecutor(min(jobs, len(files))) as pool:
            found = list(pool.map(one, files))
    else:
        found = [one(file) for file in files]
    names = [
        f"{file.parent.name}{f', start {k + 1}' if len(tables) > 1 else ''}"
        for file, tables in zip(files, found, strict=True)
        for k in range(len(tables))
    ]
    return proposed(grid, names, [t for tables in found for t in tables], params)


def thresholds_of(file: Path) -> tuple[float, float]:
    """``zupt_accel_var`` and ``zupt_gyro_var`` of the image that made a recording."""
    params = _params(file)
    return params.zupt_accel_var, params.zupt_gyro_var


def _params(file: Path) -> Params:
    found = runs(load(file))
    if not found:
        raise _nothing(file)
    return found[0].params


def proposed(grid: Grid, names: Sequence[str], tables: Sequence[Table], params: Params) -> Tuning:
    """Tables with the plateau that they have in common."""
    now = (params.zupt_accel_var, params.zupt_gyro_var)
    return Tuning(grid, names, tables, now, plateau(grid, tables), params)


def tables_of(file: Path, grid: Grid, folder: Path | None = None) -> list[Table]:
    """Counts of every start in one recording, kept ones where they are of the same inputs."""
    inputs = kept.digest(file, grid)
    if folder is not None:
        before = kept.read(folder, inputs, grid)
        if before is not None:
            return before
    recording = load(file)
    found = runs(recording)
    if not found:
        raise _nothing(file)
    tables = [table_of(run, grid, recording) for run in found]
    if folder is not None:
        kept.write(folder, inputs, tables)
    return tables


def table_of(run: Run, grid: Grid, recording: Recording | None = None) -> Table:
    """Counts of one start; with the truth, where the recording knows it."""
    s = statistics(run)
    lift = None if recording is None else lift_of(recording)
    known = None
    if recording is not None and lift is not None:
        sync = timesync.analyse(recording)
        if sync.truth:
            clock = sync.truth.clocks["leader"]
            t_ns = clock.true_ns(s.outputs["t_ticks"].astype(np.float64))
            known = known_motion(lift[0], t_ns / 1e9 - lift[1], run.params)
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
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [
            pool.submit(trial, seed, thresholds, params, rests)
            for seed in seeds
            for rests in (False, True)
        ]
        return [one.result() for one in waiting]


def _nothing(file: Path) -> RecordingError:
    return RecordingError(
        f"no IMU batch in the leader's stream of {file}: there is nothing to tune on",
        "record with an image that has the estimator: hil build",
    )
