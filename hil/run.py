# SPDX-License-Identifier: Apache-2.0
"""Run a scenario live. The one place that knows which board name means which backend."""

from __future__ import annotations

from pathlib import Path

from hil import scenario
from hil.backends import Backend, Progress
from hil.errors import RigError
from hil.recording import Recording


def backend(board: str, workspace: Path | None) -> Backend:
    """The backend called ``board``.

    Raises:
        RigError: there is no such backend here.
    """
    if board == "sim":
        from hil.backends.sim import SimBackend  # noqa: PLC0415 (needs the build extra)

        return SimBackend(workspace=workspace)
    raise RigError(
        f"no backend for --board={board}",
        "--board=sim runs the firmware on the simulated radio",
    )


def live(
    board: str, scenario_path: Path, workspace: Path | None, output: Path, progress: Progress
) -> Recording:
    """Build what is needed, run the scenario, write and return the recording.

    Raises:
        ScenarioError: the scenario file is wrong.
        BuildError: the firmware could not be built.
        RigError: the rig failed during the run.
    """
    plan = scenario.load(scenario_path)
    output.parent.mkdir(parents=True, exist_ok=True)
    return backend(board, workspace).run(plan, output, progress)
