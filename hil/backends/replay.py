# SPDX-License-Identifier: Apache-2.0
"""Replay: a recording made earlier stands in for the run. Needs nothing but the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hil.backends import Progress
from hil.recording import Recording, load
from hil.scenario import Scenario


@dataclass(frozen=True)
class ReplayBackend:
    """Returns the recording at ``path``, whatever the scenario asks for; writes nothing."""

    path: Path
    source: str = "replay"

    def run(self, scenario: Scenario | None, output: Path | None, progress: Progress) -> Recording:
        """Load the recording.

        Raises:
            RecordingError: the file is missing or is not a recording.
        """
        progress(0.0, f"loading {self.path.name}")
        recording = load(self.path)
        progress(1.0, f"loaded {self.path.name}")
        return recording
