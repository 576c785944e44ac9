// SPDX-License-Identifier: Apache-2.0
/// Is the bar still? Detectors over a sliding window, and the updates that stillness allows.
/// docs/estimator.md, section 7.2.
#ifndef BV_ESTIMATOR_ZUPT_HPP_
#define BV_ESTIMATOR_ZUPT_HPP_

#include <array>

#include "params.hpp"
#include "state.hpp"

namespace bv
{

/// Last zupt_window filtered samples of one sensor, in no order that matters.
///
/// Means and variances are made anew from these rows. Running sums would keep the rounding of a
/// motion of 20 rad/s, 1e-5 in float, when judging a stillness of 1e-4. Anew costs some 600
/// instructions.
template <class Scalar> struct Window {
	std::array<Vector3<Scalar>, MAX_ZUPT_WINDOW> force{};
	std::array<Vector3<Scalar>, MAX_ZUPT_WINDOW> rate{};
	/// |force| - g
	std::array<Scalar, MAX_ZUPT_WINDOW> excess{};
	int filled = 0;
	int newest = -1;

	void push(const Params<Scalar> &params, const Vector3<Scalar> &f, const Vector3<Scalar> &w);
	void clear();
	bool full(const Params<Scalar> &params) const;
	/// Of a full window.
	Vector3<Scalar> mean_force(const Params<Scalar> &params) const;
};

/// Windows of both sensors and the count of consecutive detections.
template <class Scalar> struct Detector {
	Window<Scalar> leader;
	Window<Scalar> follower;
	std::int32_t hits = 0;
	Scalar refused_s = 0;
	Vector3<Scalar> gyro_bias_follower{Vector3<Scalar>::Zero()};
};

/// One sensor's verdict on its present window; Skog et al., IEEE TBME 2010, eq. 12 for SHOE.
template <class Scalar>
bool window_is_still(const Params<Scalar> &params, const Window<Scalar> &window,
		     const Vector3<Scalar> &b_g);

/// 0 = v + n.
template <class Scalar>
Measurement<Scalar, 3> velocity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav);

/// A still gyroscope shows its bias: rate = b_g + n.
template <class Scalar>
Measurement<Scalar, 3> rate_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					const Vector3<Scalar> &rate);

/// A still accelerometer shows the vertical: the horizontal part of R (f - b_a) is zero.
///
/// Nothing stands in the column of yaw: gravity says nothing about it.
template <class Scalar>
Measurement<Scalar, 2> gravity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					   const Vector3<Scalar> &mean_force);

} // namespace bv

#endif // BV_ESTIMATOR_ZUPT_HPP_
