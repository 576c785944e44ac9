// SPDX-License-Identifier: Apache-2.0
#include "prefilter.hpp"

namespace bv
{

template <class Scalar>
PrefilterCoefficients<Scalar> PrefilterCoefficients<Scalar>::of(const Params<Scalar> &params)
{
	PrefilterCoefficients c;
	const auto rate_hz = static_cast<double>(params.rate_hz);

	c.iir = butterworth2<Scalar>(static_cast<double>(params.cutoff_hz), rate_hz);
	c.delay_samples = params.prefilter_iir
				  ? c.iir.delay_samples
				  : Scalar(0.5) * static_cast<Scalar>(params.average_length - 1);
	c.delay_ticks = static_cast<Ticks>(
		std::floor(static_cast<double>(c.delay_samples) * TICKS_PER_S / rate_hz + 0.5));
	c.clip_hold = static_cast<int>(std::ceil(2 * c.delay_samples)) + 1;
	return c;
}

template <class Scalar>
Filtered<Scalar> Channel<Scalar>::filter(const Params<Scalar> &params,
					 const PrefilterCoefficients<Scalar> &coefficients,
					 const Matrix3<Scalar> &rotation,
					 const Sample<Scalar> &sample)
{
	Eigen::Matrix<Scalar, 6, 1> x;

	x.template head<3>() = rotation * sample.accel_mps2;
	x.template tail<3>() = rotation * sample.gyro_radps;
	const Eigen::Matrix<Scalar, 6, 1> y =
		params.prefilter_iir ? iir(coefficients.iir, x) : average(params.average_length, x);

	if (sample.clipped) {
		clip_left = coefficients.clip_hold;
	}
	const bool clipped = clip_left > 0;

	if (clipped) {
		clip_left--;
	}
	return {y.template head<3>(), y.template tail<3>(), clipped};
}

template struct PrefilterCoefficients<float>;
template struct PrefilterCoefficients<double>;
template struct Channel<float>;
template struct Channel<double>;

} // namespace bv
