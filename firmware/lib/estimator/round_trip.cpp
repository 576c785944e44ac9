// SPDX-License-Identifier: Apache-2.0
#include "round_trip.hpp"

#include <algorithm>

namespace bv
{
namespace
{

/// Was the anchor reached over a descent of about the same length, give or take drift_m?
template <class Scalar>
bool alike(const Params<Scalar> &params, const RoundTrip<Scalar> &trip,
	   const Anchor<Scalar> &anchor, Scalar drift_m)
{
	const Scalar longer = std::max(trip.travel_m, anchor.travel_m);

	return std::abs(trip.travel_m - anchor.travel_m) <=
	       Scalar(0.05) + params.travel_share * longer + drift_m;
}

/// Is the height too uncertain to tell turns apart?
template <class Scalar> bool in_doubt(const Params<Scalar> &params, const Nav<Scalar> &nav)
{
	return nav.P(AT_PZ, AT_PZ) > square(Scalar(0.5) * params.height_jump_m);
}

} // namespace

template <class Scalar>
bool boundary(const Params<Scalar> &params, const Nav<Scalar> &nav, RoundTrip<Scalar> &trip,
	      Ticks t_ticks, Scalar h_m, Scalar v_mps)
{
	const bool doubt = trip.count == 1 && in_doubt(params, nav);
	bool confirmed = false;

	trip.h_high_m = std::max(trip.h_high_m, h_m);
	if (trip.h_high_m - h_m > params.turn_travel_m ||
	    (doubt && v_mps <= params.turn_speed_mps)) {
		trip.armed = true;
	}
	if (trip.armed) {
		if (trip.v_last_mps <= 0 && v_mps > 0) {
			const Scalar u = -trip.v_last_mps / (v_mps - trip.v_last_mps);

			trip.crossed = true;
			trip.t_before_cross_ticks = trip.t_last_ticks;
			trip.cross_after_s = u * seconds<Scalar>(t_ticks - trip.t_last_ticks);
			trip.h_cross_m = trip.h_last_m + u * (h_m - trip.h_last_m);
			trip.travel_m = trip.h_high_m - trip.h_cross_m;
		}
		if (v_mps > params.turn_speed_mps) {
			confirmed = trip.crossed &&
				    trip.since_cross_s(t_ticks) <= params.turn_confirm_s;
			// A velocity that has drifted upwards may pass the turn without a crossing;
			// so steep a rise still shows it.
			if (!confirmed && doubt &&
			    v_mps - trip.v_last_mps >
				    params.turn_accel_mps2 *
					    seconds<Scalar>(t_ticks - trip.t_last_ticks)) {
				trip.t_before_cross_ticks = t_ticks;
				trip.cross_after_s = 0;
				trip.h_cross_m = h_m;
				trip.travel_m = trip.h_high_m - h_m;
				confirmed = true;
			}
			trip.armed = false;
			trip.h_high_m = h_m;
		}
	}
	trip.v_last_mps = v_mps;
	trip.h_last_m = h_m;
	trip.t_last_ticks = t_ticks;
	return confirmed;
}

template <class Scalar>
int associate(const Params<Scalar> &params, const Nav<Scalar> &nav, RoundTrip<Scalar> &trip)
{
	const Scalar variance = nav.P(AT_PZ, AT_PZ);
	const Scalar sigma = std::sqrt(variance);

	trip.doubt = in_doubt(params, nav);
	if (sigma > params.height_lost_m || (trip.doubt && trip.count > 1)) {
		trip.forget_anchors();
	}
	if (trip.doubt && trip.count == 1) {
		const Scalar distance = std::abs(trip.anchor[0].height_m - trip.h_cross_m);

		if (!alike(params, trip, trip.anchor[0], 2 * sigma) || distance > params.height_far_m ||
		    square(distance) >
			    params.doubt_gate * (variance + square(params.height_doubt_m))) {
			trip.forget_anchors();
		}
		return trip.count - 1;
	}

	int best = -1;
	Scalar best_distance = params.height_jump_m;

	for (int i = 0; i < trip.count; i++) {
		const Scalar distance = std::abs(trip.anchor[i].height_m - trip.h_cross_m);

		if ((best < 0 ? distance <= best_distance : distance < best_distance) &&
		    alike(params, trip, trip.anchor[i], Scalar(0))) {
			best = i;
			best_distance = distance;
		}
	}
	return best;
}

template <class Scalar>
void add_anchor(const Params<Scalar> &params, Nav<Scalar> &nav, RoundTrip<Scalar> &trip)
{
	Scalar variance = nav.P(AT_PZ, AT_PZ);

	if (trip.count == 0) {
		nav.P.template block<AT_PZ, 1>(0, AT_PZ).setZero();
		nav.P.template block<1, ERROR_STATES - AT_PZ>(AT_PZ, AT_PZ).setZero();
		nav.P(AT_PZ, AT_PZ) = square(params.height_sigma_m);
		variance = 0;
	}
	trip.anchor[trip.next] = {trip.h_cross_m, trip.travel_m, variance};
	trip.count = std::min(trip.count + 1, MAX_ANCHORS);
	trip.next = (trip.next + 1) % MAX_ANCHORS;
}

template <class Scalar>
Measurement<Scalar, 1, AT_PZ, AT_VZ, 3>
return_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
		   const RoundTrip<Scalar> &trip, int i, Ticks t_ticks)
{
	const Vector3<Scalar> s = matrix(nav.q) * params.lever_leader_m;
	Measurement<Scalar, 1, AT_PZ, AT_VZ, 3> m;

	m.innovation[0] = trip.anchor[i].height_m - trip.h_cross_m;
	m.variance = square(params.height_sigma_m) + trip.anchor[i].variance;
	if (trip.doubt) {
		m.variance += square(params.height_doubt_m);
	}
	m.coupling << -trip.since_cross_s(t_ticks), -s[1], s[0];
	return m;
}

#define BV_INSTANTIATE(Scalar)                                                                     \
	template bool boundary(const Params<Scalar> &, const Nav<Scalar> &, RoundTrip<Scalar> &,   \
			       Ticks, Scalar, Scalar);                                                            \
	template int associate(const Params<Scalar> &, const Nav<Scalar> &, RoundTrip<Scalar> &);  \
	template void add_anchor(const Params<Scalar> &, Nav<Scalar> &, RoundTrip<Scalar> &);      \
	template Measurement<Scalar, 1, AT_PZ, AT_VZ, 3> return_measurement(                       \
		const Params<Scalar> &, const Nav<Scalar> &, const RoundTrip<Scalar> &, int,       \
		Ticks)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE

} // namespace bv
