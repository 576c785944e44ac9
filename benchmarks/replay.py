# SPDX-License-Identifier: Apache-2.0
"""The estimator over a lift: the core, the NumPy reference, and VQF, which gives attitude only."""

from __future__ import annotations

import numpy as np
from vqf import VQF

from benchmarks.measure import Row, best
from hil.parity import first_steps, run_core, run_reference
from hil.pil.samples import simulated
from hil.reference.params import Params

REFERENCE_STEPS = 1500


def rows() -> list[Row]:
    samples, params = simulated("bench", 3), Params()
    few = first_steps(samples, REFERENCE_STEPS)
    steps = len(samples.leader.columns()[0])
    _, accel, gyro, *_ = samples.leader.columns()
    accel, gyro = np.ascontiguousarray(accel), np.ascontiguousarray(gyro)
    ours = steps / best(lambda: run_core(samples, params, np.float32), 7)
    reference = REFERENCE_STEPS / best(lambda: run_reference(few, params), 1)
    attitude = steps / best(lambda: VQF(1 / params.rate_hz).updateBatch(gyro, accel), 5)
    met = ours >= 500_000 and ours >= 300 * reference
    return [
        Row(
            work=f"estimator over a lift, {steps:,} steps of both sensors",
            ours=f"{ours:,.0f} steps/s",
            peer=f"NumPy reference: {reference:,.0f}; VQF, attitude only: {attitude:,.0f} steps/s",
            ratio=ours / reference,
            limit=None,
            aim="500,000 steps/s, 300 times the reference",
            met=met,
            lacking=""
            if met
            else f"{ours / 5e5:.2f} of the rate: the covariance is Eigen with 16 states, as the "
            "recordings' hash demands; a block-sparse predict next",
        )
    ]
