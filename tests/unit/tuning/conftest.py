# SPDX-License-Identifier: Apache-2.0
"""Short sets to search on, made once; ``short.py`` beside this file is a program as well."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location("short", Path(__file__).with_name("short.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
SHORT = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(SHORT)


@pytest.fixture(scope="session")
def short():
    return SHORT


@pytest.fixture(scope="session")
def short_sources():
    return SHORT.sources()


@pytest.fixture
def tuned(monkeypatch, short_sources):
    """A search on the short sets, with other options."""
    from hil.tuning import ekf  # noqa: PLC0415

    monkeypatch.setattr(ekf, "_read", lambda _: (short_sources, []))
    return lambda **options: ekf.tune(SHORT.wish(**options))
