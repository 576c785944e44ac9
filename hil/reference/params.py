# SPDX-License-Identifier: Apache-2.0
"""Parameters of the estimator: unit in the name, default, and effect of a larger value."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hil.reference.attitude import FloatArray


def _vector(*values: float) -> FloatArray:
    return np.array(values, dtype=np.float64)


@dataclass(frozen=True)
class Params:
    """Everything that is chosen, nothing that is computed. See docs/estimator.md, section 3."""

    # Geometry: bar frame, origin at the bar's centre; rotations take sensor to bar vectors.
    rate_hz: float = 416.0
    gravity_mps2: float = 9.80665
    lever_leader_m: FloatArray = field(default_factory=lambda: _vector(1.05, 0.0, 0.02))
    lever_follower_m: FloatArray = field(default_factory=lambda: _vector(-1.05, 0.0, 0.02))
    rotation_leader: FloatArray = field(default_factory=lambda: np.eye(3))
    rotation_follower: FloatArray = field(default_factory=lambda: np.diag([-1.0, -1.0, 1.0]))

    # Prefilter.
    prefilter_iir: bool = False  # False: moving average; True: Butterworth
    average_length: int = 4  # more: less vibration, later, and duller peaks
    cutoff_hz: float = 15.0

    # Process noise: densities (per sqrt(Hz)) and random walks (per sqrt(s)).
    accel_noise_mps2_rthz: float = 1.1e-3  # datasheet 1.08e-3 at +-16 g, plus quantisation
    gyro_noise_radps_rthz: float = 7.0e-5  # datasheet 6.6e-5
    accel_walk_mps2_rts: float = 1.5e-4
    gyro_walk_radps_rts: float = 3.0e-6
    accel_scale_sigma: float = 1.0e-3  # scale and misalignment left by the calibration
    gyro_scale_sigma: float = 1.0e-3
    turn_step_rad: float = 0.25  # turns below this show gravity from no new side
    turn_fresh_rad: float = 0.8  # a turn by so much makes the other sensor's word news again
    impact_share: float = 0.05  # of the change between samples that may have been missed
    clip_sigma_mps2: float = 500.0  # unknown part of a clipped sample
    clip_sigma_radps: float = 3.0

    # Initial uncertainty and alignment.
    align_s: float = 0.5
    accel_bias_sigma_mps2: float = 0.014  # bias and what misalignment makes of gravity
    gyro_bias_sigma_radps: float = 2.0e-3
    gyro_bias_sigma_still_radps: float = 1.0e-4
    tilt_sigma_still_rad: float = 1.2e-4
    tilt_sigma_moving_rad: float = 0.05
    velocity_sigma_still_mps: float = 0.01
    velocity_sigma_moving_mps: float = 0.3

    # Rigid body: the second IMU.
    rigid_samples: int = 8  # residuals averaged before each update
    rigid_gate: float = 16.27  # chi-square, 3 degrees of freedom, 0.1 %
    rigid_forget: float = 0.1  # share of the newest residual in their running mean square
    rigid_fast: int = 25  # updates that share the first measurement of the follower's bias
    rigid_spread_s: float = 30.0  # after that, it counts once in this time
    follower_timeout_s: float = 0.15
    lever_sigma_m: float = 0.004
    rigid_accel_sigma_mps2: float = 0.05
    rigid_gyro_sigma_radps: float = 3.0e-3

    # Zero-velocity detection and update.
    zupt_shoe: bool = False  # False: variances; True: SHOE
    zupt_window: int = 32
    zupt_dwell: int = 40
    zupt_accel_var: float = 4.0e-4  # (m/s^2)^2 of |a| - g: larger fires sooner and wrongly
    zupt_gyro_var: float = 1.2e-4  # (rad/s)^2 of |w|
    zupt_level_mps2: float = 0.3  # mean of |a| - g: uncalibrated biases need more
    zupt_release: float = 4.0  # times a threshold in one sample: moving, whatever the window says
    shoe_threshold: float = 20.0
    shoe_accel_sigma_mps2: float = 0.02
    shoe_gyro_sigma_radps: float = 2.0e-3
    zupt_variance: float = 1e-4  # R_ZUPT, (m/s)^2 on each update
    zupt_gate: float = 16.27
    zupt_force_s: float = 0.7  # detections against the filter's belief for so long: it is lost
    zaru_sigma_radps: float = 6e-4  # zero angular rate, on each update
    gravity_sigma_mps2: float = 0.02  # gravity alignment, on each update

    # Round trip.
    round_trip: bool = True
    height_sigma_m: float = 0.015
    round_trip_gate: float = 9.0
    turn_speed_mps: float = 0.15  # hysteresis of the boundary detector
    turn_travel_m: float = 0.12
    turn_accel_mps2: float = 1.0  # in doubt, so steep a rise is a turn
    turn_confirm_s: float = 0.35
    height_jump_m: float = 0.15  # further off than this is another turning point
    travel_share: float = 0.25  # by which two descents to the same turn may differ
    height_lost_m: float = 0.8  # height less certain than this: anchors mean nothing any more
    height_far_m: float = 1.0  # in doubt, further off than this is another turning point
    doubt_gate: float = 9.0
    height_doubt_m: float = 0.03  # added spread while turns can hardly be told apart
    height_walk_m_rts: float = 1e-4

    # A bar held at one height after it was turned over.
    hold_span_s: float = 0.35  # of steady vertical velocity; 0: off
    hold_range_mps: float = 0.04  # within which a velocity is steady
    hold_sigma_mps: float = 0.02  # mean velocity over a hold; more: weaker
    hold_gate: float = 9.0
    hold_turn_radps: float = 2.5  # turned faster since the last rest: turned over

    # Weak bound on horizontal speed: what levels the attitude where nothing is ever still.
    bound_period_s: float = 0.5
    bound_sigma_mps: float = 0.3

    madgwick_gain: float = 0.033  # beta of the baseline, rad/s (Madgwick 2010: 0.033 for IMU)

    @property
    def dt_s(self) -> float:
        return 1.0 / self.rate_hz
