# SPDX-License-Identifier: Apache-2.0
"""Where a recording comes from. Every source is one small object with one method.

The checks never know which one ran: each returns a :class:`hil.recording.Recording`, stamped
with its source.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from hil.recording import Recording
from hil.scenario import Scenario

Progress = Callable[[float, str], None]
"""Called with the share done, 0..1, and a short line saying what is being done."""


class Backend(Protocol):
    """A source of recordings: ``replay``, ``sim`` or ``bench``."""

    source: str

    def run(self, scenario: Scenario, output: Path, progress: Progress) -> Recording:
        """Run ``scenario``, write what it produced to ``output`` (an ``.mcap``), return it.

        Raises:
            RigError: the rig failed; the message names the part and shows its last output.
        """
