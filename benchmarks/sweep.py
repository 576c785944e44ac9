# SPDX-License-Identifier: Apache-2.0
"""Thirty parameter sets over 20 recordings, on one processor and on all: elapsed time."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np

from benchmarks.measure import Row
from hil.parity import run_core
from hil.pil.samples import simulated
from hil.reference.params import Params
from hil.tuning.workers import locally

RECORDINGS, SETS = 20, 30


def over_one(seed: int) -> float:
    """All parameter sets over one simulated lift."""
    samples = simulated("bench", seed)
    spread = 0.0
    for k in range(SETS):
        params = replace(Params(), zupt_dwell=40 + k)
        spread += float(np.ptp(run_core(samples, params, np.float32)["v"]))
    return spread


def rows() -> list[Row]:
    processors = len(os.sched_getaffinity(0))
    seeds = list(range(RECORDINGS))

    def timed(jobs: int) -> tuple[float, list[float]]:
        start = time.perf_counter()
        found = list(locally(jobs, over_one, seeds))
        return time.perf_counter() - start, found

    one_s, alone = timed(1)
    all_s, together = timed(processors)
    if alone != together:
        raise RuntimeError("side by side the sweep gives other results")
    met = one_s >= 0.9 * processors * all_s
    return [
        Row(
            work=f"{SETS} parameter sets over {RECORDINGS} recordings, {processors} processors",
            ours=f"{all_s:.1f} s",
            peer=f"one after another: {one_s:.1f} s",
            ratio=one_s / all_s,
            limit=one_s / all_s / processors,
            aim=f"{0.9 * processors:.1f} times",
            met=met,
            lacking=""
            if met
            else f"{one_s / all_s:.1f} times: the processes' start is lost, "
            "and what else the machine does; a sweep of minutes shows the rest",
        )
    ]
