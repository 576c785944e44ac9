# SPDX-License-Identifier: Apache-2.0
"""Leads a person through a calibration: faces, rest, result, question, write, reset, check.

Nothing is written before the question. After it the unit's store changes whole or not at all, and
the record on disk is complete before the unit is told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.calibration.poses import (
    FACES,
    Face,
    FloatArray,
    Limits,
    Pose,
    PoseCollector,
    Stillness,
    joined,
    nearest_face,
)
from hil.calibration.record import Record, check_device
from hil.calibration.solve import GyroRest, gyro_rest, solve
from hil.calibration.tool.screen import Screen, reading_text, result_tables
from hil.calibration.tool.unit import Frame, Unit
from hil.core.calib import STANDARD_GRAVITY_MPS2
from hil.errors import HilError
from hil.wire.messages import BOOT_CHECKS, CAL_ORIGINS, CAL_REASONS

REST_S: Final = 60.0

Helper = Callable[[Face | None], None]
"""Somebody who turns the unit when a face, or any other pose (None), is asked for."""


@dataclass(frozen=True)
class Plan:
    """What is asked of the person.

    Attributes:
        poses: six faces, and as many free poses as are asked beyond.
        rest_s: of the gyroscope, in the unit's time.
        gravity_mps2: at this place.
    """

    poses: int = len(FACES)
    rest_s: float = REST_S
    gravity_mps2: float = STANDARD_GRAVITY_MPS2


def measure(unit: Unit, plan: Plan, screen: Screen, helper: Helper | None = None) -> Record:
    """Faces and rest; then the result, shown.

    Raises:
        RigError: the unit fell silent.
        HilError: what was measured cannot be a sound unit's.
    """
    with unit.raw():
        poses = take_poses(unit, plan, screen, helper)
        rest = take_rest(unit, plan, screen)
    calibration = solve(poses, rest, gravity_mps2=plan.gravity_mps2)
    for table in result_tables(calibration, poses, magnitudes_until_now(unit, poses)):
        screen.console.print(table)
    return Record(
        device_id=unit.device_id,
        role=unit.role,
        created_utc=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        temperature_degc=float(np.mean([pose.temperature_degc for pose in poses])),
        firmware_build_id=unit.build_id,
        poses=tuple(poses),
        gyro_samples=rest.n,
        calibration=calibration,
    )


def take_poses(unit: Unit, plan: Plan, screen: Screen, helper: Helper | None) -> list[Pose]:
    """One still pose after the other, each taken as soon as it is good."""
    collector = PoseCollector(gravity_mps2=plan.gravity_mps2)
    asked: list[Face | None] = [*FACES, *[None] * (plan.poses - len(FACES))]
    for number, face in enumerate(asked, 1):
        text = f"Lay the unit down with {face} up." if face else "Lean it so that a corner is up."
        screen.say(f"[bold]{number}/{len(asked)}[/bold]  {text}")
        if helper is not None:
            helper(face)
        pose = _take_pose(unit, screen, collector, face)
        up = nearest_face(pose.mean)
        magnitude = float(np.linalg.norm(pose.mean)) / plan.gravity_mps2
        screen.say(f"     taken: {up} up, {magnitude:.4f} g raw, {pose.n} samples", "green")
    return collector.poses


def _take_pose(unit: Unit, screen: Screen, collector: PoseCollector, face: Face | None) -> Pose:
    still = Stillness(limits=collector.limits, gravity_mps2=collector.gravity_mps2)
    unit.drop_samples()
    hint = ""
    with screen.live("     ") as bar:
        while True:
            reading = still.feed(unit.samples())
            if reading.state == "moving":
                hint = ""
            bar.show(reading.progress, reading_text(reading, hint))
            if still.block is None:
                continue
            found = collector.offer(still.block, face)
            if isinstance(found, Pose):
                return found
            # It lies still and wrong: say so until it is moved.
            hint = found.sentence
            still.restart()


def take_rest(unit: Unit, plan: Plan, screen: Screen) -> GyroRest:
    """The unit lies still for the gyroscope; a disturbance begins it anew."""
    screen.say(f"[bold]Rest[/bold]  Leave the unit as it lies for {plan.rest_s:g} s.")
    unit.drop_samples()
    unit.samples()
    wanted = round(plan.rest_s * unit.rate_hz)
    # Over a minute the bias wanders more than within a pose, and that is no movement.
    still = Stillness(max(wanted, 500), Limits(accel_drift_mg=5.0, gyro_drift_dps=0.3))
    begun_anew = 0
    progress = 0.0
    with screen.live("     ") as bar:
        while still.block is None:
            reading = still.feed(unit.samples())
            begun_anew += reading.progress < progress
            progress = reading.progress
            left_s = (1.0 - reading.progress) * wanted / unit.rate_hz
            bar.show(reading.progress, reading_text(reading, reading.why or f"{left_s:.0f} s left"))
    rest = gyro_rest(joined([still.block]).gyro_radps, unit.rate_hz)
    note = f", begun anew {begun_anew} times" if begun_anew else ""
    screen.say(f"     taken: {rest.n} samples at {rest.rate_hz:.1f} Hz{note}", "green")
    return rest


def magnitudes_until_now(unit: Unit, poses: list[Pose]) -> FloatArray | None:
    """(n,) m/s^2 that the calibration in force makes of the poses; None for the defaults."""
    if unit.status.get("origin") != CAL_ORIGINS["stored"]:
        return None
    matrix = np.asarray(unit.status["accel_matrix"], np.float64).reshape(3, 3)
    bias = np.asarray(unit.status["accel_bias_mps2"], np.float64)
    means = np.array([pose.mean for pose in poses])
    return np.asarray(np.linalg.norm((means - bias) @ matrix.T, axis=1))


def write(unit: Unit, record: Record, screen: Screen) -> None:
    """Store the record in the unit, compare, reset it, and look at its boot check.

    Raises:
        HilError: the record is another unit's, or the boot check does not confirm it.
        RigError: the unit refused it or fell silent; it then has the old one or the new one whole.
    """
    check_device(record, unit.device_id)
    values = as_frame(record)
    unit.write_record(values)
    screen.say("written, and read back equal", "green")
    screen.say("Resetting the unit; leave it lying.")
    unit.reboot()
    confirm_boot(unit, values, screen)


def confirm_boot(unit: Unit, written: Frame, screen: Screen) -> None:
    """What the unit says after its reset.

    Raises:
        HilError: another calibration is in force, or its boot check refused the bias.
    """
    status = unit.status
    if status["origin"] != CAL_ORIGINS["stored"]:
        reason = _name(CAL_REASONS, status["reason"])
        raise HilError(
            f"after the reset the unit uses its defaults: the record is {reason}",
            "write it again: hil calibrate --from FILE",
        )
    matrix = np.asarray(written["accel_matrix"], np.float32)
    if not np.array_equal(np.asarray(status["accel_matrix"], np.float32), matrix):
        raise HilError(
            "after the reset another calibration is in force than was written",
            "write it again: hil calibrate --from FILE",
        )
    check = _name(BOOT_CHECKS, status["boot_check"])
    delta_dps = float(status["boot_delta_dps"])
    sentence = f"boot check: {check}, gyroscope {delta_dps:.3f} dps from the stored bias"
    if check == "refused":
        raise HilError(
            f"{sentence}; at most 2 dps are believed",
            "was the unit turned while it started? lay it down and reset it\n"
            "else calibrate again: hil calibrate --role " + unit.role,
        )
    screen.say(sentence, "yellow" if check == "warned" else "green")


def as_frame(record: Record) -> dict[str, Any]:
    """A record as the values of CAL record on the wire."""
    calibration = record.calibration
    temperature = record.temperature_degc
    return {
        "device_id": int(record.device_id, 16),
        "created_unix_s": record.created_unix_s,
        "temperature_cdegc": round(100 * temperature) if np.isfinite(temperature) else -32768,
        "accel_bias_mps2": [float(np.float32(x)) for x in calibration.accel_bias_mps2],
        "accel_matrix": [float(np.float32(x)) for x in calibration.accel_matrix.ravel()],
        "gyro_bias_radps": [float(np.float32(x)) for x in calibration.gyro_bias_radps],
    }


def describe(unit: Unit) -> str:
    """One line: who is connected, and what is in force."""
    origin = _name(CAL_ORIGINS, unit.status["origin"])
    why = _name(CAL_REASONS, unit.status["reason"])
    state = origin if origin == "stored" else f"{origin} ({why})"
    return f"{unit.role} {unit.device_id}, build {unit.build_id}, calibration: {state}"


def save(record: Record, folder: Path, screen: Screen) -> Path:
    """Keep the record on disk, and say where."""
    path = folder / record.path.name
    record.save(path)
    screen.say(f"record: {path}")
    return path


def _name(names: dict[str, int] | Any, value: int) -> str:
    return next((name for name, number in names.items() if number == value), f"unknown ({value})")
