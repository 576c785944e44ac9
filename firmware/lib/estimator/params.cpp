// SPDX-License-Identifier: Apache-2.0
#include "params.hpp"

namespace bv
{
namespace
{

// A visitor that remembers whether all that it saw was finite.
struct Finite {
	bool all = true;

	void operator()(const char *, bool)
	{
	}

	void operator()(const char *, std::int32_t)
	{
	}

	void operator()(const char *, float x)
	{
		all = all && std::isfinite(x);
	}

	void operator()(const char *, double x)
	{
		all = all && std::isfinite(x);
	}

	template <class Derived> void operator()(const char *, const Eigen::MatrixBase<Derived> &x)
	{
		all = all && x.allFinite();
	}
};

} // namespace

template <class Scalar> const char *params_fault(const Params<Scalar> &p)
{
	Finite finite;

	for_each_param(p, finite);
	if (!finite.all) {
		return "a parameter is not a finite number: give each a finite value";
	}
	if (!(p.rate_hz > 0)) {
		return "rate_hz must be positive: give the measured sample rate";
	}
	if (!(p.gravity_mps2 > 0)) {
		return "gravity_mps2 must be positive";
	}
	if (p.average_length < 1 || p.average_length > MAX_AVERAGE_LENGTH) {
		return "average_length must be in 1..16";
	}
	if (!(p.cutoff_hz > 0 && p.cutoff_hz < Scalar(0.5) * p.rate_hz)) {
		return "cutoff_hz must lie above zero and below half of rate_hz";
	}
	if (p.zupt_window < 2 || p.zupt_window > MAX_ZUPT_WINDOW) {
		return "zupt_window must be in 2..64";
	}
	if (p.rigid_samples < 1 || p.zupt_dwell < 1 || p.rigid_fast < 0) {
		return "rigid_samples and zupt_dwell must be at least 1, rigid_fast at least 0";
	}
	if (!(p.zupt_variance > 0 && p.zaru_sigma_radps > 0 && p.gravity_sigma_mps2 > 0 &&
	      p.height_sigma_m > 0 && p.bound_sigma_mps > 0 && p.rigid_accel_sigma_mps2 > 0 &&
	      p.rigid_gyro_sigma_radps > 0)) {
		return "a measurement without noise: zupt_variance, zaru_sigma_radps, "
		       "gravity_sigma_mps2, height_sigma_m, bound_sigma_mps and the rigid_..._sigma "
		       "must be positive";
	}
	return nullptr;
}

template const char *params_fault(const Params<float> &);
template const char *params_fault(const Params<double> &);

} // namespace bv
