// SPDX-License-Identifier: Apache-2.0
/// At the bottom of each touch-and-go repetition the bar is back where it was.
///
/// docs/estimator.md, section 7.4; how turns are detected and told apart, and why nothing is
/// claimed about the velocity there, stands in hil/reference/round_trip.py.
#ifndef BV_ESTIMATOR_ROUND_TRIP_HPP_
#define BV_ESTIMATOR_ROUND_TRIP_HPP_

#include "params.hpp"
#include "state.hpp"

namespace bv
{

constexpr int MAX_ANCHORS = 4;

/// A turn's height and the length of the descent to it.
template <class Scalar> struct Anchor {
	Scalar height_m = 0;
	Scalar travel_m = 0;
	/// Of its height at its birth; part of R ever after.
	Scalar variance = 0;
};

/// Memory of the boundary detector and the anchors.
template <class Scalar> struct RoundTrip {
	bool armed = false;
	Scalar h_high_m = Scalar(-1e9);
	Scalar v_last_mps = 0;
	Scalar h_last_m = 0;
	Ticks t_last_ticks = 0;
	/// The last crossing of zero velocity: a sample's time and the fraction of a step after it.
	bool crossed = false;
	Ticks t_before_cross_ticks = 0;
	Scalar cross_after_s = 0;
	Scalar h_cross_m = 0;
	Scalar travel_m = 0;
	/// The height is too uncertain to tell turns apart.
	bool doubt = false;
	int count = 0;
	int next = 0;
	Anchor<Scalar> anchor[MAX_ANCHORS];

	Scalar since_cross_s(Ticks t_ticks) const
	{
		return seconds<Scalar>(t_ticks - t_before_cross_ticks) - cross_after_s;
	}

	/// Watch for a descent from here on.
	void begin_descent()
	{
		armed = false;
		crossed = false;
		h_high_m = Scalar(-1e9);
	}

	void forget_anchors()
	{
		count = 0;
		next = 0;
	}
};

/// Feed height and vertical velocity of the bar's centre; true when a boundary is confirmed.
/// While the height is in doubt, a steep rise is enough.
template <class Scalar>
bool boundary(const Params<Scalar> &params, const Nav<Scalar> &nav, RoundTrip<Scalar> &trip,
	      Ticks t_ticks, Scalar h_m, Scalar v_mps);

/// Index of the anchor that the candidate returns to; -1 when there is none.
///
/// Drops all anchors when the height has become too uncertain to tell them apart.
template <class Scalar>
int associate(const Params<Scalar> &params, const Nav<Scalar> &nav, RoundTrip<Scalar> &trip);

/// The candidate becomes an anchor; the first one also becomes the origin of the height.
template <class Scalar>
void add_anchor(const Params<Scalar> &params, Nav<Scalar> &nav, RoundTrip<Scalar> &trip);

/// One return to the height of anchor[i]: 0 = h(t_c) - h_anchor + n.
template <class Scalar>
Measurement<Scalar, 1, AT_PZ, AT_VZ, 3>
return_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
		   const RoundTrip<Scalar> &trip, int i, Ticks t_ticks);

} // namespace bv

#endif // BV_ESTIMATOR_ROUND_TRIP_HPP_
