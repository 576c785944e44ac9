// SPDX-License-Identifier: Apache-2.0
/// Parameters of the estimator: unit in the name, default, and effect of a larger value.
///
/// Everything that is chosen, nothing that is computed (docs/estimator.md, section 3). Names and
/// defaults are those of hil/reference/params.py; a test holds them together.
#ifndef BV_ESTIMATOR_PARAMS_HPP_
#define BV_ESTIMATOR_PARAMS_HPP_

#include "types.hpp"

/// The build's choice of prefilter: 0 moving average, 1 Butterworth.
#ifndef BV_PREFILTER_IIR_DEFAULT
#define BV_PREFILTER_IIR_DEFAULT 0
#endif

namespace bv
{

constexpr int MAX_AVERAGE_LENGTH = 16;
constexpr int MAX_ZUPT_WINDOW = 64;

template <class Scalar> struct Params {
	// Geometry: bar frame, origin at the bar's centre; rotations take sensor to bar vectors.
	Scalar rate_hz = Scalar(416);
	Scalar gravity_mps2 = Scalar(9.80665);
	Vector3<Scalar> lever_leader_m{Scalar(1.05), Scalar(0), Scalar(0.02)};
	Vector3<Scalar> lever_follower_m{Scalar(-1.05), Scalar(0), Scalar(0.02)};
	Matrix3<Scalar> rotation_leader{Matrix3<Scalar>::Identity()};
	Matrix3<Scalar> rotation_follower{Vector3<Scalar>(-1, -1, 1).asDiagonal()};

	// Prefilter.
	bool prefilter_iir = BV_PREFILTER_IIR_DEFAULT != 0; // false: average; true: Butterworth
	std::int32_t average_length = 4; // more: less vibration, later, and duller peaks
	Scalar cutoff_hz = Scalar(15);   // more: earlier, and more vibration

	// Process noise: densities (per sqrt(Hz)) and random walks (per sqrt(s)).
	// More: quicker to believe the constraints, and noisier between them.
	Scalar accel_noise_mps2_rthz = Scalar(1.1e-3); // datasheet 1.08e-3 at +-16 g, quantisation
	Scalar gyro_noise_radps_rthz = Scalar(7.0e-5); // datasheet 6.6e-5
	Scalar accel_walk_mps2_rts = Scalar(1.5e-4);
	Scalar gyro_walk_radps_rts = Scalar(3.0e-6);
	Scalar accel_scale_sigma = Scalar(1.0e-3); // scale and misalignment after calibration
	Scalar gyro_scale_sigma = Scalar(1.0e-3);
	Scalar turn_step_rad = Scalar(0.25); // turns below this show gravity from no new side
	Scalar turn_fresh_rad = Scalar(0.8); // ... makes the other sensor's word news again
	Scalar impact_share = Scalar(0.05);  // of the change between samples, possibly missed
	Scalar clip_sigma_mps2 = Scalar(500); // unknown part of a clipped sample
	Scalar clip_sigma_radps = Scalar(3);

	// Initial uncertainty and alignment.
	Scalar align_s = Scalar(0.5); // more: a better level, a later start
	Scalar accel_bias_sigma_mps2 = Scalar(0.014); // bias, and misalignment of gravity
	Scalar gyro_bias_sigma_radps = Scalar(2.0e-3);
	Scalar gyro_bias_sigma_still_radps = Scalar(1.0e-4);
	Scalar tilt_sigma_still_rad = Scalar(1.2e-4);
	Scalar tilt_sigma_moving_rad = Scalar(0.05);
	Scalar velocity_sigma_still_mps = Scalar(0.01);
	Scalar velocity_sigma_moving_mps = Scalar(0.3);

	// Rigid body: the second IMU.
	std::int32_t rigid_samples = 8;      // residuals averaged before each update
	Scalar rigid_gate = Scalar(16.27);   // chi-square, 3 degrees of freedom, 0.1 %
	Scalar rigid_forget = Scalar(0.1);   // share of the newest in the running mean square
	std::int32_t rigid_fast = 25;        // updates that share the first look at its bias
	Scalar rigid_spread_s = Scalar(30);  // after that, it counts once in this time
	Scalar follower_timeout_s = Scalar(0.15); // silent for longer: lost
	Scalar lever_sigma_m = Scalar(0.004);     // more: less weight in fast rotation
	Scalar rigid_accel_sigma_mps2 = Scalar(0.05);
	Scalar rigid_gyro_sigma_radps = Scalar(3.0e-3);

	// Zero-velocity detection and update.
	bool zupt_shoe = false; // false: variances; true: SHOE
	std::int32_t zupt_window = 32; // samples; more: surer and later
	std::int32_t zupt_dwell = 40;  // detections in a row; more: surer and later
	Scalar zupt_accel_var = Scalar(4.0e-4); // (m/s^2)^2 of |a| - g: sooner, and wrongly
	Scalar zupt_gyro_var = Scalar(1.2e-4);  // (rad/s)^2 of |w|
	Scalar zupt_level_mps2 = Scalar(0.3);   // mean of |a| - g; large biases need more
	Scalar zupt_release = Scalar(4);        // times a threshold in one sample: moving
	Scalar shoe_threshold = Scalar(20);
	Scalar shoe_accel_sigma_mps2 = Scalar(0.02);
	Scalar shoe_gyro_sigma_radps = Scalar(2.0e-3);
	Scalar zupt_variance = Scalar(1e-4); // R_ZUPT, (m/s)^2 on each update
	Scalar zupt_gate = Scalar(16.27);
	Scalar zupt_force_s = Scalar(0.7); // detections against the filter's belief: it is lost
	Scalar zaru_sigma_radps = Scalar(6e-4);    // zero angular rate, on each update
	Scalar gravity_sigma_mps2 = Scalar(0.02);  // gravity alignment, on each update

	// Round trip.
	bool round_trip = true;
	Scalar height_sigma_m = Scalar(0.015); // spread of one turn; more: weaker
	Scalar round_trip_gate = Scalar(9);
	Scalar turn_speed_mps = Scalar(0.15); // hysteresis of the boundary detector
	Scalar turn_travel_m = Scalar(0.12);
	Scalar turn_accel_mps2 = Scalar(1);     // in doubt, so steep a rise is a turn
	Scalar turn_confirm_s = Scalar(0.35);
	Scalar height_jump_m = Scalar(0.15); // further off than this is another turning point
	Scalar travel_share = Scalar(0.25);  // by which two descents to one turn may differ
	Scalar height_lost_m = Scalar(0.8);  // height less certain: anchors mean nothing more
	Scalar height_far_m = Scalar(1);  // in doubt, further off: another turning point
	Scalar doubt_gate = Scalar(9);
	Scalar height_doubt_m = Scalar(0.03); // added spread while turns can hardly be told apart
	Scalar height_walk_m_rts = Scalar(1e-4);

	// A bar held at one height after it was turned over.
	Scalar hold_span_s = Scalar(0.35);    // of steady vertical velocity; 0: off
	Scalar hold_range_mps = Scalar(0.04); // within which a velocity is steady
	Scalar hold_sigma_mps = Scalar(0.02); // mean velocity over a hold; more: weaker
	Scalar hold_gate = Scalar(9);
	Scalar hold_turn_radps = Scalar(2.5); // turned faster since the last rest: turned over

	// Weak bound on horizontal speed: what levels the attitude where nothing is ever still.
	Scalar bound_period_s = Scalar(0.5); // 0: off
	Scalar bound_sigma_mps = Scalar(0.3);

	Scalar madgwick_gain = Scalar(0.033); // beta of the baseline, rad/s (Madgwick 2010)
};

/// Call visit(name, member) for every member of a Params, const or not, in order.
template <class AnyParams, class Visit> void for_each_param(AnyParams &p, Visit &&visit)
{
#define BV_PARAM(name) visit(#name, p.name)
	BV_PARAM(rate_hz);
	BV_PARAM(gravity_mps2);
	BV_PARAM(lever_leader_m);
	BV_PARAM(lever_follower_m);
	BV_PARAM(rotation_leader);
	BV_PARAM(rotation_follower);
	BV_PARAM(prefilter_iir);
	BV_PARAM(average_length);
	BV_PARAM(cutoff_hz);
	BV_PARAM(accel_noise_mps2_rthz);
	BV_PARAM(gyro_noise_radps_rthz);
	BV_PARAM(accel_walk_mps2_rts);
	BV_PARAM(gyro_walk_radps_rts);
	BV_PARAM(accel_scale_sigma);
	BV_PARAM(gyro_scale_sigma);
	BV_PARAM(turn_step_rad);
	BV_PARAM(turn_fresh_rad);
	BV_PARAM(impact_share);
	BV_PARAM(clip_sigma_mps2);
	BV_PARAM(clip_sigma_radps);
	BV_PARAM(align_s);
	BV_PARAM(accel_bias_sigma_mps2);
	BV_PARAM(gyro_bias_sigma_radps);
	BV_PARAM(gyro_bias_sigma_still_radps);
	BV_PARAM(tilt_sigma_still_rad);
	BV_PARAM(tilt_sigma_moving_rad);
	BV_PARAM(velocity_sigma_still_mps);
	BV_PARAM(velocity_sigma_moving_mps);
	BV_PARAM(rigid_samples);
	BV_PARAM(rigid_gate);
	BV_PARAM(rigid_forget);
	BV_PARAM(rigid_fast);
	BV_PARAM(rigid_spread_s);
	BV_PARAM(follower_timeout_s);
	BV_PARAM(lever_sigma_m);
	BV_PARAM(rigid_accel_sigma_mps2);
	BV_PARAM(rigid_gyro_sigma_radps);
	BV_PARAM(zupt_shoe);
	BV_PARAM(zupt_window);
	BV_PARAM(zupt_dwell);
	BV_PARAM(zupt_accel_var);
	BV_PARAM(zupt_gyro_var);
	BV_PARAM(zupt_level_mps2);
	BV_PARAM(zupt_release);
	BV_PARAM(shoe_threshold);
	BV_PARAM(shoe_accel_sigma_mps2);
	BV_PARAM(shoe_gyro_sigma_radps);
	BV_PARAM(zupt_variance);
	BV_PARAM(zupt_gate);
	BV_PARAM(zupt_force_s);
	BV_PARAM(zaru_sigma_radps);
	BV_PARAM(gravity_sigma_mps2);
	BV_PARAM(round_trip);
	BV_PARAM(height_sigma_m);
	BV_PARAM(round_trip_gate);
	BV_PARAM(turn_speed_mps);
	BV_PARAM(turn_travel_m);
	BV_PARAM(turn_accel_mps2);
	BV_PARAM(turn_confirm_s);
	BV_PARAM(height_jump_m);
	BV_PARAM(travel_share);
	BV_PARAM(height_lost_m);
	BV_PARAM(height_far_m);
	BV_PARAM(doubt_gate);
	BV_PARAM(height_doubt_m);
	BV_PARAM(height_walk_m_rts);
	BV_PARAM(hold_span_s);
	BV_PARAM(hold_range_mps);
	BV_PARAM(hold_sigma_mps);
	BV_PARAM(hold_gate);
	BV_PARAM(hold_turn_radps);
	BV_PARAM(bound_period_s);
	BV_PARAM(bound_sigma_mps);
	BV_PARAM(madgwick_gain);
#undef BV_PARAM
}

/// What is wrong with the parameters and how to mend it; nullptr when nothing is.
template <class Scalar> const char *params_fault(const Params<Scalar> &p);

} // namespace bv

#endif // BV_ESTIMATOR_PARAMS_HPP_
