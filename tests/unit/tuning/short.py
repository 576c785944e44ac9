# SPDX-License-Identifier: Apache-2.0
"""Four sets of a few seconds whose image believes in an accelerometer thirty times as noisy.

As a program: ``python short.py FOLDER`` searches on them and keeps its evaluations there.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from hil.fusion.inputs import Run
from hil.motion.lifts import deadlift
from hil.parity import batch
from hil.reference.params import Params
from hil.reference.study import simulate
from hil.tuning import ekf
from hil.tuning.case import Case, Known

RANGE = ("accel_noise_mps2_rthz=1e-4:1e-1:log", "zupt_variance=1e-6:1e-2:log")
SPOILT = replace(Params(), accel_noise_mps2_rthz=3e-2, zupt_variance=3e-3)


def sources() -> list[ekf.Source]:
    found = []
    for seed, rests in ((1, True), (2, True), (3, False), (4, True)):
        lift = deadlift(seed, reps=2, rests=rests)
        run = Run(batch(*simulate(lift, seed)), SPOILT, 0, 0)
        name = f"deadlift {seed}"
        found.append(ekf.Source(name, [Case(name, run, Known(lift, 0.0, rests, None))]))
    return found


def wish(**options: object) -> ekf.Wish:
    said = ekf.Wish(sets=4, parameters=RANGE, trials=12, hold_out=1)
    return replace(said, **options)  # type: ignore[arg-type]


if __name__ == "__main__":
    made = sources()
    ekf._read = lambda _: (made, [])  # type: ignore[assignment]
    ekf.tune(wish(folder=Path(sys.argv[1])))
