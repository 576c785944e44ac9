# SPDX-License-Identifier: Apache-2.0
"""A real recording's tables, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.exchange.contents import contents
from hil.exchange.table import Contents
from hil.recording import Recording, load

CAL_BOOT = Path(__file__).parents[3] / "fixtures" / "recordings" / "cal-boot" / "recording.mcap"


@pytest.fixture(scope="session")
def real() -> Recording:
    return load(CAL_BOOT)


@pytest.fixture(scope="session")
def tables(real: Recording) -> Contents:
    return contents(real)
