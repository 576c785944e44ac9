# SPDX-License-Identifier: Apache-2.0
"""Report documents as short as the schema lets them be."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import pytest

from hil.measure import Limits, Measurement
from hil.report.document import SCHEMA_ID

Document = dict[str, Any]


def make_entry(
    number: int,
    value: float | None = 92.4,
    *,
    uncertainty: float = 0.0,
    high: float = 150.0,
    build: str = "aaaa",
    scenario: str = "clean",
    source: str = "sim",
    outcome: str | None = None,
    name: str = "sync.error_p99_ns",
) -> Document:
    """Run ``number``: recorded on day ``number`` of 2026, with one measurement."""
    m = Measurement(name, value, "ns", Limits(None, high, 10.0), "T1", "how", uncertainty)
    day = f"2026-{1 + number // 28:02d}-{1 + number % 28:02d}T08:30:00+00:00"
    sha256 = hashlib.sha256(f"{number}".encode()).hexdigest()
    image = {"build_id": build, "files": {"exe": {"sha256": build * 16}}}
    found = {"fail": "product_failure", "inconclusive": "inconclusive"}.get(m.verdict, "pass")
    return {
        "id": f"run-{number}",
        "name": f"run-{number}",
        "description": "",
        "source": source,
        "source_label": source,
        "source_summary": "",
        "cannot_tell": [],
        "judged": "replay",
        "verdict": m.verdict.value,
        "outcome": outcome or found,
        "outcome_reason": "",
        "expect_fail": [],
        "as_expected": None,
        "integrity": {"complete": True, "problems": [], "lost_blocks": 0, "blocks": 1},
        "contents": {"duration_s": 1.0, "serial_bytes": {}, "edges": 0, "events": {}},
        "file": {"name": "recording.mcap", "sha256": sha256, "size_bytes": 1},
        "attachments": [],
        "provenance": {
            "created_utc": day,
            "scenario": {"name": scenario, "seed": 1},
            "images": {"leader": image},
            "devices": {},
            "schema_hash": "0" * 16,
            "tools": {},
            "host": {},
            "notes": "",
        },
        "measurements": [{"id": name, **m.to_json(), "expected_fail": False}],
        "series": [],
    }


def make_document(*entries: Document, when: str = "2026-11-22T08:30:00+00:00") -> Document:
    return {
        "$schema": SCHEMA_ID,
        "schema_version": "1.1",
        "generated_utc": when,
        "tool": {"name": "hil", "version": "0.1.0", "python": "3.11.2"},
        "rig": {
            "git": {"commit": "ab" * 20, "state": "clean"},
            "host": {"name": "h", "system": "Linux", "machine": "x86_64"},
            "packages": {},
        },
        "verdict": "pass",
        "outcome": "pass",
        "budget": [],
        "recordings": list(entries),
    }


@pytest.fixture
def entry() -> Callable[..., Document]:
    return make_entry


@pytest.fixture
def document() -> Callable[..., Document]:
    return make_document
