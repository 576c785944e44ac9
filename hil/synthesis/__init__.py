# SPDX-License-Identifier: Apache-2.0
"""Synthetic recordings: two nodes' frames and edges, made from their clocks, without firmware.

For testing the checks, which must pass a sound run and fail each kind of faulty one, and for what
takes too long to run otherwise, such as a wrap of the 32-bit counter.

Example::

    recording = synthesise(Plan(duration_s=300, conn_interval_us=30_000))
    broken = synthesise(Plan(), faults=["swapped_pair"])
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from hil.recording import Provenance, Recording, Writer, load
from hil.synthesis.build import draft
from hil.synthesis.faults import FAULTS
from hil.synthesis.plan import FOLLOWER, LEADER, NodePlan, Plan

__all__ = ["FAULTS", "FOLLOWER", "LEADER", "NodePlan", "Plan", "save", "synthesise"]


def synthesise(plan: Plan | None = None, faults: Iterable[str] = ()) -> Recording:
    """Build a recording in memory, its source stamped ``synthetic``.

    Args:
        plan: the run; the default one is 20 s at 7.5 ms.
        faults: names of :data:`FAULTS`, applied in this order.

    Raises:
        ValueError: an unknown fault.
    """
    plan = plan or Plan()
    chosen = list(faults)
    unknown = [name for name in chosen if name not in FAULTS]
    if unknown:
        raise ValueError(f"unknown fault {unknown[0]!r}; faults: {', '.join(FAULTS)}")
    for name in chosen:
        plan = FAULTS[name].plan(plan)
    content = draft(plan)
    for name in chosen:
        FAULTS[name].draft(content)
    return Recording(
        provenance=Provenance(
            source="synthetic",
            created_utc="1970-01-01T00:00:00Z",
            scenario=plan.to_scenario(),
            manifests={role: {"build_id": f"0x{n:016x}"} for role, n in _built(plan).items()},
            tools={"hil.synthesis": "1"},
            notes=f"synthetic, faults: {', '.join(chosen) or 'none'}",
        ),
        serial={role: content.serial(role) for role in content.frames},
        edges=content.all_edges(),
        events=(),
        integrity=content.integrity,
        imu_truth=content.imu_truth,
    )


def _built(plan: Plan) -> dict[str, int]:
    return dict(asdict(plan)["build_id"])


def save(recording: Recording, path: Path) -> Recording:
    """Write a recording that was made in memory to a file, and return it as read back.

    Raises:
        RecordingError: the file exists or cannot be written.
    """
    with Writer(
        path,
        recording.provenance,
        roles=recording.roles,
        edge_channels=recording.edges.channels,
        edge_resolution_ns=recording.edges.resolution_ns,
    ) as writer:
        for role, stream in recording.serial.items():
            ends = [*stream.block_offset[1:].tolist(), int(stream.data.size)]
            for start, end, t_ns in zip(
                stream.block_offset.tolist(), ends, stream.block_t_ns_bench.tolist(), strict=True
            ):
                writer.write_serial(role, t_ns, stream.data[start:end].tobytes())
        edges = recording.edges
        writer.write_edges(edges.t_ns_bench, edges.channel, edges.level)
        for role, t in recording.imu_truth.items():
            writer.write_imu_truth(role, t.run, t.slot, t.t_us_true, t.counts, t.flags)
        for event in recording.events:
            writer.write_event(event)
    return load(path)
