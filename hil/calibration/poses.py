# SPDX-License-Identifier: Apache-2.0
"""Is it still, and is it the face that was asked for?

:class:`Stillness` watches samples as they come and says when there are enough in a row.
:func:`judge` turns such a block into a :class:`Pose`, or into a :class:`Rejection` in words that
a person can act on. :class:`PoseCollector` keeps what was accepted.

Samples are raw, in SI units: counts times the nominal scale, sensor axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.core.calib import STANDARD_GRAVITY_MPS2

FloatArray = NDArray[np.float64]

SAMPLES_WANTED: Final = 500
"""Per pose: white noise of the mean is then 0.07 mg at 417 Hz, 0.1 mg at 833 Hz."""
WINDOW_SAMPLES: Final = 50
"""Stillness is judged window by window, so that a knock cannot hide in 500 quiet samples."""

# The chip's white noise at the widest bandwidth that the firmware calibrates in, 833 Hz (DS12814,
# table 2: 110 ug/rtHz at 16 g, 3.8 mdps/rtHz): 3.2 mg and 0.11 dps rms.
ACCEL_STD_LIMIT_MG: Final = 10.0
"""Three times the noise. A table that someone leans on shows 20 mg and more."""
GYRO_STD_LIMIT_DPS: Final = 0.4
"""Three and a half times the noise. A unit held in the hand shows 1 to 5 dps."""
ACCEL_DRIFT_LIMIT_MG: Final = 2.0
"""Between the means of the halves, whose difference noise makes 0.35 mg: 0.1 degree of turn."""
GYRO_DRIFT_LIMIT_DPS: Final = 0.1
"""Likewise; noise makes 0.01 dps, a warm-up of one kelvin another 0.01."""
TILT_LIMIT_DEG: Final = 8.0
"""Of the raw mean from the axis: 2 degrees of a hand, and what 60 mg of offset and 1 degree of
skew of an uncalibrated chip add to it."""
SAME_POSE_DEG: Final = 20.0
"""Free poses closer than this say nearly the same, and the fit then leans on their noise."""
LEAST_MAGNITUDE: Final = 0.5
GREATEST_MAGNITUDE: Final = 1.5
"""Of the mean over gravity: outside, this is no accelerometer at rest."""


class Face(StrEnum):
    """Which sensor axis points up, and so reads +g."""

    PLUS_X = "+x"
    MINUS_X = "-x"
    PLUS_Y = "+y"
    MINUS_Y = "-y"
    PLUS_Z = "+z"
    MINUS_Z = "-z"

    @property
    def axis(self) -> int:
        """0, 1 or 2."""
        return "xyz".index(self.value[1])

    @property
    def direction(self) -> FloatArray:
        """(3,) what an ideal sensor reads, in g."""
        up = np.zeros(3)
        up[self.axis] = 1.0 if self.value[0] == "+" else -1.0
        return up


FACES: Final = tuple(Face)
"""In the order of the closed forms."""


def nearest_face(mean_mps2: FloatArray) -> Face:
    """The face whose axis is nearest to the measured upward direction."""
    return max(FACES, key=lambda face: float(face.direction @ mean_mps2))


@dataclass(frozen=True, eq=False)
class Block:
    """n consecutive samples.

    Attributes:
        accel_mps2, gyro_radps: (n, 3).
        clipped: (n,) any axis at the end of its range; none if left out.
        temperature_degc: of the die; not a number when unknown.
    """

    accel_mps2: FloatArray
    gyro_radps: FloatArray
    clipped: NDArray[np.bool_] | None = None
    temperature_degc: float = float("nan")

    def __post_init__(self) -> None:
        n = len(self.accel_mps2)
        if self.accel_mps2.shape != (n, 3) or self.gyro_radps.shape != (n, 3):
            raise ValueError(
                f"accel_mps2 {self.accel_mps2.shape} and gyro_radps {self.gyro_radps.shape}: "
                "give (n, 3) each"
            )
        if self.clipped is not None and self.clipped.shape != (n,):
            raise ValueError(f"clipped {self.clipped.shape}: give ({n},)")

    def __len__(self) -> int:
        return len(self.accel_mps2)

    def __getitem__(self, part: slice) -> Block:
        clipped = None if self.clipped is None else self.clipped[part]
        return Block(self.accel_mps2[part], self.gyro_radps[part], clipped, self.temperature_degc)


def joined(blocks: Sequence[Block]) -> Block:
    """Blocks one after the other; the temperature is the mean over their samples."""
    known = [(len(b), b.temperature_degc) for b in blocks if np.isfinite(b.temperature_degc)]
    weight = sum(n for n, _ in known)
    return Block(
        np.concatenate([b.accel_mps2 for b in blocks]),
        np.concatenate([b.gyro_radps for b in blocks]),
        np.concatenate(
            [np.zeros(len(b), np.bool_) if b.clipped is None else b.clipped for b in blocks]
        ),
        sum(n * t for n, t in known) / weight if weight else float("nan"),
    )


@dataclass(frozen=True)
class Limits:
    """What counts as still and as the right way up; the defaults are this module's constants."""

    samples: int = SAMPLES_WANTED
    accel_std_mg: float = ACCEL_STD_LIMIT_MG
    gyro_std_dps: float = GYRO_STD_LIMIT_DPS
    accel_drift_mg: float = ACCEL_DRIFT_LIMIT_MG
    gyro_drift_dps: float = GYRO_DRIFT_LIMIT_DPS
    tilt_deg: float = TILT_LIMIT_DEG
    same_pose_deg: float = SAME_POSE_DEG


class Reason(StrEnum):
    """Why a block was not taken."""

    TOO_FEW = "too_few"
    NOT_FINITE = "not_finite"
    CLIPPED = "clipped"
    MOVING = "moving"
    NO_GRAVITY = "no_gravity"
    WRONG_FACE = "wrong_face"
    TILTED = "tilted"
    GIVEN_TWICE = "given_twice"


@dataclass(frozen=True)
class Rejection:
    """Why, and a sentence that says what to do."""

    reason: Reason
    sentence: str


@dataclass(frozen=True)
class Pose:
    """One orientation that was held still.

    Attributes:
        mean_mps2, std_mps2: of the raw accelerometer, per axis.
        gyro_mean_radps: of the raw gyroscope.
        n: samples.
        face: which of the six faces it was asked as; ``None`` for a free pose.
        temperature_degc: of the die; not a number when unknown.
    """

    mean_mps2: tuple[float, float, float]
    std_mps2: tuple[float, float, float]
    gyro_mean_radps: tuple[float, float, float]
    n: int
    face: Face | None = None
    temperature_degc: float = float("nan")

    @property
    def mean(self) -> FloatArray:
        """``mean_mps2`` as an array."""
        return np.array(self.mean_mps2)


def moving(
    block: Block, limits: Limits | None = None, gravity_mps2: float = STANDARD_GRAVITY_MPS2
) -> str:
    """What moves in a block, as a clause with its figure and limit; empty when it is still.

    A steady turn about the vertical looks like a gyroscope bias and cannot be seen here.
    """
    limits = limits or Limits()
    count = max(len(block) // WINDOW_SAMPLES, 1)
    windows = [block[i * WINDOW_SAMPLES :][:WINDOW_SAMPLES] for i in range(count)]
    # The samples left over at the end belong to the last window.
    windows[-1] = block[(count - 1) * WINDOW_SAMPLES :]
    unsteady = (_unsteady(window, limits, gravity_mps2) for window in windows)
    return next(filter(None, unsteady), "") or _drifting(
        block.accel_mps2, block.gyro_radps, len(block), limits, gravity_mps2
    )


def judge(
    block: Block,
    asked: Face | None = None,
    earlier: Iterable[Pose] = (),
    *,
    limits: Limits | None = None,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
) -> Pose | Rejection:
    """A block as a pose, or why not.

    Args:
        asked: the face that was asked for; ``None`` for a free pose.
        earlier: poses accepted so far: the same face, or for a free pose one within
            ``limits.same_pose_deg``, is not taken again.
    """
    limits = limits or Limits()
    return (
        _unusable(block, limits, gravity_mps2)
        or _misplaced(block.accel_mps2.mean(axis=0), asked, tuple(earlier), limits)
        or Pose(
            _triple(block.accel_mps2.mean(axis=0)),
            _triple(block.accel_mps2.std(axis=0)),
            _triple(block.gyro_radps.mean(axis=0)),
            len(block),
            asked,
            block.temperature_degc,
        )
    )


class PoseCollector:
    """Poses accepted so far, in order."""

    def __init__(
        self, limits: Limits | None = None, gravity_mps2: float = STANDARD_GRAVITY_MPS2
    ) -> None:
        self.limits = limits or Limits()
        self.gravity_mps2 = gravity_mps2
        self.poses: list[Pose] = []

    @property
    def missing(self) -> tuple[Face, ...]:
        """Faces of the six that are still to come."""
        given = {pose.face for pose in self.poses}
        return tuple(face for face in FACES if face not in given)

    def offer(self, block: Block, asked: Face | None = None) -> Pose | Rejection:
        """Judge a block and keep it when it is good."""
        found = judge(block, asked, self.poses, limits=self.limits, gravity_mps2=self.gravity_mps2)
        if isinstance(found, Pose):
            self.poses.append(found)
        return found


@dataclass(frozen=True)
class Reading:
    """What to show a person who is holding the unit.

    Attributes:
        state: ``moving`` when the newest window was not still and the count began anew.
        progress: 0 to 1 of the samples wanted.
        accel_mps2, gyro_radps: (3,) means of the newest samples.
        why: what moves, empty when still.
    """

    state: Literal["still", "moving"]
    progress: float
    accel_mps2: FloatArray
    gyro_radps: FloatArray
    why: str = ""


@dataclass
class Stillness:
    """Counts still samples as they come; a disturbance starts the count anew.

    Feed it chunks of any size. :attr:`block` holds the last ``wanted`` samples once there are
    that many; memory never exceeds that.

    Raises:
        ValueError: fewer samples are wanted than two windows.
    """

    wanted: int = SAMPLES_WANTED
    limits: Limits = field(default_factory=Limits)
    gravity_mps2: float = STANDARD_GRAVITY_MPS2

    def __post_init__(self) -> None:
        if self.wanted < 2 * WINDOW_SAMPLES:
            raise ValueError(f"{self.wanted} samples: ask for {2 * WINDOW_SAMPLES} or more")
        self._still: list[Block] = []
        self._means: list[tuple[FloatArray, FloatArray]] = []
        self._count = 0
        self._pending: list[Block] = []
        self._pending_count = 0
        self._why = ""
        self._newest = (np.zeros(3), np.zeros(3))

    @property
    def block(self) -> Block | None:
        """The still samples, once there are enough of them."""
        if self._count < self.wanted:
            return None
        whole = joined(self._still)
        return whole[len(whole) - self.wanted :]

    def restart(self) -> None:
        """Forget everything, as for the next pose."""
        self.__post_init__()

    def feed(self, chunk: Block) -> Reading:
        """Take the next samples and say how things stand."""
        if len(chunk):
            self._newest = (chunk.accel_mps2.mean(axis=0), chunk.gyro_radps.mean(axis=0))
            self._pending.append(chunk)
            self._pending_count += len(chunk)
        if self._pending_count >= WINDOW_SAMPLES:
            pending = joined(self._pending)
            whole = len(pending) // WINDOW_SAMPLES * WINDOW_SAMPLES
            for start in range(0, whole, WINDOW_SAMPLES):
                self._take(pending[start : start + WINDOW_SAMPLES])
            self._pending = [pending[whole:]]
            self._pending_count = len(pending) - whole
        return Reading(
            "moving" if self._why else "still",
            min(self._count / self.wanted, 1.0),
            *self._newest,
            self._why,
        )

    def _take(self, window: Block) -> None:
        self._why = _unsteady(window, self.limits, self.gravity_mps2)
        if self._why:
            self._still, self._means, self._count = [], [], 0
            return
        mean = (window.accel_mps2.mean(axis=0), window.gyro_radps.mean(axis=0))
        self._still.append(window)
        self._means.append(mean)
        self._count += WINDOW_SAMPLES
        if self._count - WINDOW_SAMPLES >= self.wanted:
            del self._still[0], self._means[0]
            self._count -= WINDOW_SAMPLES
        accel, gyro = (np.array(means) for means in zip(*self._means, strict=True))
        self._why = _drifting(accel, gyro, self._count, self.limits, self.gravity_mps2)
        if self._why:
            # The newest window may be the first one of a new rest.
            self._still, self._means, self._count = [window], [mean], WINDOW_SAMPLES


def _unsteady(block: Block, limits: Limits, gravity_mps2: float) -> str:
    """Whether the samples of one window vary by more than noise."""
    accel_mg = float(block.accel_mps2.std(axis=0).max()) / (gravity_mps2 * 1e-3)
    gyro_dps = float(np.degrees(block.gyro_radps.std(axis=0).max()))
    if gyro_dps > limits.gyro_std_dps:
        return f"the rate of turn varies by {gyro_dps:.1f} dps, at most {limits.gyro_std_dps:g}"
    if accel_mg > limits.accel_std_mg:
        return f"the acceleration varies by {accel_mg:.0f} mg, at most {limits.accel_std_mg:g}"
    return ""


def _drifting(
    accel_mps2: FloatArray, gyro_radps: FloatArray, count: int, limits: Limits, gravity_mps2: float
) -> str:
    """Whether the second half differs from the first; rows may be means, ``count`` is of samples.

    Halves of a short block differ by their noise alone, so the limits widen below 500 samples.
    """
    half = len(accel_mps2) // 2
    if not half:
        return ""
    wider = max(1.0, float(np.sqrt(SAMPLES_WANTED / count)))
    accel, gyro = (
        float(np.linalg.norm(x[half:].mean(axis=0) - x[:half].mean(axis=0)))
        for x in (accel_mps2, gyro_radps)
    )
    accel_mg, gyro_dps = accel / (gravity_mps2 * 1e-3), float(np.degrees(gyro))
    if accel_mg > wider * limits.accel_drift_mg:
        return f"it turned meanwhile, by {accel_mg:.1f} mg, at most {limits.accel_drift_mg:g}"
    if gyro_dps > wider * limits.gyro_drift_dps:
        return f"its rate of turn drifted by {gyro_dps:.2f} dps, at most {limits.gyro_drift_dps:g}"
    return ""


def _unusable(block: Block, limits: Limits, gravity_mps2: float) -> Rejection | None:
    """What is wrong with a block whatever it was asked for."""
    if len(block) < limits.samples:
        return Rejection(
            Reason.TOO_FEW,
            f"{len(block)} samples, {limits.samples} are needed: hold it still for longer",
        )
    if not (np.isfinite(block.accel_mps2).all() and np.isfinite(block.gyro_radps).all()):
        return Rejection(
            Reason.NOT_FINITE, "a sample is not a number: look at where the samples come from"
        )
    if block.clipped is not None and block.clipped.any():
        return Rejection(
            Reason.CLIPPED,
            f"{int(block.clipped.sum())} samples are at the end of the range: "
            "put it down gently, and use 4 g or more",
        )
    what = moving(block, limits, gravity_mps2)
    if what:
        return Rejection(Reason.MOVING, f"{what}: lay it down and let go of it")
    magnitude = float(np.linalg.norm(block.accel_mps2.mean(axis=0))) / gravity_mps2
    if not LEAST_MAGNITUDE < magnitude < GREATEST_MAGNITUDE:
        return Rejection(
            Reason.NO_GRAVITY,
            f"it measures {magnitude:.2f} g at rest: look at the full scale and the sensor",
        )
    return None


def _misplaced(
    mean_mps2: FloatArray, asked: Face | None, earlier: Sequence[Pose], limits: Limits
) -> Rejection | None:
    """What is wrong with an orientation."""
    if asked is None:
        near = [_angle_deg(mean_mps2, pose.mean) for pose in earlier]
        if near and min(near) < limits.same_pose_deg:
            at = int(np.argmin(near))
            return Rejection(
                Reason.GIVEN_TWICE,
                f"only {near[at]:.0f} deg from pose {at + 1}, at least "
                f"{limits.same_pose_deg:g} are needed: turn it further",
            )
        return None
    found = nearest_face(mean_mps2)
    if found is not asked:
        opposite = found.axis == asked.axis
        turn = "turn it over" if opposite else f"turn it until {asked} points up"
        return Rejection(Reason.WRONG_FACE, f"this is {found} up, {asked} was asked: {turn}")
    tilt_deg = _angle_deg(mean_mps2, asked.direction)
    if tilt_deg > limits.tilt_deg:
        return Rejection(
            Reason.TILTED,
            f"{asked} is {tilt_deg:.0f} deg off the vertical, at most {limits.tilt_deg:g}: "
            "set it upright",
        )
    if any(pose.face is asked for pose in earlier):
        return Rejection(
            Reason.GIVEN_TWICE, f"{asked} up has been taken already: go on to another face"
        )
    return None


def _angle_deg(a: FloatArray, b: FloatArray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _triple(x: FloatArray) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])
