# SPDX-License-Identifier: Apache-2.0
"""Did anything drift, or get lost, over a long run? Limits: docs/error-budget.md, lines D."""

from __future__ import annotations

import pytest

from hil.recording import Recording
from hil.soak.figures import is_long
from tests.hil.conftest import Judge


def test_nothing_drifts_and_nothing_is_lost_in_a_long_run(
    recording: Recording, judge: Judge
) -> None:
    if not is_long(recording):
        pytest.skip("trends need half an hour")
    judge("soak.")
