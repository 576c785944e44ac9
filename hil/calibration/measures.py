# SPDX-License-Identifier: Apache-2.0
"""The calibration suite: did each node find a still second, decide rightly, and wait for it?"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import Conditions, judged
from hil.imu import correct
from hil.imu.batches import batches
from hil.measure import Measurement
from hil.motion.imu_model import chip_errors
from hil.recording import Recording
from hil.streams import ROLES, SIMULATED_SOURCES, frames, table
from hil.wire.messages import BOOT_CHECKS, FAULT_CODES, TICK_RATE_HZ, name_of

WARN_DPS: Final = 0.3
REFUSE_DPS: Final = 2.0
"""Distance of the bias at boot from the stored one beyond which a node warns, and refuses."""

DECISIONS_MAX: Final = 12
"""Rows of the table of decisions; a node that decides more often than that is broken."""


def expected(recording: Recording, role: str) -> bool:
    """Whether the node has a boot check: by the protocol table that it speaks."""
    status = table(recording, role).get("cal_status")
    return (
        role in recording.roles
        and status is not None
        and any(field.name == "raw" for field in status.fields)
    )


def measure(recording: Recording, c: Conditions) -> list[Measurement]:
    """All measurements of the suite; none where no node has a boot check."""
    roles = [role for role in ROLES if expected(recording, role)]
    found = [m for role in roles for m in _node(recording, role, c)]
    return [*found, *_estimator(recording, c)] if "leader" in roles else found


def _node(recording: Recording, role: str, c: Conditions) -> list[Measurement]:
    status = frames(recording, role, "cal_status")
    decided = correct.decided(recording, role)
    return [
        _ready(recording, role, c),
        _branch(role, status, decided, c),
        _refusal(recording, role, decided, c),
        *_truth(recording, role, decided, c),
    ]


def _ready(recording: Recording, role: str, c: Conditions) -> Measurement:
    """From the first sample, or from when the bar was put down, to the first corrected one."""
    name = f"cal.{role}.ready_s"
    b = batches(recording, role, role)
    corrected = np.flatnonzero(~b.has("uncorrected"))
    if corrected.size == 0:
        return judged(name, math.nan, "C1", c, f"no corrected sample from the {role}")
    handled_s = float(recording.provenance.scenario.get("motion", {}).get("handled_s", 0.0))
    wait_s = float(b.t_first_ticks[corrected[0]] - b.t_first_ticks[0]) / TICK_RATE_HZ
    before = int(b.count[: corrected[0]].sum())
    how = f"first corrected sample after {before} uncorrected ones"
    if handled_s:
        how += f", less the {handled_s:g} s that the bar was in hand"
    return judged(name, wait_s - handled_s, "C1", c, how, clock=role)


def _branch(role: str, status: NDArray[Any], decided: NDArray[Any], c: Conditions) -> Measurement:
    """Does the decision follow from the distance that the node reports?"""
    delta = decided["boot_delta_dps"]
    wanted = np.select(
        [delta < WARN_DPS, delta <= REFUSE_DPS],
        [BOOT_CHECKS["applied"], BOOT_CHECKS["warned"]],
        BOOT_CHECKS["refused"],
    )
    wrong = int(np.sum(decided["boot_check"] != wanted))
    return judged(
        f"cal.{role}.branch_wrong",
        float(wrong) if decided.size else math.nan,
        "C2",
        c,
        f"{decided.size} CAL frames since the decision: below {WARN_DPS} dps applied, to "
        f"{REFUSE_DPS} warned, beyond refused",
        details={"decisions": _decisions(status)},
    )


def _refusal(recording: Recording, role: str, decided: NDArray[Any], c: Conditions) -> Measurement:
    """A refused bias is an error that a person must hear of."""
    refused = bool(np.any(decided["boot_check"] == BOOT_CHECKS["refused"]))
    codes = frames(recording, role, "fault")["code"]
    said = bool(np.any(codes == FAULT_CODES["cal_bias_refused"]))
    how = (
        f"boot check {'refused' if refused else 'did not refuse'} the bias, "
        f"FAULT {'sent' if said else 'not sent'}"
    )
    value = float(refused != said) if decided.size else math.nan
    return judged(f"cal.{role}.refusal_unsaid", value, "C2", c, how)


def _truth(
    recording: Recording, role: str, decided: NDArray[Any], c: Conditions
) -> list[Measurement]:
    """Against the biases that the simulated chip has; nothing where they are not known."""
    scenario = recording.provenance.scenario
    if recording.provenance.source not in SIMULATED_SOURCES:
        return []
    node = scenario.get("nodes", {}).get(role, {})
    bias = np.zeros(3)
    if scenario.get("motion"):
        population = node.get("imu", {}).get("errors", "calibrated")
        bias = chip_errors(int(scenario.get("seed", 1)), role, population).gyro_bias_radps
    stored = np.zeros(3)
    if "calibration" in node:
        stored = bias + np.radians(node["calibration"].get("gyro_offset_dps", [0.0] * 3))
    delta_dps = float(np.degrees(np.linalg.norm(bias - stored)))
    wanted = stored if delta_dps > REFUSE_DPS else bias
    names = (f"cal.{role}.gyro_bias_error_dps", f"cal.{role}.boot_delta_error_dps")
    if decided.size == 0:
        how = "the boot check never decided"
        return [
            judged(name, math.nan, line, c, how)
            for name, line in zip(names, ("C3", "C4"), strict=True)
        ]
    error = np.degrees(np.abs(decided["gyro_bias_radps"].astype(np.float64) - wanted))
    off = np.abs(decided["boot_delta_dps"].astype(np.float64) - delta_dps)
    return [
        judged(
            names[0],
            float(error.max()),
            "C3",
            c,
            f"worst axis in {decided.size} CAL frames against the simulated chip's own bias"
            + (", which was stored" if delta_dps > REFUSE_DPS else ""),
        ),
        judged(
            names[1],
            float(off.max()),
            "C4",
            c,
            f"distance of boot bias and stored bias, reported against true: {delta_dps:.3f} dps",
        ),
    ]


def _estimator(recording: Recording, c: Conditions) -> list[Measurement]:
    """The estimator must not see a sample from before the decision."""
    states = frames(recording, "leader", "ekf_state")
    if states.size == 0:
        return []
    b = batches(recording, "leader", "leader")
    corrected = ~b.has("uncorrected")
    first = int(b.t_first_ticks[corrected].min()) if corrected.any() else np.iinfo(np.int64).max
    early = int(np.sum(states["t_ticks_leader"].astype(np.int64) < first))
    how = f"{states.size} EKF frames; the leader's first corrected sample came at tick {first}"
    return [judged("cal.leader.early_estimates", float(early), "C2", c, how)]


def _decisions(status: NDArray[Any]) -> list[dict[str, Any]]:
    """One row for each change of decision, attempts or bias in force, in the order of sending."""
    rows: list[dict[str, Any]] = []
    for frame in status:
        x, y, z = (round(float(v), 3) for v in np.degrees(frame["gyro_bias_radps"]))
        row = {
            "boot check": name_of(BOOT_CHECKS, frame["boot_check"]),
            "windows tried": int(frame["boot_attempts"]),
            "off the stored bias, dps": round(float(frame["boot_delta_dps"]), 3),
            "bias in force x, dps": x,
            "y, dps": y,
            "z, dps": z,
        }
        if not rows or row != rows[-1]:
            rows.append(row)
        if len(rows) == DECISIONS_MAX:
            break
    return rows
