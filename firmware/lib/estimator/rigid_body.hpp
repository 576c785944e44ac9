// SPDX-License-Identifier: Apache-2.0
/// The second IMU on the same rigid bar: a pseudo-measurement of the leader's biases.
/// docs/estimator.md, section 7.3, equations (8) and (9).
#ifndef BV_ESTIMATOR_RIGID_BODY_HPP_
#define BV_ESTIMATOR_RIGID_BODY_HPP_

#include "params.hpp"
#include "ring.hpp"
#include "state.hpp"

namespace bv
{

/// A leader's filtered sample, with the angular acceleration that its neighbours give, rad/s^2.
template <class Scalar> struct Past {
	Ticks t_ticks = 0;
	Vector3<Scalar> force{Vector3<Scalar>::Zero()};
	Vector3<Scalar> rate{Vector3<Scalar>::Zero()};
	Vector3<Scalar> alpha{Vector3<Scalar>::Zero()};
};

/// Leader samples kept: 150 ms at 416 Hz, the oldest follower sample that is still of use.
template <class Scalar> using History = Ring<Past<Scalar>, 64>;

/// A follower's filtered sample at its own time on the leader's clock.
template <class Scalar> struct Arrival {
	Ticks t_ticks = 0;
	Vector3<Scalar> force{Vector3<Scalar>::Zero()};
	Vector3<Scalar> rate{Vector3<Scalar>::Zero()};
	Scalar t_sigma_s = 0;
};

/// Sums of residuals until an update is due; at most rigid_samples terms, so nothing drifts.
template <class Scalar> struct Averager {
	std::int32_t count = 0;
	bool force_next = true;
	/// Updates left that share the first look at the follower's biases.
	std::int32_t fresh_force = 0;
	std::int32_t fresh_rate = 0;
	Vector3<Scalar> force{Vector3<Scalar>::Zero()};
	Vector3<Scalar> rate{Vector3<Scalar>::Zero()};
	Scalar variance = 0;
	Matrix3<Scalar> centripetal{Matrix3<Scalar>::Zero()};
	/// Running mean square of the residuals that passed the gate.
	Scalar force_spread2 = 0;
	Scalar rate_spread2 = 0;

	void clear();
};

/// A new leader sample; the angular acceleration of the one before is now known.
template <class Scalar>
void remember(History<Scalar> &history, Ticks t_ticks, const Vector3<Scalar> &force,
	      const Vector3<Scalar> &rate);

/// The leader at t_ticks by linear interpolation, and the slope of its force per second.
///
/// False when t_ticks is older than the history or newer than the leader's last sample.
template <class Scalar>
bool at_time(const History<Scalar> &history, Ticks t_ticks, Past<Scalar> &leader,
	     Vector3<Scalar> &slope);

/// Add one pair of residuals (9) with its variance.
template <class Scalar>
void add_residual(const Params<Scalar> &params, const Nav<Scalar> &nav, Averager<Scalar> &sums,
		  const Past<Scalar> &leader, const Vector3<Scalar> &slope,
		  const Arrival<Scalar> &follower);

/// The averaged d_f = b_a - b_aF + n.
template <class Scalar>
Measurement<Scalar, 3, AT_A, AT_G, 3> rigid_force_measurement(const Params<Scalar> &params,
							      const Nav<Scalar> &nav,
							      const Averager<Scalar> &sums);

/// The averaged d_w = b_g - b_gF + n.
template <class Scalar>
Direct<Scalar, 3, AT_G> rigid_rate_measurement(const Params<Scalar> &params,
					       const Nav<Scalar> &nav,
					       const Averager<Scalar> &sums);

} // namespace bv

#endif // BV_ESTIMATOR_RIGID_BODY_HPP_
