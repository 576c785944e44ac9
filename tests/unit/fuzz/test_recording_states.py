# SPDX-License-Identifier: Apache-2.0
"""A recording that is written, killed and opened again: what was flushed is there, byte for byte.

Killed: the file is cut anywhere behind what the writer had handed over when it last flushed.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from hil.recording import Event, Provenance, Recording, Writer, load


class Run(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="hil-states-"))
        self.t_ns = 0
        self.count = 0

    def teardown(self) -> None:
        self.writer.close()
        shutil.rmtree(self.folder)

    @initialize()
    def begin(self) -> None:
        self.count += 1
        self.path = self.folder / f"{self.count}.mcap"
        self.writer = Writer(self.path, Provenance("synthetic", "", scenario={"name": "x"}))
        self.data = b""
        self.edges: list[int] = []
        self.events: list[int] = []
        self.open = True

    @precondition(lambda self: self.open)
    @rule(data=st.binary(min_size=1, max_size=200))
    def append(self, data: bytes) -> None:
        self.t_ns += 1000
        self.writer.write_serial("leader", self.t_ns, data)
        self.data += data

    @precondition(lambda self: self.open)
    @rule(count=st.integers(1, 5))
    def edge(self, count: int) -> None:
        times = [self.t_ns + k for k in range(count)]
        self.writer.write_edges(times, [1] * count, [0] * count)
        self.edges += times
        self.t_ns += count

    @precondition(lambda self: self.open)
    @rule()
    def event(self) -> None:
        self.writer.write_event(Event(self.t_ns, "note", "leader", {}))
        self.events.append(self.t_ns)

    @precondition(lambda self: self.open)
    @rule()
    def flush(self) -> None:
        self.writer.flush()

    @precondition(lambda self: self.open)
    @rule(part=st.floats(0, 1))
    def kill_and_reopen(self, part: float) -> None:
        """What was flushed is whole wherever behind it the file ends; more may be there."""
        self.writer.flush()
        safe = self.path.stat().st_size
        self.append(b"never flushed")
        self.writer.flush()
        size = self.path.stat().st_size
        cut = self.folder / "cut.mcap"
        cut.write_bytes(self.path.read_bytes()[: safe + int(part * (size - safe))])
        recording = load(cut)
        assert not recording.integrity.complete
        self.check(recording, self.data.removesuffix(b"never flushed"))

    @precondition(lambda self: self.open)
    @rule()
    def close_and_reopen(self) -> None:
        self.writer.close()
        self.open = False
        recording = load(self.path)
        assert recording.integrity.complete
        assert recording.integrity.problems == ()
        self.check(recording, self.data)
        assert recording.serial["leader"].data.tobytes() == self.data

    @precondition(lambda self: not self.open)
    @rule()
    def again(self) -> None:
        self.begin()

    def check(self, recording: Recording, data: bytes) -> None:
        found = recording.serial["leader"].data.tobytes()
        assert found.startswith(data)
        assert self.data.startswith(found)
        assert recording.edges.t_ns_bench.tolist() == sorted(self.edges)
        assert [e.t_ns_bench for e in recording.events] == self.events


TestRun = Run.TestCase
TestRun.settings = settings(max_examples=12, stateful_step_count=20, deadline=None)
