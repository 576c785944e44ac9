# SPDX-License-Identifier: Apache-2.0
"""Is every wire to the analyser on its pin? Two seconds of the running firmware tell.

Both nodes, connected, toggle ``radio_end`` at every packet, pulse ten times a second and raise
their sensor's interrupt with every batch.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from hil.bench.analyser.selfcheck import PULSE_HIGH_S, PULSE_HIGH_TOLERANCE_S, check_capture
from hil.bench.doctor import Check
from hil.bench.watch import analyser_of
from hil.errors import HilError, RigError

if TYPE_CHECKING:
    from hil.bench.analyser.capture import CaptureEdges
    from hil.bench.inventory import Inventory

LOOK_S: Final = 2.0
LEAST: Final = {"radio_end": 20, "pulse": 2, "imu_int1": 4, "pulse_in": 2}
"""Signal -> level changes within :data:`LOOK_S` that are a sign of life, far below the rate."""
MEND_SILENT: Final = (
    "is the firmware running, and are both nodes connected? hil bench reset\n"
    "the wiring, pin by pin: hil bench show; each board needs a ground wire to the analyser"
)


def check_wiring(bench: Inventory) -> list[Check]:
    """A check for each channel that the bench file names, and for what they show together."""
    try:
        capture = look(bench)
    except HilError as error:
        return [Check("wiring", "fail", error.message, error.mend)]
    return list(judge(capture))


def look(bench: Inventory, seconds: float = LOOK_S) -> CaptureEdges:
    """What the analyser sees.

    Raises:
        RigError: there is no analyser, or it failed.
    """
    analyser = analyser_of(bench, seconds)
    if analyser is None:
        raise RigError("the bench has no analyser", "name one in the bench file: docs/bench.md")
    try:
        analyser.start()
        time.sleep(seconds)
        return analyser.stop()
    finally:
        analyser.close()


def judge(capture: CaptureEdges) -> Iterator[Check]:
    """What a capture of running firmware says of the wires."""
    silent = False
    for name in capture.channels:
        count = capture.select(name)[0].size
        said = f"{count} level changes in {capture.duration_s:.1f} s"
        if count < LEAST[name.rpartition(".")[2]]:
            silent = True
            yield Check(f"wire {name}", "fail", said, MEND_SILENT)
        else:
            yield Check(f"wire {name}", "pass", said + _pulse_width(capture, name))
    if silent:
        # The rest would say the same in other words.
        return
    for finding in check_capture(capture, pulse_period_s=None):
        yield Check("wiring", "fail", finding.message, finding.mend)


def _pulse_width(capture: CaptureEdges, name: str) -> str:
    sample, level = capture.select(name)
    high_s = np.diff(sample)[level[:-1] == 1] / capture.samplerate_hz
    if not name.endswith("pulse") or high_s.size == 0:
        return ""
    off = float(np.median(high_s)) - PULSE_HIGH_S
    return ", pulses as wide as they should be" if abs(off) < PULSE_HIGH_TOLERANCE_S else ""
