# SPDX-License-Identifier: Apache-2.0
"""Samples for the estimator on the target: of a simulated lift, or of a recording."""

from __future__ import annotations

from pathlib import Path

from hil import library
from hil.errors import RecordingError, RigError
from hil.fusion.inputs import runs
from hil.motion import lifts
from hil.parity import Batch, batch
from hil.recording import load
from hil.reference.params import Params
from hil.reference.study import Link, simulate


def simulated(lift: str, seed: int, *, batch_samples: int = 4) -> Batch:
    """Both IMUs over one lift of :data:`hil.motion.lifts.LIFTS` at 416 Hz.

    Args:
        batch_samples: follower samples that arrive at once.

    Raises:
        RigError: there is no such lift.
    """
    if lift not in lifts.LIFTS:
        raise RigError(f"there is no lift '{lift}'", "one of: " + ", ".join(sorted(lifts.LIFTS)))
    return batch(*simulate(lifts.LIFTS[lift](seed), seed), Link(batch=batch_samples))


def recorded(path: Path) -> tuple[Batch, Params]:
    """What the leader's estimator was fed in a recording, from its last start on.

    Raises:
        RecordingError: there is no such recording, or no IMU batch in it.
    """
    found = runs(load(library.resolve(path)))
    if not found:
        raise RecordingError(
            f"{path}: the leader's stream has no IMU batch", "name a recording of both nodes"
        )
    return found[-1].samples, found[-1].params
