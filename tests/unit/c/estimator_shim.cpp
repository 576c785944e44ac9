// SPDX-License-Identifier: Apache-2.0
// The estimator's prefilters and step for ctypes; the estimator itself needs no such door.
#include "estimator.hpp"

namespace
{

template <class Scalar>
void filter(bool iir, Scalar cutoff_hz, Scalar rate_hz, int length, const Scalar *in, Scalar *out,
	    int n)
{
	bv::Params<Scalar> params;

	params.prefilter_iir = iir;
	params.cutoff_hz = cutoff_hz;
	params.rate_hz = rate_hz;
	params.average_length = length;
	const auto coefficients = bv::PrefilterCoefficients<Scalar>::of(params);
	bv::Channel<Scalar> channel;

	for (int k = 0; k < n; k++) {
		bv::Sample<Scalar> sample;

		sample.accel_mps2[2] = in[k];
		const bv::Filtered<Scalar> y = channel.filter(
			params, coefficients, bv::Matrix3<Scalar>::Identity(), sample);

		out[k] = y.force[2];
	}
}

template <class Scalar> void exponential(const Scalar *rotation_vector, Scalar *q)
{
	Eigen::Map<bv::Quaternion<Scalar>> result(q);

	result = bv::exp(bv::Vector3<Scalar>(rotation_vector[0], rotation_vector[1],
					     rotation_vector[2]));
}

} // namespace

extern "C" {

void shim_filter(bool iir, double cutoff_hz, double rate_hz, int length, const double *in,
		 double *out, int n)
{
	filter(iir, cutoff_hz, rate_hz, length, in, out, n);
}

void shim_filter_float(bool iir, float cutoff_hz, float rate_hz, int length, const float *in,
		       float *out, int n)
{
	filter(iir, cutoff_hz, rate_hz, length, in, out, n);
}

void shim_exp(const double *rotation_vector, double *q)
{
	exponential(rotation_vector, q);
}

void shim_from_gravity(const double *force, double *q)
{
	Eigen::Map<bv::Quaternion<double>> result(q);

	result = bv::from_gravity(bv::Vector3<double>(force[0], force[1], force[2]));
}

double shim_arctangent(double s, double c)
{
	return bv::arctangent(s, c);
}

// Steps through n samples at rest with asserts on; returns how many gave an estimate.
int shim_rest(int n)
{
	bv::Params<float> params;
	bv::Estimator<float> estimator(params);
	bv::Output<float> output;
	int estimated = 0;

	for (int k = 0; k < n; k++) {
		bv::Sample<float> sample;

		sample.t_ticks = k * bv::Ticks{38461};
		sample.accel_mps2[2] = params.gravity_mps2;
		estimated += estimator.step(sample, &sample, 1, output) == bv::Status::ESTIMATED;
	}
	return estimated;
}

}
