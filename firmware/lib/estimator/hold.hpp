// SPDX-License-Identifier: Apache-2.0
/// A bar held at one height: its mean vertical velocity is zero but for sway.
/// docs/estimator.md, section 7.7; how it is told from a slow eccentric stands in
/// hil/reference/hold.py.
#ifndef BV_ESTIMATOR_HOLD_HPP_
#define BV_ESTIMATOR_HOLD_HPP_

#include "params.hpp"
#include "state.hpp"

namespace bv
{

/// The present span of steady vertical velocity.
template <class Scalar> struct Hold {
	std::int32_t count = 0;
	Ticks t_first_ticks = 0;
	Scalar least_mps = 0;
	Scalar most_mps = 0;
	Scalar sum_mps = 0;

	void clear();

	/// Feed the centre's vertical velocity; true when the span is long enough to be a hold.
	bool steady(const Params<Scalar> &params, Ticks t_ticks, Scalar v_mps);
};

/// 0 = mean of v_z over the span + n.
template <class Scalar>
Direct<Scalar, 1, AT_VZ> hold_measurement(const Params<Scalar> &params, const Hold<Scalar> &hold);

} // namespace bv

#endif // BV_ESTIMATOR_HOLD_HPP_
