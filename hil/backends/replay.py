# SPDX-License-Identifier: Apache-2.0
"""Replay: a recording made earlier stands in for the run. Needs nothing but the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hil.backends import Progress
from hil.faults import Injection
from hil.faults.apply import inject
from hil.recording import Recording, load
from hil.scenario import Scenario


@dataclass(frozen=True)
class ReplayBackend:
    """Returns the recording at ``path``, whatever the scenario asks for; writes nothing.

    ``inject`` are faults to put between the file and the checks.
    """

    path: Path
    source: str = "replay"
    inject: tuple[Injection, ...] = ()

    def run(self, scenario: Scenario | None, output: Path | None, progress: Progress) -> Recording:
        """Load the recording.

        Raises:
            RecordingError: the file is missing or is not a recording.
            ScenarioError: a fault that only a live run can have.
        """
        progress(0.0, f"loading {self.path.name}")
        recording = inject(load(self.path), self.inject)
        progress(1.0, f"loaded {self.path.name}")
        return recording
