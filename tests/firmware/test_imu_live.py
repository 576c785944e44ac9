# SPDX-License-Identifier: Apache-2.0
"""The sensor's path on the simulated bench: every rate, with BLE streaming and a lost link.

One image for all of them: the rate is a command.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from hil import checks, scenario
from hil.backends.sim import SimBackend
from hil.build import Manifest
from hil.measure import Measurement, Verdict

RATES_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 417.0, 833.0, 1667.0, 3333.0, 6667.0)
COMPLETE = (
    "samples_lost",
    "samples_duplicated",
    "batches_out_of_order",
    "truth_time_error_us",
    "truth_period_error_ppm",
    "period_error_ppm",
    "int1_error_p99_us",
)
UNTOUCHED = (
    "overruns",
    "tag_gaps",
    "parity_errors",
    "bus_errors",
    "missed_edges",
    "truth_crc_mismatches",
    "truth_slots_unread",
)


def run(
    images: Mapping[str, Manifest], folder: Path, odr_hz: float, duration_s: float, **keys: Any
) -> dict[str, Measurement]:
    """Both nodes at ``odr_hz``, their chips 6.8 % slow and 3.1 % fast."""
    imu = {"leader": {"odr_error": -0.068}, "follower": {"odr_error": 0.031}}
    crystal = {
        "leader": {"drift_ppm": 13.7, "start_offset_us": 12345},
        "follower": {"drift_ppm": -31.1, "start_offset_us": 87654},
    }
    plan = scenario.from_mapping(
        {
            "name": f"odr-{odr_hz:g}",
            "duration_s": duration_s,
            "nodes": {
                role: {**crystal[role], "imu": {**imu[role], "odr_hz": odr_hz}} for role in imu
            },
            **keys,
        },
        "test",
    )
    recording = SimBackend(images=images).run(plan, folder / "recording.mcap", lambda *_: None)
    return {m.name: m for m in checks.evaluate(recording)}


def failing(found: Mapping[str, Measurement], names: list[str]) -> list[str]:
    """Those of ``names`` that did not pass, with their values; a missing one counts."""
    return [
        f"{name}: {found[name].value if name in found else 'not measured'}"
        for name in names
        if name not in found or found[name].verdict is not Verdict.PASS
    ]


def streams() -> list[str]:
    return [
        *(f"imu.{role}.{n}" for role in scenario.ROLES for n in COMPLETE),
        *(f"fifo.{role}.{n}" for role in scenario.ROLES for n in UNTOUCHED),
    ]


@pytest.mark.parametrize("odr_hz", RATES_HZ)
def test_batch_times_before_and_after_a_reconnect(
    images: Mapping[str, Manifest], tmp_path: Path, odr_hz: float
) -> None:
    found = run(images, tmp_path, odr_hz, 14.0, link_drops=[{"at_s": 7.0}])
    delivered = "imu.follower_at_leader.time_error_p99_ns"
    assert failing(found, [*streams(), delivered]) == []
    # Two connections, the second of them asked for.
    assert found["sync.reconnects"].details == {"leader": [1, 2], "follower": [1, 2]}
    assert found["ekf.core_mismatches"].value == 0


def test_a_minute_at_the_top_rate(images: Mapping[str, Manifest], tmp_path: Path) -> None:
    found = run(images, tmp_path, 6667.0, 60.0)
    delivered = [
        f"imu.follower_at_leader.{n}"
        for n in ("samples_lost", "samples_duplicated", "batches_out_of_order", "samples_altered")
    ]
    assert failing(found, [*streams(), *delivered]) == []
