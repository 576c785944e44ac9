# SPDX-License-Identifier: Apache-2.0
"""The EKF's step on the emulated Cortex-M4F, in instructions."""

from __future__ import annotations

from benchmarks.measure import Row
from hil import pil
from hil.errors import HilError
from hil.parity import first_steps

DENSE_PREDICT = 35_000
"""Instructions of the covariance's prediction as a dense Eigen product."""
AIM = 12_000
STEPS = 1_200


def rows() -> list[Row]:
    work = "EKF step on a Cortex-M4F"
    aim = f"{AIM:,} instructions at most"
    try:
        found = pil.assess(pil.build(), first_steps(pil.simulated("bench", 3), STEPS))
    except HilError as error:
        return [Row(work, "not measured", str(error).splitlines()[0], None, None, aim, None)]
    judged = {one.name: one for one in pil.measurements(found)}
    longest = int(judged["pil.full_step_instructions_max"].value or 0)
    mean = found.mean_instructions
    return [
        Row(
            work=work,
            ours=f"{longest:,} instructions at most, {mean:,.0f} on average",
            peer=f"dense predict alone: {DENSE_PREDICT:,}",
            ratio=DENSE_PREDICT / longest,
            limit=None,
            aim=aim,
            met=longest <= AIM,
            lacking=""
            if longest <= AIM
            else f"{longest / AIM:.2f} times: the sparse predict and five updates of a full step; "
            "the firmware's own work",
        )
    ]
