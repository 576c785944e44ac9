# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the estimator with unit, sensible range and meaning; parsed from text."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError
from hil.reference.params import Params


class ParameterError(HilError):
    """A parameter that does not exist, or a value that it cannot take."""


@dataclass(frozen=True)
class About:
    """Unit, the range of each number (both ends may be taken), and what a larger value does."""

    unit: str
    low: float
    high: float
    meaning: str

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:g} to {self.high:g}{unit}: {self.meaning}"


PARAMETERS: Final[Mapping[str, About]] = {
    "rate_hz": About("Hz", 12.0, 7000.0, "rate of the leader's IMU, as measured"),
    "gravity_mps2": About("m/s^2", 9.76, 9.84, "gravity where the bar is"),
    "lever_leader_m": About("m", -1.5, 1.5, "leader's IMU from the bar's centre, x,y,z"),
    "lever_follower_m": About("m", -1.5, 1.5, "follower's IMU from the bar's centre, x,y,z"),
    "rotation_leader": About("", -1.0, 1.0, "leader's sensor axes to the bar's, 9 numbers by row"),
    "rotation_follower": About("", -1.0, 1.0, "follower's sensor axes to the bar's, 9 by row"),
    "prefilter_iir": About("", 0, 1, "true: Butterworth; false: moving average"),
    "average_length": About("samples", 1, 16, "moving average; more: less vibration, duller peaks"),
    "cutoff_hz": About("Hz", 1.0, 200.0, "Butterworth's cutoff; more: less delay, more vibration"),
    "accel_noise_mps2_rthz": About("m/s^2/sqrt(Hz)", 1e-5, 1.0, "accelerometer's white noise"),
    "gyro_noise_radps_rthz": About("rad/s/sqrt(Hz)", 1e-7, 0.1, "gyroscope's white noise"),
    "accel_walk_mps2_rts": About("m/s^2/sqrt(s)", 0.0, 0.1, "walk of the accelerometer's bias"),
    "gyro_walk_radps_rts": About("rad/s/sqrt(s)", 0.0, 0.01, "walk of the gyroscope's bias"),
    "accel_scale_sigma": About("", 0.0, 0.1, "scale error and misalignment left by calibration"),
    "gyro_scale_sigma": About("", 0.0, 0.1, "scale error and misalignment left by calibration"),
    "turn_step_rad": About("rad", 0.0, 3.2, "turns below this show gravity from no new side"),
    "turn_fresh_rad": About("rad", 0.0, 6.4, "such a turn makes the follower's word news again"),
    "impact_share": About("", 0.0, 1.0, "of the change between samples that may be missed"),
    "clip_sigma_mps2": About("m/s^2", 0.0, 1e4, "unknown part of a clipped sample"),
    "clip_sigma_radps": About("rad/s", 0.0, 100.0, "unknown part of a clipped sample"),
    "align_s": About(
        "s", 0.05, 10.0, "levelling at the start; more: a better level, a later start"
    ),
    "accel_bias_sigma_mps2": About("m/s^2", 1e-5, 2.0, "accelerometer's bias before it is known"),
    "gyro_bias_sigma_radps": About("rad/s", 1e-7, 0.5, "gyroscope's bias, started on a moving bar"),
    "gyro_bias_sigma_still_radps": About("rad/s", 1e-7, 0.5, "the same, started at rest"),
    "tilt_sigma_still_rad": About("rad", 1e-7, 1.0, "level after a start at rest"),
    "tilt_sigma_moving_rad": About("rad", 1e-7, 1.0, "level after a start on a moving bar"),
    "velocity_sigma_still_mps": About("m/s", 1e-6, 5.0, "velocity after a start at rest"),
    "velocity_sigma_moving_mps": About("m/s", 1e-6, 5.0, "velocity after a start in motion"),
    "rigid_samples": About("samples", 1, 64, "residuals averaged before each rigid-body update"),
    "rigid_gate": About("", 0.1, 1000.0, "chi-square gate of the rigid body; more: accepts more"),
    "rigid_forget": About("", 0.0, 1.0, "share of the newest residual in their mean square"),
    "rigid_fast": About("updates", 0, 1000, "that share the first look at the follower's bias"),
    "rigid_spread_s": About("s", 0.01, 3600.0, "after that, it counts once in this time"),
    "follower_timeout_s": About("s", 0.001, 10.0, "a follower silent for longer is lost"),
    "lever_sigma_m": About("m", 0.0, 0.5, "lever arms; more: less weight in fast rotation"),
    "rigid_accel_sigma_mps2": About("m/s^2", 1e-5, 10.0, "force residual; more: weaker"),
    "rigid_gyro_sigma_radps": About("rad/s", 1e-6, 1.0, "rate residual; more: weaker"),
    "zupt_shoe": About("", 0, 1, "true: SHOE detector; false: variances"),
    "zupt_window": About("samples", 2, 64, "the detector looks at; more: surer and later"),
    "zupt_dwell": About("samples", 1, 2000, "detections in a row; more: surer and later"),
    "zupt_accel_var": About("(m/s^2)^2", 1e-8, 10.0, "variance of |a| - g; more: sooner, wrongly"),
    "zupt_gyro_var": About("(rad/s)^2", 1e-9, 1.0, "mean of |w|^2; more: sooner, wrongly"),
    "zupt_level_mps2": About("m/s^2", 0.0, 10.0, "mean of |a| - g; large biases need more"),
    "zupt_release": About("", 1.0, 100.0, "times a threshold in one sample: moving"),
    "shoe_threshold": About("", 0.01, 1e6, "SHOE's statistic; more: sooner, wrongly"),
    "shoe_accel_sigma_mps2": About("m/s^2", 1e-5, 10.0, "SHOE's accelerometer noise"),
    "shoe_gyro_sigma_radps": About("rad/s", 1e-6, 1.0, "SHOE's gyroscope noise"),
    "zupt_variance": About("(m/s)^2", 1e-10, 1.0, "R of the zero-velocity update; more: weaker"),
    "zupt_gate": About("", 0.1, 1000.0, "chi-square gate of the zero-velocity update"),
    "zupt_force_s": About("s", 0.0, 60.0, "detections against the belief: the filter is lost"),
    "zaru_sigma_radps": About("rad/s", 1e-7, 1.0, "zero angular rate; more: weaker"),
    "gravity_sigma_mps2": About("m/s^2", 1e-5, 10.0, "gravity alignment at rest; more: weaker"),
    "round_trip": About("", 0, 1, "true: the height returns at each turn"),
    "height_sigma_m": About("m", 1e-4, 1.0, "spread of one turn; more: weaker"),
    "round_trip_gate": About("", 0.1, 1000.0, "chi-square gate of the round trip"),
    "turn_speed_mps": About("m/s", 0.001, 2.0, "hysteresis of the boundary detector"),
    "turn_travel_m": About("m", 0.001, 2.0, "least descent before a turn"),
    "turn_accel_mps2": About("m/s^2", 0.0, 50.0, "in doubt, so steep a rise is a turn"),
    "turn_confirm_s": About("s", 0.0, 5.0, "longest wait for the rise after a turn"),
    "height_jump_m": About("m", 0.0, 5.0, "further off than this is another turning point"),
    "travel_share": About("", 0.0, 1.0, "by which two descents to one turn may differ"),
    "height_lost_m": About("m", 0.0, 100.0, "height less certain: anchors mean nothing more"),
    "height_far_m": About("m", 0.0, 100.0, "in doubt, further off: another turning point"),
    "doubt_gate": About("", 0.1, 1000.0, "chi-square gate of the round trip in doubt"),
    "height_doubt_m": About("m", 0.0, 1.0, "added spread while turns can hardly be told apart"),
    "height_walk_m_rts": About("m/sqrt(s)", 0.0, 1.0, "walk of the turning point's height"),
    "hold_span_s": About("s", 0.0, 10.0, "steady velocity that makes a hold; 0: off"),
    "hold_range_mps": About("m/s", 0.0, 1.0, "within which a velocity is steady"),
    "hold_sigma_mps": About("m/s", 1e-5, 10.0, "mean velocity over a hold; more: weaker"),
    "hold_gate": About("", 0.1, 1000.0, "chi-square gate of the hold"),
    "hold_turn_radps": About("rad/s", 0.0, 100.0, "turned faster since the last rest: turned over"),
    "bound_period_s": About("s", 0.0, 60.0, "between bounds on horizontal speed; 0: off"),
    "bound_sigma_mps": About("m/s", 1e-4, 100.0, "bound on horizontal speed; more: weaker"),
    "madgwick_gain": About("rad/s", 0.0, 10.0, "beta of the attitude baseline"),
}

WORDS: Final = {"true": True, "1": True, "on": True, "false": False, "0": False, "off": False}
NEAR: Final = 4
NUMBERS_MAX_CHARS: Final = 400
ROTATION_TOLERANCE: Final = 1e-6


def changed(base: Params, settings: Sequence[str]) -> Params:
    """``base`` with each NAME=VALUE of ``settings``; vectors as numbers joined by commas.

    Raises:
        ParameterError: no such parameter, not a value of its kind, out of its range, or given
            twice; the message names the near ones with unit and meaning.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = (part.strip() for part in setting.partition("="))
        if not equals:
            raise ParameterError(
                f"{setting[:80]!r} is not NAME=VALUE", "for example: zupt_dwell=60"
            )
        known(name)
        if name in values:
            raise ParameterError(f"{name} is given twice", "give each parameter once")
        values[name] = _value(name, text, getattr(base, name))
    params = dataclasses.replace(base, **values)
    if params.cutoff_hz >= 0.5 * params.rate_hz:
        raise ParameterError(
            f"cutoff_hz {params.cutoff_hz:g} is not below half of rate_hz {params.rate_hz:g}",
            "give a lower cutoff_hz",
        )
    return params


def known(name: str) -> About:
    """What is known of a parameter.

    Raises:
        ParameterError: there is none of that name; near ones are named.
    """
    if name not in PARAMETERS:
        raise ParameterError(f"no parameter {name[:80]!r}", _nearest(name))
    return PARAMETERS[name]


def differences(base: Params, other: Params) -> dict[str, tuple[Any, Any]]:
    """Parameters that are not the same in both: name -> (base's, other's)."""
    both = {name: (getattr(base, name), getattr(other, name)) for name in PARAMETERS}
    return {name: (a, b) for name, (a, b) in both.items() if not np.array_equal(a, b)}


def _nearest(name: str) -> str:
    parts = [known for known in PARAMETERS if name and name.lower() in known]
    near = list(dict.fromkeys([*difflib.get_close_matches(name, PARAMETERS, NEAR, 0.5), *parts]))[
        :NEAR
    ]
    if not near:
        return "all parameters stand in docs/estimator.md, section 3, and hil/reference/params.py"
    return "\n".join(f"{known} ({PARAMETERS[known]})" for known in near)


def _value(name: str, text: str, now: Any) -> Any:
    about = PARAMETERS[name]
    mend = f"{name}: {about}"
    if isinstance(now, bool):
        if text.lower() not in WORDS:
            raise ParameterError(f"{name}={text[:40]} is neither true nor false", mend)
        return WORDS[text.lower()]
    wanted = now.size if isinstance(now, np.ndarray) else 1
    try:
        numbers = [float(part) for part in text[:NUMBERS_MAX_CHARS].split(",")]
    except ValueError:
        raise ParameterError(f"{name}={text[:40]} is not a number", mend) from None
    if len(numbers) != wanted:
        raise ParameterError(f"{name} takes {wanted} numbers, {len(numbers)} are given", mend)
    outside = [x for x in numbers if not (math.isfinite(x) and about.low <= x <= about.high)]
    if outside:
        raise ParameterError(f"{name}={outside[0]:g} is out of its range", mend)
    if isinstance(now, np.ndarray):
        return _array(name, np.array(numbers).reshape(now.shape), mend)
    if isinstance(now, int):
        if not numbers[0].is_integer():
            raise ParameterError(f"{name}={numbers[0]:g} is not a whole number", mend)
        return int(numbers[0])
    return numbers[0]


def _array(name: str, value: NDArray[np.float64], mend: str) -> NDArray[np.float64]:
    if value.ndim == 2:
        off = np.abs(value @ value.T - np.eye(3)).max()
        if off > ROTATION_TOLERANCE or np.linalg.det(value) < 0.0:
            raise ParameterError(f"{name} is no rotation: rows must be a right-handed frame", mend)
    return value
