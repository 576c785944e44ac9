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
    SAMPLES_WANTED,
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
from hil.calibration.tool.screen import MARGIN, Screen, reading_text, result_tables
from hil.calibration.tool.unit import Frame, Unit
from hil.core.calib import STANDARD_GRAVITY_MPS2
from hil.errors import HilError
from hil.wire.messages import BOOT_CHECKS, CAL_ORIGINS, CAL_REASONS

REST_S: Final = 60.0
POSE_S: Final = 15.0
"""What a person needs for one position, roughly."""
KEPT: Final = "the unit keeps the calibration it had"

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

    @property
    def minutes(self) -> int:
        """What it takes, roughly."""
        return max(1, round((self.poses * POSE_S + self.rest_s) / 60.0))


def introduce(plan: Plan, screen: Screen) -> None:
    """What is to come, and how to get out of it."""
    more = plan.poses - len(FACES)
    screen.tell(
        f"Six faces{f', {more} more positions' if more else ''} and a rest of {plan.rest_s:g} s: "
        f"about {plan.minutes} min. Ctrl-C ends it at any time; {KEPT}."
    )
    screen.tell(
        "The axes are printed on the sensor's board, and its readings are shown: the axis that "
        "points up reads +1 g. Lay the unit down and let go of it; as soon as it has lain still "
        "for a second, the position is taken by itself. A degree or two askew does no harm."
        + (" Further positions are to be 20 degrees or more from all before." if more else "")
    )


def measure(unit: Unit, plan: Plan, screen: Screen, helper: Helper | None = None) -> Record:
    """Faces and rest; then the result, shown.

    Raises:
        RigError: the unit fell silent.
        HilError: what was measured cannot be a sound unit's.
    """
    introduce(plan, screen)
    with unit.raw():
        poses = take_poses(unit, plan, screen, helper)
        rest = take_rest(unit, plan, screen)
    calibration = solve(poses, rest, gravity_mps2=plan.gravity_mps2)
    screen.show(result_tables(calibration, poses, magnitudes_until_now(unit, poses)))
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
        screen.step(f"{number}/{len(asked)}", _asked_text(face))
        if helper is not None:
            helper(face)
        pose = _take_pose(unit, screen, collector, face)
        up = f"{nearest_face(pose.mean)} up" if face else "position"
        magnitude = float(np.linalg.norm(pose.mean)) / plan.gravity_mps2
        screen.say(f"{MARGIN}{up} taken: {magnitude:.4f} g raw, {pose.n} samples", "green")
    return collector.poses


def _asked_text(face: Face | None) -> str:
    if face is None:
        return "Prop the unit up on a corner or an edge, unlike each time before."
    return f"Lay the unit down with {face} up: {face.value[1]} reads {face.value[0]}1 g."


def _take_pose(unit: Unit, screen: Screen, collector: PoseCollector, face: Face | None) -> Pose:
    still = Stillness(limits=collector.limits, gravity_mps2=collector.gravity_mps2)
    unit.drop_samples()
    hint = ""
    with screen.live() as bar:
        while True:
            reading = still.feed(unit.samples())
            if reading.state == "moving":
                hint = ""
            moving = f"moving: {reading.why}" if reading.why else ""
            words = hint or moving or "still: leave it as it is"
            bar.show(reading.progress, reading_text(reading), words, bool(hint))
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
    screen.step("Rest", f"Leave the unit as it lies for {plan.rest_s:g} s; do not touch the table.")
    unit.drop_samples()
    unit.samples()
    wanted = max(round(plan.rest_s * unit.rate_hz), SAMPLES_WANTED)
    # Over a minute the bias wanders more than within a pose, and that is no movement.
    still = Stillness(
        wanted,
        Limits(accel_drift_mg=5.0, gyro_drift_dps=0.3),
        gravity_mps2=plan.gravity_mps2,
    )
    begun_anew = 0
    progress = 0.0
    with screen.live() as bar:
        while still.block is None:
            reading = still.feed(unit.samples())
            begun_anew += reading.progress < progress
            progress = reading.progress
            left_s = (1.0 - reading.progress) * wanted / unit.rate_hz
            words = f"{reading.why}: begun anew" if reading.why else f"{left_s:.0f} s left"
            bar.show(reading.progress, reading_text(reading), words, bool(reading.why))
    rest = gyro_rest(joined([still.block]).gyro_radps, unit.rate_hz)
    times = "once" if begun_anew == 1 else f"{begun_anew} times"
    note = f", begun anew {times}" if begun_anew else ""
    screen.say(f"{MARGIN}rest taken: {rest.n} samples at {rest.rate_hz:.1f} Hz{note}", "green")
    return rest


def magnitudes_until_now(unit: Unit, poses: list[Pose]) -> FloatArray | None:
    """(n,) m/s^2 that the calibration in force makes of the poses; None for the defaults."""
    if unit.status.get("origin") != CAL_ORIGINS["stored"]:
        return None
    matrix = np.asarray(unit.status["accel_matrix"], np.float64).reshape(3, 3)
    bias = np.asarray(unit.status["accel_bias_mps2"], np.float64)
    means = np.array([pose.mean for pose in poses]).reshape(-1, 3)
    return np.asarray(np.linalg.norm((means - bias) @ matrix.T, axis=1))


def store(unit: Unit, record: Record, screen: Screen) -> None:
    """Store the record in the unit and compare what it reads back. It is in force from then on.

    Raises:
        HilError: the record is another unit's, or its date does not fit the wire.
        RigError: the unit refused it or fell silent; the message says what its store holds.
    """
    check_device(record, unit.device_id)
    unit.write_record(as_frame(record))
    screen.say("written, and read back equal", "green")


def confirm(unit: Unit, record: Record, screen: Screen) -> None:
    """Reset the unit, and look at its boot check.

    Raises:
        HilError: as :func:`confirm_boot`.
        RigError: the unit does not come back, or is moved.
    """
    screen.say("Resetting the unit; leave it lying.")
    unit.reboot()
    confirm_boot(unit, as_frame(record), screen)


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
    # The gyroscope's bias in force is the one of this boot.
    if any(
        not np.array_equal(np.asarray(status[name]), np.asarray(written[name], np.float32))
        for name in ("accel_bias_mps2", "accel_matrix")
    ):
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
    if check == "warned":
        screen.say(f"{sentence}: more than the usual 0.3 dps, and used", "yellow")
    else:
        screen.say(sentence, "green")


def as_frame(record: Record) -> dict[str, Any]:
    """A record as the values of CAL record on the wire.

    Raises:
        HilError: it is dated before 1970 or after 2106.
    """
    calibration = record.calibration
    temperature = record.temperature_degc
    if not 0 <= record.created_unix_s < 1 << 32:
        raise HilError(
            f"the record is dated {record.created_utc}, the unit counts from 1970 to 2106",
            "take another record, or calibrate again",
        )
    return {
        "device_id": int(record.device_id, 16),
        "created_unix_s": record.created_unix_s,
        "temperature_cdegc": round(100 * temperature) if np.isfinite(temperature) else -32768,
        "accel_bias_mps2": [float(np.float32(x)) for x in calibration.accel_bias_mps2],
        "accel_matrix": [float(np.float32(x)) for x in calibration.accel_matrix.ravel()],
        "gyro_bias_radps": [float(np.float32(x)) for x in calibration.gyro_bias_radps],
    }


def describe(unit: Unit) -> str:
    """One line: who is connected, and what it has stored.

    Raises:
        RigError: the unit does not answer.
    """
    return f"{unit.role} {unit.device_id}, build {unit.build_id}\ncalibration: {_stored(unit)}"


def _stored(unit: Unit) -> str:
    stored = unit.read_record()
    if stored is None:
        return f"defaults (record {_name(CAL_REASONS, unit.status['reason'])})"
    date = datetime.fromtimestamp(int(stored["created_unix_s"]), UTC)
    return f"stored, of {date:%Y-%m-%d %H:%M:%S} UTC"


def save(record: Record, folder: Path, screen: Screen) -> Path:
    """Keep the record on disk, and say where."""
    path = folder / record.path.name
    record.save(path)
    screen.say(f"record: {path}")
    return path


def _name(names: dict[str, int] | Any, value: int) -> str:
    return next((name for name, number in names.items() if number == value), f"unknown ({value})")
