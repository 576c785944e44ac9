// SPDX-License-Identifier: Apache-2.0
#include "rigid_body.hpp"

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
	int i = history.size() - 1;

	if (i < 1 || t_ticks > history[i].t_ticks || t_ticks < history[0].t_ticks) {
		return false;
	}
	do {
		i--;
	} while (history[i].t_ticks > t_ticks);

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
	sums.centripetal -= skew(wxr);
	sums.centripetal -= r * w.transpose();
	sums.centripetal.diagonal().array() += w.dot(r);
	sums.variance += square(params.rigid_accel_sigma_mps2) +
			 slope.squaredNorm() * square(follower.t_sigma_s) +
			 square(params.lever_sigma_m * (leader.alpha.norm() + w2));
	sums.count++;
}

template <class Scalar>
Measurement<Scalar, 3> rigid_force_measurement(const Params<Scalar> &params,
					       const Nav<Scalar> &nav, const Averager<Scalar> &sums)
{
	const Scalar n = static_cast<Scalar>(sums.count);
	Measurement<Scalar, 3> m = direct<Scalar>(
		AT_A, sums.force / n - nav.b_a,
		sums.variance / n + repeats(params, sums.fresh_force) *
					    square(params.accel_bias_sigma_mps2));

	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++) {
			m.row[i].add(AT_G + j, sums.centripetal(i, j) / n);
		}
	}
	return m;
}

template <class Scalar>
Measurement<Scalar, 3> rigid_rate_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					      const Averager<Scalar> &sums)
{
	return direct<Scalar>(AT_G, sums.rate / static_cast<Scalar>(sums.count) - nav.b_g,
			      square(params.rigid_gyro_sigma_radps) +
				      repeats(params, sums.fresh_rate) *
					      square(params.gyro_bias_sigma_radps));
}

#define BV_INSTANTIATE(Scalar)                                                                     \
	template struct Averager<Scalar>;                                                          \
	template void remember(History<Scalar> &, Ticks, const Vector3<Scalar> &,                  \
			       const Vector3<Scalar> &);                                           \
	template bool at_time(const History<Scalar> &, Ticks, Past<Scalar> &, Vector3<Scalar> &);  \
	template void add_residual(const Params<Scalar> &, const Nav<Scalar> &,                    \
				   Averager<Scalar> &, const Past<Scalar> &,                       \
				   const Vector3<Scalar> &, const Arrival<Scalar> &);              \
	template Measurement<Scalar, 3> rigid_force_measurement(                                   \
		const Params<Scalar> &, const Nav<Scalar> &, const Averager<Scalar> &);            \
	template Measurement<Scalar, 3> rigid_rate_measurement(                                    \
		const Params<Scalar> &, const Nav<Scalar> &, const Averager<Scalar> &)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE

} // namespace bv
