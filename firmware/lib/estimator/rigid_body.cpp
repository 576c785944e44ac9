// SPDX-License-Identifier: Apache-2.0
#include "rigid_body.hpp"

#include <algorithm>

namespace bv
{
namespace
{

/// How many times over the variance of the follower's bias is to be counted: it is a constant,
/// and a constant must not be averaged down by asking often.
template <class Scalar> Scalar repeats(const Params<Scalar> &params, std::int32_t fresh)
{
	if (fresh > 0) {
		return static_cast<Scalar>(params.rigid_fast);
	}
	return params.rigid_spread_s * params.rate_hz /
	       static_cast<Scalar>(2 * params.rigid_samples);
}

} // namespace

template <class Scalar> void Averager<Scalar>::clear()
{
	count = 0;
	force.setZero();
	rate.setZero();
	variance = 0;
	centripetal.setZero();
}

template <class Scalar>
void remember(History<Scalar> &history, Ticks t_ticks, const Vector3<Scalar> &force,
	      const Vector3<Scalar> &rate)
{
	Past<Scalar> newest{t_ticks, force, rate, Vector3<Scalar>::Zero()};

	if (history.size() >= 2) {
		const Past<Scalar> &before = history[history.size() - 2];

		newest.alpha = (rate - before.rate) / seconds<Scalar>(t_ticks - before.t_ticks);
		history[history.size() - 1].alpha = newest.alpha;
	}
	history.push(newest);
}

template <class Scalar>
bool at_time(const History<Scalar> &history, Ticks t_ticks, Past<Scalar> &leader,
	     Vector3<Scalar> &slope)
{
	const int newest = history.size() - 1;

	if (newest < 1 || t_ticks > history[newest].t_ticks || t_ticks < history[0].t_ticks) {
		return false;
	}
	// The last entry not later than t_ticks and not the newest: near where it would be if all
	// steps were as long as the last one.
	const Ticks newest_ticks = history[newest].t_ticks;
	const Scalar step_s = seconds<Scalar>(newest_ticks - history[newest - 1].t_ticks);
	const Scalar steps_back = seconds<Scalar>(newest_ticks - t_ticks) / step_s;
	int i = steps_back < static_cast<Scalar>(newest)
			? newest - 1 - static_cast<int>(steps_back)
			: 0;

	i = std::max(i, 0);
	while (i < newest - 1 && history[i + 1].t_ticks <= t_ticks) {
		i++;
	}
	while (history[i].t_ticks > t_ticks) {
		i--;
	}

	const Past<Scalar> &earlier = history[i];
	const Past<Scalar> &later = history[i + 1];
	const Scalar span_s = seconds<Scalar>(later.t_ticks - earlier.t_ticks);
	const Scalar u = seconds<Scalar>(t_ticks - earlier.t_ticks) / span_s;

	leader.t_ticks = t_ticks;
	leader.force = earlier.force + u * (later.force - earlier.force);
	leader.rate = earlier.rate + u * (later.rate - earlier.rate);
	leader.alpha = earlier.alpha + u * (later.alpha - earlier.alpha);
	slope = (later.force - earlier.force) / span_s;
	return true;
}

template <class Scalar>
void add_residual(const Params<Scalar> &params, const Nav<Scalar> &nav, Averager<Scalar> &sums,
		  const Past<Scalar> &leader, const Vector3<Scalar> &slope,
		  const Arrival<Scalar> &follower)
{
	const Vector3<Scalar> r = params.lever_follower_m - params.lever_leader_m;
	const Vector3<Scalar> w = leader.rate - nav.b_g;
	const Vector3<Scalar> wxr = cross(w, r);
	const Scalar w2 = w.squaredNorm();

	sums.force += leader.force + cross(leader.alpha, r) + cross(w, wxr) - follower.force;
	sums.rate += leader.rate - follower.rate;
	// d(w x (w x r)) = -([w x r]x + [w]x [r]x) dw, and [w]x [r]x = r w^T - (w . r) I.
	const Scalar wr = w.dot(r);
	Matrix3<Scalar> &C = sums.centripetal;

	// At -O2 GCC would leave the loop standing.
#pragma GCC unroll 3
	for (int i = 0; i < 3; i++) {
		const int next = (i + 1) % 3, last = (i + 2) % 3;

		C(i, i) += wr - r[i] * w[i];
		C(i, next) += wxr[last] - r[i] * w[next];
		C(i, last) -= wxr[next] + r[i] * w[last];
	}
	sums.variance += square(params.rigid_accel_sigma_mps2) +
			 slope.squaredNorm() * square(follower.t_sigma_s) +
			 square(params.lever_sigma_m * (leader.alpha.norm() + w2));
	sums.count++;
}

template <class Scalar>
Measurement<Scalar, 3, AT_A, AT_G, 3> rigid_force_measurement(const Params<Scalar> &params,
							      const Nav<Scalar> &nav,
							      const Averager<Scalar> &sums)
{
	const Scalar share = 1 / static_cast<Scalar>(sums.count);

	return {sums.force * share - nav.b_a,
		sums.variance * share +
			repeats(params, sums.fresh_force) * square(params.accel_bias_sigma_mps2),
		sums.centripetal * share};
}

template <class Scalar>
Direct<Scalar, 3, AT_G> rigid_rate_measurement(const Params<Scalar> &params,
					       const Nav<Scalar> &nav,
					       const Averager<Scalar> &sums)
{
	return {sums.rate * (1 / static_cast<Scalar>(sums.count)) - nav.b_g,
		square(params.rigid_gyro_sigma_radps) +
			repeats(params, sums.fresh_rate) * square(params.gyro_bias_sigma_radps),
		{}};
}

#define BV_INSTANTIATE(Scalar)                                                                     \
	template struct Averager<Scalar>;                                                          \
	template void remember(History<Scalar> &, Ticks, const Vector3<Scalar> &,                  \
			       const Vector3<Scalar> &);                                           \
	template bool at_time(const History<Scalar> &, Ticks, Past<Scalar> &, Vector3<Scalar> &);  \
	template void add_residual(const Params<Scalar> &, const Nav<Scalar> &,                    \
				   Averager<Scalar> &, const Past<Scalar> &,                       \
				   const Vector3<Scalar> &, const Arrival<Scalar> &);              \
	template Measurement<Scalar, 3, AT_A, AT_G, 3> rigid_force_measurement(                    \
		const Params<Scalar> &, const Nav<Scalar> &, const Averager<Scalar> &);            \
	template Direct<Scalar, 3, AT_G> rigid_rate_measurement(                                   \
		const Params<Scalar> &, const Nav<Scalar> &, const Averager<Scalar> &)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE

} // namespace bv
