# SPDX-License-Identifier: Apache-2.0
"""The one list of checks: what every recording is judged by, live or replayed.

The command line, the pytest suite and the report all call :func:`evaluate` or :func:`suite`;
none of them knows a check of its own.
"""

from __future__ import annotations

from typing import Final

from hil import fusion, imported, imu, link, timesync
from hil.calibration import measures as calibration
from hil.calibration import series as calibration_series
from hil.measure import Measurement
from hil.recording import Recording
from hil.reps import measures as reps
from hil.series import Series
from hil.soak import measures as soak

SUITES: Final = ("sync", "link", "imu", "fifo", "cal", "ekf", "soak")


def evaluate(recording: Recording) -> list[Measurement]:
    """Every measurement of ``recording``, suite by suite."""
    return [m for measurements in evaluate_suites(recording).values() for m in measurements]


def evaluate_suites(recording: Recording) -> dict[str, list[Measurement]]:
    """Suite -> its measurements; what the suites share is computed once."""
    return {name: suite(recording, name) for name in SUITES}


def series(recording: Recording) -> list[Series]:
    """What to draw of ``recording``, suite by suite."""
    sync = timesync.analyse(recording)
    return [
        *timesync.series(recording, sync),
        *imu.series(recording, sync),
        *calibration_series.series(recording),
        *fusion.series(recording, sync),
        *soak.series(recording),
    ]


def suite(recording: Recording, name: str) -> list[Measurement]:
    """The measurements of one suite.

    Raises:
        ValueError: no such suite.
    """
    if name not in SUITES:
        raise ValueError(f"no suite '{name}'; suites: {', '.join(SUITES)}")
    found = soak.measure(recording) if name == "soak" else _suite(recording, name)
    return imported.applicable(found, recording) if imported.is_bare(recording) else found


def _suite(recording: Recording, name: str) -> list[Measurement]:
    sync = timesync.analyse(recording)
    match name:
        case "sync":
            return timesync.measure(recording, sync)
        case "link":
            return link.measure(recording, sync.conditions)
        case "imu":
            return imu.measure(recording, sync)
        case "fifo":
            return imu.measure_fifo(recording, sync)
        case "cal":
            return calibration.measure(recording, sync.conditions)
        case _:
            found = fusion.measure(recording, sync)
            return [*found, *(reps.measure(recording, sync.conditions) if found else [])]


def suite_of(measurement: Measurement) -> str:
    """The suite that a measurement belongs to, by the first part of its name."""
    first = measurement.name.split(".", 1)[0]
    return "link" if first == "node" else first
