# SPDX-License-Identifier: Apache-2.0
"""The simulated bench as a source of recordings: real firmware on a simulated radio."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from hil import build
from hil.backends import Progress
from hil.build import BabbleSim, Manifest
from hil.errors import RigError, ScenarioError
from hil.faults import nodes, refuse_unless_possible
from hil.faults.apply import writer as injected_writer
from hil.process import scratch
from hil.recording import Event, Provenance, Recording, Writer, load
from hil.scenario import Scenario, to_mapping
from hil.simulator import Session
from hil.simulator.preload import store
from hil.soak.memory import rss_kib

RIG_EVERY_S = 60.0
"""Simulated seconds from one event about the rig's own memory to the next."""
BUILD_SHARE = 0.4
"""Share of the progress shown that building takes, when there is something to build."""


class SimBackend:
    """Builds the images that a scenario wants and runs them on BabbleSim.

    Args:
        workspace: as :func:`hil.build.find_workspace`.
        images: role -> manifest of images built for the simulated board; built when not given.
        stall_limit_s: real time without simulated progress after which a node counts as hung.
        speed: at most so many times as fast as real time; 0 for as fast as it goes.
    """

    source = "sim"

    def __init__(
        self,
        workspace: Path | None = None,
        images: Mapping[str, Manifest] | None = None,
        *,
        stall_limit_s: float = 30.0,
        speed: float = 0.0,
    ) -> None:
        self._workspace = workspace
        self._images = images
        self._stall_limit_s = stall_limit_s
        self._speed = speed

    def run(self, scenario: Scenario, output: Path, progress: Progress) -> Recording:
        """Run ``scenario`` to its end and return the recording, which is then at ``output``.

        What was recorded before a failure stays there, marked as aborted.

        Raises:
            BuildError: no workspace, no toolchain, no simulator, or the build failed.
            RigError: an image is not the one that was built, or a program of the simulation died
                or hung; the message names it.
            RecordingError: ``output`` exists or cannot be written.
            ScenarioError: a fault to inject cannot be made in this run.
        """
        refuse_unless_possible(scenario.inject, self.source)
        found = build.find_workspace(self._workspace)
        babblesim = build.find_babblesim(found)
        images = self._images or build.build_images(
            scenario.kconfig,
            "sim",
            self._workspace,
            lambda share, what: progress(BUILD_SHARE * share, what),
        )
        executables = {role: executable(image) for role, image in images.items()}
        with (
            injected_writer(output, provenance(scenario, images, babblesim)) as writer,
            calibrated(scenario, executables, babblesim) as flash,
            Session(
                *(babblesim, executables, scenario, self._stall_limit_s, flash), speed=self._speed
            ) as session,
        ):
            _record(session, scenario, writer, progress)
        return load(output)


@contextmanager
def calibrated(
    scenario: Scenario, executables: Mapping[str, Path], babblesim: BabbleSim
) -> Iterator[dict[str, Path]]:
    """The flash of each node that has a stored calibration."""
    roles = [role for role in executables if scenario.node(role).calibration]
    for role in executables:
        # A role must be named when one of the two has nothing stored.
        if nodes.flash_bits(scenario.inject, role) and role not in roles:
            raise ScenarioError(
                f"there is no calibration in the {role}'s flash whose bits could be turned over",
                f"name the other node, or add [nodes.{role}.calibration] to the scenario",
            )
    if not roles:
        yield {}
        return
    with scratch("flash") as folder:
        for role in roles:
            flash = folder / f"{role}.flash"
            store(babblesim, executables[role], scenario, role, flash)
            for number, one in enumerate(nodes.flash_bits(scenario.inject, role)):
                seed = (scenario.seed, one.seed, number, list(executables).index(role))
                nodes.turn_bits(flash, int(one.value), seed)
        yield {role: folder / f"{role}.flash" for role in roles}


def _record(session: Session, scenario: Scenario, writer: Writer, progress: Progress) -> None:
    start_s = time.monotonic()

    def pump() -> None:
        for node in session.nodes:
            for t_ns_bench, data in node.serial():
                writer.write_serial(node.role, t_ns_bench, data)
            for changes in node.changes():
                writer.write_edges(*changes)
            writer.write_imu_truth(node.role, *node.imu_truth())

    shown_s = 0.0
    told_s = -RIG_EVERY_S
    while session.wait():
        pump()
        if session.true_s - told_s >= RIG_EVERY_S:
            told_s = session.true_s
            rig = {"rss_kib": rss_kib(), "chunks": writer.chunks}
            writer.write_event(Event(round(told_s * 1e9), "rig", "", rig))
        now_s = time.monotonic()
        if now_s - shown_s > 0.2:
            shown_s = now_s
            share = min(session.true_s / scenario.duration_s, 1.0)
            speed = session.true_s / max(now_s - start_s, 1e-3)
            progress(
                BUILD_SHARE + (1 - BUILD_SHARE) * share,
                f"simulated {session.true_s:.1f} of {scenario.duration_s:g} s, "
                f"{speed:.1f} times as fast as real time",
            )
    pump()
    while not session.drained():
        pump()
    wall_s = round(time.monotonic() - start_s, 3)
    for drop in scenario.link_drops:
        writer.write_event(
            Event(round(drop.at_s * 1e9), "disconnect", "leader", {"hold_ms": drop.hold_ms})
        )
    end_ns = round(scenario.duration_s * 1e9)
    writer.write_event(Event(end_ns, "end", "", {"wall_s": wall_s}))
    progress(1.0, f"simulated {scenario.duration_s:g} s in {wall_s:.1f} s")


def executable(image: Manifest) -> Path:
    """The program of an image built for the simulated board.

    Raises:
        RigError: it is not the one that the manifest describes, so that the recording would
            be stamped with the wrong build.
    """
    if not image.is_intact("exe"):
        raise RigError(
            f"the {image.role} image at {image.file('exe')} is not the one that was built: "
            "it was changed or deleted",
            f"hil build --role {image.role} --target {image.target}",
        )
    return image.file("exe")


def provenance(
    scenario: Scenario, images: Mapping[str, Manifest], babblesim: BabbleSim
) -> Provenance:
    """Where this recording comes from: enough to repeat the run."""
    versions = sorted({image.zephyr_version for image in images.values()})
    return Provenance(
        source=SimBackend.source,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        scenario=to_mapping(scenario),
        manifests={role: image.to_mapping() for role, image in images.items()},
        tools={
            "hil": importlib.metadata.version("hil"),
            "Python": platform.python_version(),
            "Zephyr": ", ".join(versions),
            "BabbleSim 2G4 phy": babblesim.version(),
        },
        host={"system": platform.system(), "machine": platform.machine()},
        notes="Simulated radio, real firmware. The bench clock is true simulated time.",
    )
