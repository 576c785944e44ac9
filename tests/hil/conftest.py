# SPDX-License-Identifier: Apache-2.0
"""Each recording is measured once; the tests then judge what they name."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest

from hil import checks
from hil.measure import Measurement
from hil.recording import Recording

Judge = Callable[..., None]


@pytest.fixture(scope="session")
def measured(recording: Recording) -> dict[str, Measurement]:
    """Name -> measurement, for every measurement of the recording."""
    return {m.name: m for m in checks.evaluate(recording)}


@pytest.fixture
def judge(
    measured: dict[str, Measurement],
    measure: Callable[[Iterable[Measurement]], None],
) -> Judge:
    """Judge measurements by name; a prefix that ends in a dot stands for all below it."""

    def by_name(*names: str) -> None:
        chosen = []
        for name in names:
            found = [m for n, m in measured.items() if n == name or _below(n, name)]
            assert found, f"no measurement is called {name}"
            chosen += found
        measure(chosen)

    return by_name


def _below(name: str, prefix: str) -> bool:
    return prefix.endswith(".") and name.startswith(prefix)
