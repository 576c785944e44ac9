# SPDX-License-Identifier: Apache-2.0
"""What the page says in place of codes: short sentences for somebody who stands at a rack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from hil.wire.messages import FAULT_CODES

FAULTS: Final[Mapping[str, str]] = {
    "assert": "the program stopped on an error of its own and starts again",
    "watchdog": "the program hung and was started again",
    "stack": "a part of the program ran out of memory, and it was started again",
    "imu_who_am_i": "no motion sensor answers: check its wiring",
    "imu_bus": "the motion sensor cannot be read: check its wiring",
    "imu_no_interrupt": "the motion sensor's interrupt wire is silent: check INT1",
    "imu_fifo_config": "the motion sensor lost its settings: check its supply",
    "link_bad_payload": "the nodes do not understand each other: flash both with one build",
    "link_stranger": "another node tried to take the follower's place and was refused",
    "ppi_exhausted": "the time sync could not be set up",
    "command_refused": "a command from the host was refused",
    "fusion_overrun": "the estimator did not keep up, and samples were left out",
    "cal_bias_refused": "the gyroscope has drifted too far from its calibration: calibrate again",
    "cal_store": "the stored calibration cannot be read or written",
}
BOOT_CHECKS: Final[Mapping[str, tuple[str, str]]] = {
    "pending": ("unknown", "looking for a moment of stillness: do not touch the bar"),
    "applied": ("ok", "checked at the start"),
    "warned": ("warn", "in force, but the gyroscope has drifted: calibrate soon"),
    "refused": ("bad", "refused: the gyroscope has drifted too far; calibrate again"),
    "moving": ("warn", "not checked: the bar was moved at the start"),
}
"""Result of the boot check -> level and words."""

SYNC: Final[Mapping[str, tuple[str, str]]] = {
    "unsynced": ("bad", "the clocks are not tied together"),
    "converging": ("warn", "the clocks are being tied"),
    "locked": ("ok", "the clocks agree"),
    "holdover": ("warn", "no new pairs"),
}

LEVELS: Final[Mapping[str, str]] = {
    "ok": "All well",
    "unknown": "Waiting",
    "warn": "Attention",
    "bad": "Fault",
}
"""Level -> the word shown with it, from best to worst."""


def fault(code: int) -> str:
    """A FAULT code in words."""
    name = next((name for name, value in FAULT_CODES.items() if value == code), "")
    return FAULTS.get(name, f"fault number {code}")


def worst(levels: list[str]) -> str:
    """The gravest of some levels; ``unknown`` for none."""
    order = list(LEVELS)
    return max(levels, key=order.index, default="unknown")
