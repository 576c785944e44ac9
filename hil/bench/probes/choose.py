# SPDX-License-Identifier: Apache-2.0
"""Which program drives the probes: the one that the bench file names, else the first ready one."""

from __future__ import annotations

from collections.abc import Sequence

from hil.bench.errors import NoRunnerError
from hil.bench.inventory import RUNNERS
from hil.bench.probes.jlink import JlinkRunner
from hil.bench.probes.model import Runner
from hil.bench.probes.nrfjprog import NrfjprogRunner
from hil.bench.probes.nrfutil import NrfutilRunner
from hil.bench.probes.openocd import OpenocdRunner
from hil.bench.probes.pyocd import PyocdRunner


def runners() -> list[Runner]:
    """All of them, in the order in which they are tried."""
    made: list[Runner] = [
        NrfutilRunner(),
        NrfjprogRunner(),
        JlinkRunner(),
        OpenocdRunner(),
        PyocdRunner(),
    ]
    return sorted(made, key=lambda runner: RUNNERS.index(runner.name))


def choose(named: str = "", candidates: Sequence[Runner] | None = None) -> Runner:
    """The runner called ``named``, or the first that is ready.

    Raises:
        NoRunnerError: the named one is not ready, or none is; says why of each.
    """
    tried = []
    for runner in runners() if candidates is None else candidates:
        if named and runner.name != named:
            continue
        found = runner.readiness()
        if found.ready:
            return runner
        tried.append((runner.name, found))
    if named:
        problem = tried[0][1] if tried else None
        raise NoRunnerError(
            f"the bench file asks for '{named}', but "
            + (problem.problem if problem else "there is no such runner"),
            (f"{problem.mend}\n" if problem else "")
            + "or leave the line 'runner' out of the bench file, to take the first that is ready",
        )
    raise NoRunnerError(
        "no program that can drive a debug probe is ready:\n"
        + "\n".join(f"    {name}: {found.problem}" for name, found in tried),
        "the quickest to install: apt-get install openocd\n"
        "Nordic's own: nrfutil from nordicsemi.com, then: nrfutil install device",
    )
