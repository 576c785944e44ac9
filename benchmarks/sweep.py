# SPDX-License-Identifier: Apache-2.0
"""Thirty parameter sets over 20 recordings, on one processor and on all: elapsed time."""

from __future__ import annotations

import os
import resource
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


def _used_s() -> float:
    """Processor time of this process and of its children that ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def rows() -> list[Row]:
    processors = len(os.sched_getaffinity(0))
    seeds = list(range(RECORDINGS))

    def timed(jobs: int) -> tuple[float, float, list[float]]:
        start, used = time.perf_counter(), _used_s()
        found = list(locally(jobs, over_one, seeds))
        return time.perf_counter() - start, _used_s() - used, found

    one_s, one_cpu_s, alone = timed(1)
    all_s, all_cpu_s, together = timed(processors)
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
            else f"{one_s / all_s:.1f} times in elapsed time; all processes together took "
            f"{all_cpu_s / one_cpu_s:.2f} of the processor time of one, so what is missing is what "
            "else the machine does: measure when it does nothing",
        )
    ]
