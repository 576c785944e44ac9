// SPDX-License-Identifier: Apache-2.0
/// Front end of one sensor: rotation to the bar frame, low-pass with a known delay, clip memory.
///
/// Both prefilters run on all six channels alike, so force and rate stay aligned.
#ifndef BV_ESTIMATOR_PREFILTER_HPP_
#define BV_ESTIMATOR_PREFILTER_HPP_

#include "iir_filter.hpp"
#include "moving_average.hpp"
#include "params.hpp"

namespace bv
{

/// One raw sample in SI units, sensor frame.
template <class Scalar> struct Sample {
	/// When it was taken, on the leader's clock.
	Ticks t_ticks = 0;
	Vector3<Scalar> accel_mps2{Vector3<Scalar>::Zero()};
	Vector3<Scalar> gyro_radps{Vector3<Scalar>::Zero()};
	/// Any axis at the end of its range.
	bool clipped = false;
	/// Standard deviation of t_ticks against the leader's clock (follower only).
	Scalar t_sigma_s = 0;
};

/// What follows from the parameters for the front end; worked out once.
template <class Scalar> struct PrefilterCoefficients {
	IirCoefficients<Scalar> iir;
	Scalar delay_samples = 0;
	Ticks delay_ticks = 0;
	/// Samples for which the filter remembers a clipped one.
	int clip_hold = 0;

	static PrefilterCoefficients of(const Params<Scalar> &params);
};

/// A sample in the bar frame, filtered.
template <class Scalar> struct Filtered {
	Vector3<Scalar> force;
	Vector3<Scalar> rate;
	/// A clipped sample is still in the filter's memory.
	bool clipped;
};

template <class Scalar> struct Channel {
	MovingAverage<Scalar> average;
	IirFilter<Scalar> iir;
	int clip_left = 0;

	Filtered<Scalar> filter(const Params<Scalar> &params,
				const PrefilterCoefficients<Scalar> &coefficients,
				const Matrix3<Scalar> &rotation, const Sample<Scalar> &sample);
};

} // namespace bv

#endif // BV_ESTIMATOR_PREFILTER_HPP_
