# SPDX-License-Identifier: Apache-2.0
"""Debug probes: one small interface, and one module for each program that can drive one."""

from hil.bench.probes.choose import choose, runners
from hil.bench.probes.ficr import ChipInfo, read_chip
from hil.bench.probes.model import Probe, Protection, Readiness, ResetKind, Runner

__all__ = [
    "ChipInfo",
    "Probe",
    "Protection",
    "Readiness",
    "ResetKind",
    "Runner",
    "choose",
    "read_chip",
    "runners",
]
