// SPDX-License-Identifier: Apache-2.0
#ifndef BV_ESTIMATOR_IIR_FILTER_HPP_
#define BV_ESTIMATOR_IIR_FILTER_HPP_

#include "types.hpp"

namespace bv
{

/// Coefficients of a second-order section, a_0 = 1.
template <class Scalar> struct IirCoefficients {
	Scalar b0 = 1, b1 = 0, b2 = 0;
	Scalar a1 = 0, a2 = 0;
	/// Delay at zero frequency, samples.
	Scalar delay_samples = 0;
};

/// Second-order Butterworth low-pass, bilinear transform with pre-warping: docs/estimator.md (7).
///
/// Wants 0 < cutoff_hz < rate_hz / 2. Worked out in double whatever the Scalar: it runs once.
template <class Scalar> IirCoefficients<Scalar> butterworth2(double cutoff_hz, double rate_hz);

/// Six channels through one section in direct form II transposed.
///
/// Starts in the steady state of its first sample, so that a start is no step.
template <class Scalar> class IirFilter
{
public:
	using Vector6 = Eigen::Matrix<Scalar, 6, 1>;

	Vector6 operator()(const IirCoefficients<Scalar> &c, const Vector6 &x)
	{
		if (!primed_) {
			s2_ = (c.b2 - c.a2) * x;
			s1_ = (c.b1 - c.a1) * x + s2_;
			primed_ = true;
		}
		const Vector6 y = c.b0 * x + s1_;

		s1_ = c.b1 * x - c.a1 * y + s2_;
		s2_ = c.b2 * x - c.a2 * y;
		return y;
	}

private:
	Vector6 s1_{Vector6::Zero()};
	Vector6 s2_{Vector6::Zero()};
	bool primed_ = false;
};

} // namespace bv

#endif // BV_ESTIMATOR_IIR_FILTER_HPP_
