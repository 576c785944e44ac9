# SPDX-License-Identifier: Apache-2.0
"""Two real boards as a source of recordings.

The bench clock is the host's monotonic clock, from just before the boards are reset. Serial bytes
carry it as they are; edges lie on the analyser's clock, whose start is known on the host's within
an uncertainty that the recording keeps in its event ``analyser``.
"""

from __future__ import annotations

import importlib.metadata
import math
import platform
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from hil import build
from hil.backends import Progress
from hil.bench import align, boot, inventory, lock, place, ports, prepared, trust
from hil.bench.analyser.find import PROGRAM
from hil.bench.analyser.uncertainty import bench_edges, period_ns
from hil.bench.applied import applied, sentence
from hil.bench.flash import BoardPair, Flashed
from hil.bench.inventory import Inventory
from hil.bench.port import Chunk, SerialPort
from hil.bench.probes.tool import first_line
from hil.bench.unfinished import attempt
from hil.bench.watch import SUFFIXES, analyser_of
from hil.build import Manifest
from hil.commands import planned
from hil.errors import RigError
from hil.faults import refuse_unless_possible
from hil.faults.apply import writer as injected_writer
from hil.recording import Event, Provenance, Recording, SerialStream, Writer, load
from hil.scenario import Scenario, to_mapping
from hil.wire.codec import decode, encode
from hil.wire.messages import ROLES

if TYPE_CHECKING:
    from hil.bench.analyser.capture import Analyser, CaptureEdges

BUILT: Final = 0.3
FLASHED: Final = 0.4
"""Progress shown when the images are built, and when the boards hold them."""
LEADER_PULSE: Final = "leader.pulse"
POLL_S: Final = 0.02
NS_PER_S: Final = 1_000_000_000
NOTES: Final = (
    "Two boards. The bench clock is the host's monotonic clock from just before the reset; edges "
    "are on the analyser's clock, put beside it as the event 'analyser' says."
)
EVENT_OF: Final = {"imu_setup": "imu_setup", "link_drop": "disconnect"}
"""Command -> kind of the event that says that it was sent."""


class BenchBackend:
    """Flashes two boards with the images that a scenario wants, runs and records them.

    Args:
        bench_file: which probe is which role, and what the analyser watches.
        workspace: as :func:`hil.build.find_workspace`.
        images: role -> manifest of images built for the DK; built when not given.
        lock_wait_s: how long another run's end is waited for.
    """

    source = "bench"

    def __init__(
        self,
        bench_file: Path,
        workspace: Path | None = None,
        images: Mapping[str, Manifest] | None = None,
        *,
        lock_wait_s: float = 0.0,
    ) -> None:
        self._bench_file = bench_file
        self._workspace = workspace
        self._images = images
        self._lock_wait_s = lock_wait_s

    def run(self, scenario: Scenario, output: Path, progress: Progress) -> Recording:
        """Run ``scenario`` to its end and return the recording, which is then at ``output``.

        What was recorded before a failure stays there, marked as aborted, and the analyser's
        capture beside it. A recording of an earlier run gives way once the bench is held: it may
        be the one that another run is still writing.

        Raises:
            BuildError: no workspace, no toolchain, the build failed, or the images given are not
                the ones that the scenario wants.
            RigError: the bench is in use; a probe, a port or the analyser failed or is not to be
                believed; a board is not what was flashed. The message says which.
            RecordingError: ``output`` cannot be written.
            ScenarioError: a fault to inject cannot be made on boards.
        """
        refuse_unless_possible(scenario.inject, self.source)
        bench = inventory.load(self._bench_file)
        plan, left_out = applied(scenario)
        with (
            lock.hold(
                bench.path, wait_s=self._lock_wait_s, waiting=lambda text: progress(0.0, text)
            ),
            place.acquired(bench.place),
            attempt(bench.path) as after_failure,
        ):
            output.unlink(missing_ok=True)
            pair = BoardPair(bench)
            images = self._ready(plan, progress)
            boards = pair.prepare(
                images,
                after_failure=after_failure,
                step=lambda role, what: progress(BUILT, f"{role}: {what}"),
            )
            _Run(bench, plan, left_out, pair, images, boards).record(output, progress)
        return load(output)

    def _ready(self, plan: Scenario, progress: Progress) -> Mapping[str, Manifest]:
        if self._images is not None:
            prepared.check_kconfig(self._images, plan)
            return self._images
        return build.build_images(
            plan.kconfig,
            "nrf52840dk",
            self._workspace,
            lambda share, what: progress(BUILT * share, what),
        )


@dataclass
class _Run:
    """One run, from boards that hold their images to a recording."""

    bench: Inventory
    plan: Scenario
    left_out: list[str]
    pair: BoardPair
    images: Mapping[str, Manifest]
    boards: Mapping[str, Flashed]
    _kept: dict[str, list[Chunk]] = field(default_factory=lambda: {role: [] for role in ROLES})
    """Role -> what it said, on the bench clock: the capture is held against it."""

    def record(self, output: Path, progress: Progress) -> None:
        with ExitStack() as stack:
            analyser = analyser_of(self.bench, self.plan.duration_s)
            archive = _archive(self.bench, output)
            if analyser is not None:
                stack.callback(analyser.close)
            writer = stack.enter_context(self._writer(output, analyser))
            start_ns_host = time.monotonic_ns()
            if analyser is not None:
                progress(FLASHED, "starting the analyser")
                analyser.start(archive)
            lines = {
                role: stack.enter_context(ports.open_board(board))
                for role, board in self.bench.boards.items()
            }
            progress(FLASHED, "starting the boards")
            zero_ns, boots = boot.restart(lines, self.pair.reset)
            ids = {role: int(board.device_id, 16) for role, board in self.boards.items()}
            boot.check(boots, self.images, ids)
            self._write_start(writer, start_ns_host - zero_ns, boots)
            for role, began in boots.items():
                for chunk in began.chunks:
                    self._keep(writer, role, chunk, zero_ns)
            end_ns = self._listen(writer, lines, zero_ns, progress)
            _refuse_gaps(writer, lines, zero_ns)
            if analyser is not None:
                progress(0.99, "reading the analyser")
                booted_ns = max(b.t_ns_host for b in boots.values()) - zero_ns
                self._write_edges(writer, analyser.stop(), zero_ns, booted_ns, end_ns)
            wall_s = round((time.monotonic_ns() - start_ns_host) / NS_PER_S, 3)
            writer.write_event(Event(end_ns, "end", "", {"wall_s": wall_s}))
        if archive is not None:
            # Its edges are in the recording; the samples are for finding out what went wrong.
            archive.unlink(missing_ok=True)
        progress(1.0, f"recorded {self.plan.duration_s:g} s of two boards")

    def _writer(self, output: Path, analyser: Analyser | None) -> Writer:
        return injected_writer(
            output,
            provenance(self.bench, self.plan, self.left_out, self.images, self.boards),
            edge_channels=() if analyser is None else analyser.channels,
            edge_resolution_ns=0.0 if analyser is None else period_ns(analyser.samplerate_hz),
        )

    def _write_start(self, writer: Writer, flash_ns: int, boots: Mapping[str, boot.Boot]) -> None:
        for role, board in self.boards.items():
            writer.write_event(Event(flash_ns, "flash", role, board.to_mapping()))
        for role, began in boots.items():
            # Not called a reset: those are within a run, and excuse a second HELLO at boot.
            data = {"reset": "system", "dropped_bytes": began.dropped_bytes}
            writer.write_event(Event(0, "start", role, data))
        if self.left_out:
            writer.write_event(Event(0, "not_applied", "", {"parts": self.left_out}))

    def _keep(self, writer: Writer, role: str, chunk: Chunk, zero_ns: int) -> None:
        t_ns_bench = chunk.t_ns_host - zero_ns
        writer.write_serial(role, t_ns_bench, chunk.data)
        self._kept[role].append(Chunk(t_ns_bench, chunk.data))

    def _listen(
        self, writer: Writer, lines: Mapping[str, SerialPort], zero_ns: int, progress: Progress
    ) -> int:
        """Record until the run has lasted; returns its end on the bench clock, ns."""
        due = sorted(
            ((c.at_s or 0.0, role, c) for role in lines for c in planned(self.plan, role)),
            key=lambda entry: entry[0],
        )
        duration_ns = round(self.plan.duration_s * NS_PER_S)
        shown_ns = sent = 0
        while (now_ns := time.monotonic_ns() - zero_ns) < duration_ns:
            while sent < len(due) and due[sent][0] * NS_PER_S <= now_ns:
                _, role, command = due[sent]
                lines[role].write(encode(command.name, command.values, sent))
                kind = "inject" if command.injected else EVENT_OF[command.name]
                writer.write_event(Event(now_ns, kind, role, command.values))
                sent += 1
            for role, line in lines.items():
                for chunk in line.read(POLL_S):
                    self._keep(writer, role, chunk, zero_ns)
            if now_ns - shown_ns > NS_PER_S // 5:
                shown_ns = now_ns
                share = FLASHED + (1.0 - FLASHED) * now_ns / duration_ns
                progress(share, f"recorded {now_ns / NS_PER_S:.0f} of {self.plan.duration_s:g} s")
        return now_ns

    def _write_edges(
        self, writer: Writer, capture: CaptureEdges, zero_ns: int, booted_ns: int, end_ns: int
    ) -> None:
        """Put the edges on the bench clock, when the capture is to be believed.

        Raises:
            RigError: it is not.
        """
        assert capture.start is not None
        start_ns, about_ns = capture.start.t_ns_host - zero_ns, capture.start.uncertainty_ns
        streams = {role: stream_of(chunks) for role, chunks in self._kept.items()}
        said = {role: decode(stream.data) for role, stream in streams.items()}
        edges = bench_edges(capture, start_ns_bench=start_ns)
        aligned = align.Alignment(0, about_ns, 0)
        if LEADER_PULSE in edges.channels:
            pulse_ns = edges.select(LEADER_PULSE)[0]
            aligned = align.align(streams["leader"], said["leader"], pulse_ns, about_ns)
        t_ns = edges.t_ns_bench + aligned.shift_ns
        # Before the boards had booted, and behind the last serial byte, was not this run.
        inside = (t_ns >= 0) & (t_ns < end_ns)
        writer.write_edges(t_ns[inside], edges.channel[inside], edges.level[inside])
        first = (booted_ns + about_ns - start_ns) * capture.samplerate_hz / NS_PER_S
        found = trust.findings(capture, said, math.ceil(first))
        data = {
            "samplerate_hz": capture.samplerate_hz,
            "samples": capture.samples,
            "host_uncertainty_ns": about_ns,
            "shift_ns": aligned.shift_ns,
            "uncertainty_ns": aligned.uncertainty_ns,
            "pulses_aligned": aligned.pulses,
            "findings": [finding.message for finding in found],
        }
        writer.write_event(Event(start_ns + aligned.shift_ns, "analyser", "", data))
        if found:
            raise RigError(
                "the analyser's capture is not to be believed:\n"
                + "\n".join(f"    {finding.message}" for finding in found),
                "\n".join(dict.fromkeys(line for f in found for line in f.mend.splitlines())),
            )


def stream_of(chunks: list[Chunk]) -> SerialStream:
    """Chunks on the bench clock as a recording holds them."""
    sizes = [0, *(len(chunk.data) for chunk in chunks)]
    return SerialStream(
        np.frombuffer(b"".join(chunk.data for chunk in chunks), np.uint8),
        np.cumsum(sizes[:-1] if chunks else [], dtype=np.int64),
        np.array([chunk.t_ns_host for chunk in chunks], np.int64),
    )


def _refuse_gaps(writer: Writer, lines: Mapping[str, SerialPort], zero_ns: int) -> None:
    said = []
    for role, line in lines.items():
        for gap in line.gaps:
            lost_ns, lasted_s = gap.t_lost_ns - zero_ns, (gap.t_back_ns - gap.t_lost_ns) / NS_PER_S
            writer.write_event(Event(lost_ns, "gap", role, {"lasted_s": round(lasted_s, 3)}))
            said.append(
                f"the {role}'s serial port was gone for {lasted_s:.1f} s, "
                f"{lost_ns / NS_PER_S:.1f} s after the start: what the board said then is lost"
            )
    if said:
        raise RigError(
            "\n".join(said),
            "look at the cable, the hub and the board's power switch; then run again\ndmesg | tail",
        )


def _archive(bench: Inventory, output: Path) -> Path | None:
    """Where the analyser's samples are kept until the run has proved sound."""
    if bench.analyser is None:
        return None
    path = output.with_name(f"analyser{SUFFIXES[bench.analyser.kind]}")
    path.unlink(missing_ok=True)
    return path


def provenance(
    bench: Inventory,
    plan: Scenario,
    left_out: list[str],
    images: Mapping[str, Manifest],
    boards: Mapping[str, Flashed],
) -> Provenance:
    """Where this recording comes from: enough to repeat the run."""
    analyser = bench.analyser
    runners = {f"probe runner {b.runner}": b.runner_version for b in boards.values()}
    return Provenance(
        source=BenchBackend.source,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        scenario=to_mapping(plan),
        manifests={role: image.to_mapping() for role, image in images.items()},
        tools={
            "hil": importlib.metadata.version("hil"),
            "Python": platform.python_version(),
            "Zephyr": ", ".join(sorted({image.zephyr_version for image in images.values()})),
            **runners,
            **({"sigrok-cli": first_line([PROGRAM, "--version"])} if analyser else {}),
        },
        host={
            "system": platform.system(),
            "machine": platform.machine(),
            "name": platform.node(),
            "boards": {role: board.to_mapping() for role, board in boards.items()},
            "analyser": {}
            if analyser is None
            else {
                "kind": analyser.kind,
                "driver": analyser.driver,
                "samplerate_hz": analyser.samplerate_hz,
                "channels": {name: str(signal) for name, signal in analyser.channels.items()},
            },
            "wires": [f"{wire.start} to {wire.end}" for wire in bench.wires],
        },
        notes=" ".join(part for part in (NOTES, sentence(left_out)) if part),
    )
