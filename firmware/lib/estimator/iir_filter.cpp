// SPDX-License-Identifier: Apache-2.0
#include "iir_filter.hpp"

#include "attitude.hpp"

namespace bv
{

template <class Scalar> IirCoefficients<Scalar> butterworth2(double cutoff_hz, double rate_hz)
{
	constexpr double pi = 3.14159265358979323846;
	// The quaternion of a turn by 2x about x is (cos x, sin x, 0, 0).
	const Quaternion<double> q = exp(Vector3<double>(2.0 * pi * cutoff_hz / rate_hz, 0.0, 0.0));
	const double k = q[1] / q[0];
	const double rt2 = std::sqrt(2.0);
	const double d = 1.0 + rt2 * k + k * k;
	IirCoefficients<Scalar> c;

	c.b0 = static_cast<Scalar>(k * k / d);
	c.b1 = static_cast<Scalar>(2.0 * k * k / d);
	c.b2 = c.b0;
	c.a1 = static_cast<Scalar>(2.0 * (k * k - 1.0) / d);
	c.a2 = static_cast<Scalar>((1.0 - rt2 * k + k * k) / d);
	c.delay_samples = static_cast<Scalar>(1.0 / (rt2 * k));
	return c;
}

template IirCoefficients<float> butterworth2(double, double);
template IirCoefficients<double> butterworth2(double, double);

} // namespace bv
