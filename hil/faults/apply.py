# SPDX-License-Identifier: Apache-2.0
"""Where injections take hold: in the writer of a live run, or in a recording made earlier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.faults.injection import Injection, of_scenario, refuse_unless_possible
from hil.faults.injector import Injector
from hil.recording import EDGE_CHANNELS, Edges, Provenance, Recording, SerialStream, Writer


class InjectedWriter(Writer):
    """Writes what is left of a run after the injections that its provenance names."""

    def __init__(
        self,
        path: Path | str,
        provenance: Provenance,
        *,
        edge_channels: Sequence[str] = EDGE_CHANNELS,
        **settings: Any,
    ) -> None:
        found = of_scenario(provenance.scenario)
        seed = int(provenance.scenario.get("seed", 1))
        self._injector = Injector(found, seed, edge_channels)
        self._told = False
        super().__init__(path, provenance, edge_channels=edge_channels, **settings)

    def write_serial(self, role: str, t_ns_bench: int, data: bytes) -> None:
        with self._lock:
            for read in self._injector.serial(role, t_ns_bench, data):
                super().write_serial(*read)

    def write_edges(self, t_ns_bench: ArrayLike, channel: ArrayLike, level: ArrayLike) -> None:
        with self._lock:
            super().write_edges(*self._injector.edges(t_ns_bench, channel, level))

    def close(self, aborted: str = "") -> None:
        if not self._told and not self._broken:
            self._told = True
            for event in self._injector.events():
                self.write_event(event)
        super().close(aborted)


def writer(path: Path, provenance: Provenance, **settings: Any) -> Writer:
    """The writer of a live run, with the injections of its scenario."""
    kind = InjectedWriter if provenance.scenario.get("inject") else Writer
    return kind(path, provenance, **settings)


def inject(recording: Recording, injections: Sequence[Injection]) -> Recording:
    """A recording as it would be had these faults happened; its provenance names them.

    Raises:
        ScenarioError: a kind that only a live run can have.
    """
    if not injections:
        return recording
    refuse_unless_possible(injections, "replay")
    scenario = dict(recording.provenance.scenario)
    seed = scenario.get("seed", 1)
    through = Injector(injections, seed if isinstance(seed, int) else 1, recording.edges.channels)
    reads: dict[str, list[tuple[int, bytes]]] = {role: [] for role in recording.serial}
    for role, stream in recording.serial.items():
        ends = [*stream.block_offset[1:].tolist(), int(stream.data.size)]
        data = stream.data.tobytes()
        for start, end, read_ns in zip(
            stream.block_offset.tolist(), ends, stream.block_t_ns_bench.tolist(), strict=True
        ):
            for to, at_ns, piece in through.serial(role, read_ns, data[start:end]):
                if to in reads and piece:
                    reads[to].append((at_ns, piece))
    edges = recording.edges
    t_ns, channel, level = through.edges(edges.t_ns_bench, edges.channel, edges.level)
    order = np.argsort(t_ns, kind="stable")
    earlier = scenario.get("inject") or []
    scenario["inject"] = [*earlier, *(one.to_mapping() for one in injections)]
    return Recording(
        provenance=replace(recording.provenance, scenario=scenario),
        serial={role: _stream(pieces) for role, pieces in reads.items()},
        edges=Edges(t_ns[order], channel[order], level[order], edges.channels, edges.resolution_ns),
        events=(*recording.events, *through.events()),
        integrity=recording.integrity,
        path=recording.path,
        imu_truth=recording.imu_truth,
    )


def _stream(reads: list[tuple[int, bytes]]) -> SerialStream:
    lengths: NDArray[np.int64] = np.array([len(data) for _, data in reads], dtype=np.int64)
    return SerialStream(
        np.frombuffer(b"".join(data for _, data in reads), np.uint8),
        np.cumsum(lengths) - lengths,
        np.array([at_ns for at_ns, _ in reads], dtype=np.int64),
    )
