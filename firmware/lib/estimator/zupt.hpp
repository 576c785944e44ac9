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

/// Sums of one sensor's filtered samples.
template <class Scalar> struct Moments {
	Vector3<Scalar> force{Vector3<Scalar>::Zero()};
	Vector3<Scalar> rate{Vector3<Scalar>::Zero()};
	/// |rate|^2
	Scalar rate2 = 0;
	/// |force| - g and its square.
	Scalar excess = 0;
	Scalar excess2 = 0;

	EIGEN_STRONG_INLINE Moments &operator+=(const Moments &other)
	{
		force += other.force;
		rate += other.rate;
		rate2 += other.rate2;
		excess += other.excess;
		excess2 += other.excess2;
		return *this;
	}
};

/// Last zupt_window filtered samples of one sensor, as sums.
///
/// The samples fall into two halves, filled in turn. The window is the half being filled, the
/// one before it, and what is left of the half before that; so it is the sum of a running sum,
/// of a finished one, and of one of the sums from a sample to the end of its half. The latter
/// are made for a half while the next one fills, one a step. Nothing is ever taken off a sum:
/// the rounding of a motion of 20 rad/s, 1e-5 in float, would stay in it, and stillness is
/// judged at 1e-4.
template <class Scalar> struct Window {
	/// Of a half being filled its samples, of the one before the sums to its end.
	std::array<Moments<Scalar>, MAX_ZUPT_WINDOW> slot{};
	/// Of the half being filled and of the one before.
	Moments<Scalar> running;
	Moments<Scalar> finished;
	int filled = 0;
	/// Slots of the last sample and of the next.
	int newest = 0;
	int next = 0;
	/// Slot of the half before that was summed up last.
	int summed = 0;

	void push(const Params<Scalar> &params, const Vector3<Scalar> &f, const Vector3<Scalar> &w);
	void clear();
	bool full(const Params<Scalar> &params) const;
	/// Of a full window.
	Moments<Scalar> sums(const Params<Scalar> &params) const;
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
Direct<Scalar, 3, AT_V> velocity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav);

/// A still gyroscope shows its bias: rate = b_g + n.
template <class Scalar>
Direct<Scalar, 3, AT_G> rate_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					 const Vector3<Scalar> &rate);

/// A still accelerometer shows the vertical: the horizontal part of R (f - b_a) is zero.
///
/// Nothing stands in the column of yaw: gravity says nothing about it.
template <class Scalar>
Measurement<Scalar, 2, NOWHERE, AT_T, 6>
gravity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
		    const Vector3<Scalar> &mean_force);

} // namespace bv

#endif // BV_ESTIMATOR_ZUPT_HPP_
