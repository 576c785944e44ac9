// SPDX-License-Identifier: Apache-2.0
#include "hold.hpp"

#include <algorithm>

namespace bv
{

template <class Scalar> void Hold<Scalar>::clear()
{
	count = 0;
}

template <class Scalar>
bool Hold<Scalar>::steady(const Params<Scalar> &params, Ticks t_ticks, Scalar v_mps)
{
	if (count > 0) {
		least_mps = std::min(least_mps, v_mps);
		most_mps = std::max(most_mps, v_mps);
	}
	if (count == 0 || most_mps - least_mps > params.hold_range_mps) {
		count = 0;
		t_first_ticks = t_ticks;
		least_mps = v_mps;
		most_mps = v_mps;
		sum_mps = 0;
	}
	count++;
	sum_mps += v_mps;
	// Half a sample of room: where the rate divides the span, rounding must not decide.
	return seconds<Scalar>(t_ticks - t_first_ticks) >=
	       params.hold_span_s - Scalar(0.5) / params.rate_hz;
}

template <class Scalar>
Direct<Scalar, 1, AT_VZ> hold_measurement(const Params<Scalar> &params, const Hold<Scalar> &hold)
{
	Direct<Scalar, 1, AT_VZ> m;

	m.innovation[0] = -hold.sum_mps / static_cast<Scalar>(hold.count);
	m.variance = square(params.hold_sigma_mps);
	return m;
}

#define BV_INSTANTIATE(Scalar)                                                                     \
	template struct Hold<Scalar>;                                                              \
	template Direct<Scalar, 1, AT_VZ> hold_measurement(const Params<Scalar> &,                 \
							   const Hold<Scalar> &)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE

} // namespace bv
