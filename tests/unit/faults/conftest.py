# SPDX-License-Identifier: Apache-2.0
"""The recording that faults are put into, read once."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.faults.table import FIXTURE
from hil.recording import Recording, load

RECORDINGS = Path(__file__).parents[3] / "fixtures" / "recordings"


@pytest.fixture(scope="session")
def sound() -> Recording:
    """A run that passes every check."""
    return load(RECORDINGS / FIXTURE / "recording.mcap")
