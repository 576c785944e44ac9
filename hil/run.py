# SPDX-License-Identifier: Apache-2.0
"""Run a scenario live. The one place that knows which board name means which backend."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from hil import scenario
from hil.backends import Backend, Progress
from hil.bench import BENCH_FILE
from hil.errors import RigError
from hil.faults import Injection
from hil.faults.injection import limited
from hil.recording import Recording


@dataclass(frozen=True)
class BenchOptions:
    """What a run on the bench takes beside its scenario.

    Attributes:
        file: the bench file.
        images: folder of images built before; built for the run when None.
        lock_wait_s: how long another run's end is waited for.
    """

    file: Path = BENCH_FILE
    images: Path | None = None
    lock_wait_s: float = 0.0


def backend(
    board: str, workspace: Path | None, bench: BenchOptions | None = None, *, speed: float = 0.0
) -> Backend:
    """The backend called ``board``.

    Args:
        speed: of a simulation, at most so many times real time; 0 for as fast as it goes.

    Raises:
        RigError: there is no such backend here, or boards are to be slowed down.
        BuildError: there is no image in the folder given.
    """
    if board == "sim":
        from hil.backends.sim import SimBackend  # noqa: PLC0415 (needs the build extra)

        return SimBackend(workspace=workspace, speed=speed)
    if speed:
        raise RigError(
            "only a simulation can be held to a pace: boards run in real time",
            "leave --speed out, or run with --board=sim",
        )
    if board == "bench":
        from hil.backends.bench import BenchBackend  # noqa: PLC0415 (hardware)
        from hil.bench import prepared  # noqa: PLC0415

        options = bench or BenchOptions()
        images = None if options.images is None else prepared.images(options.images)
        return BenchBackend(options.file, workspace, images, lock_wait_s=options.lock_wait_s)
    raise RigError(
        f"no backend for --board={board}",
        "--board=sim runs the firmware on the simulated radio, --board=bench on two boards",
    )


def live(
    board: str,
    scenario_path: Path,
    workspace: Path | None,
    output: Path,
    progress: Progress,
    *,
    bench: BenchOptions | None = None,
    inject: tuple[Injection, ...] = (),
    speed: float = 0.0,
) -> Recording:
    """Build what is needed, run the scenario, write and return the recording.

    Args:
        inject: faults, beside those of the scenario.
        speed: as :func:`backend`.

    Raises:
        ScenarioError: the scenario file is wrong.
        BuildError: the firmware could not be built.
        RigError: the rig failed during the run.
    """
    plan = scenario.load(scenario_path)
    plan = replace(plan, inject=limited((*plan.inject, *inject)))
    output.parent.mkdir(parents=True, exist_ok=True)
    return backend(board, workspace, bench, speed=speed).run(plan, output, progress)
