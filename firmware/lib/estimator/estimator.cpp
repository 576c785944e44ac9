// SPDX-License-Identifier: Apache-2.0
#include "estimator.hpp"

#include <algorithm>
#include <limits>

#include "madgwick.hpp"

namespace bv
{
namespace
{

// A longer step than this is a gap; a follower further ahead than this is no follower.
constexpr Ticks MAX_GAP_TICKS = TICKS_PER_S / 20;

template <class Scalar> bool finite(const Sample<Scalar> &sample)
{
	return sample.accel_mps2.allFinite() && sample.gyro_radps.allFinite() &&
	       std::isfinite(sample.t_sigma_s);
}

} // namespace

template <class Scalar>
Estimator<Scalar>::Estimator(const Params<Scalar> &params)
	: params_(params), prefilter_(PrefilterCoefficients<Scalar>::of(params))
{
	state_.sums.fresh_force = params.rigid_fast;
	state_.sums.fresh_rate = params.rigid_fast;
}

template <class Scalar>
Status Estimator<Scalar>::step(const Sample<Scalar> &leader, const Sample<Scalar> *followers,
			       int count, Output<Scalar> &output)
{
	State<Scalar> &s = state_;

	if (count > MAX_FOLLOWER_SAMPLES) {
		return Status::TOO_MANY_FOLLOWERS;
	}
	if (!finite(leader)) {
		return Status::NOT_FINITE;
	}
	if (s.started && leader.t_ticks <= s.t_last_ticks) {
		return Status::TIME_NOT_INCREASING;
	}

	// All differences are between times that the same prefilter delays; only the output's
	// time has the delay taken off.
	const Ticks t_ticks = leader.t_ticks;
	const Ticks step_ticks = t_ticks - s.t_last_ticks;
	const Filtered<Scalar> own =
		s.leader.filter(params_, prefilter_, params_.rotation_leader, leader);
	unsigned flags = take_followers(followers, count, t_ticks);

	s.started = true;
	s.t_last_ticks = t_ticks;
	if (!s.aligned) {
		align(t_ticks, own);
		s.force_last = own.force;
		s.rate_last = own.rate;
		return Status::ALIGNING;
	}

	const Scalar dt_s = seconds<Scalar>(step_ticks);
	const Vector3<Scalar> turn = Scalar(0.5) * (s.rate_last + own.rate);
	ExtraNoise<Scalar> extra;

	flags |= FLAG_ALIGNED | inflate(own, turn, dt_s, extra);
	s.a_world = predict(params_, s.nav, s.a_world, own.force, turn, dt_s, extra);
	remember(s.history, t_ticks, own.force, own.rate);
	s.q_madgwick = madgwick_step(s.q_madgwick, own.force,
				     Vector3<Scalar>(own.rate - s.nav.b_g), dt_s,
				     params_.madgwick_gain);
	s.force_last = own.force;
	s.rate_last = own.rate;
	shown_ = {Vector3<Scalar>::Zero(), std::numeric_limits<Scalar>::quiet_NaN(), 0};

	flags |= rigid_residuals(t_ticks);

	// The phases spread the updates, so that no step pays for all of them.
	const unsigned phase = s.steps % 4;

	if (detect(t_ticks, own)) {
		flags |= FLAG_STILL | still_updates(phase, own.rate, dt_s);
		rest();
	} else {
		s.detector.refused_s = 0;
	}
	if (s.sums.count >= params_.rigid_samples && phase % 2 == 0) {
		flags |= rigid_update();
	}

	Vector3<Scalar> &velocity = output.centre_velocity_mps;
	Scalar &height = output.centre_height_m;

	centre(own.rate, velocity, height);
	if (params_.round_trip && boundary(params_, s.nav, s.trip, t_ticks, height, velocity[2])) {
		flags |= round_trip(t_ticks);
	}
	// On odd phases, which have no rigid-body update.
	if (!(flags & FLAG_STILL) && s.turned_over && params_.hold_span_s > 0 &&
	    s.hold.steady(params_, t_ticks, velocity[2]) && phase % 2 == 1) {
		flags |= hold();
	}
	// Half a sample of room: where the rate divides the period, rounding must not decide.
	if (params_.bound_period_s > 0 &&
	    seconds<Scalar>(t_ticks - s.t_bound_ticks) >=
		    params_.bound_period_s - Scalar(0.5) / params_.rate_hz) {
		s.t_bound_ticks = t_ticks;
		bound();
		flags |= FLAG_BOUND;
	}
	s.steps++;
	if ((flags & (FLAG_ROUND_TRIP | FLAG_BOUND)) != 0) {
		// What was corrected since has moved the centre.
		centre(own.rate, velocity, height);
	}
	fill(t_ticks, flags, output);
	return Status::ESTIMATED;
}

/// All of an output but the bar's centre.
template <class Scalar>
void Estimator<Scalar>::fill(Ticks t_ticks, unsigned flags, Output<Scalar> &output) const
{
	const Nav<Scalar> &n = state_.nav;

	output.t_ticks = t_ticks - prefilter_.delay_ticks;
	output.p = n.p;
	output.v = n.v;
	output.q = n.q;
	output.b_a = n.b_a;
	output.b_g = n.b_g;
	output.variance = n.P.diagonal();
	output.innovation = shown_.innovation;
	output.nis = shown_.nis;
	output.gate = shown_.gate;
	output.q_madgwick = state_.q_madgwick;
	output.divergence_rad = angle_between(n.q, state_.q_madgwick);
	output.flags = static_cast<std::uint16_t>(flags);
}

/// Velocity and height of the bar's centre: the leader's, less the lever arm's.
template <class Scalar>
void Estimator<Scalar>::centre(const Vector3<Scalar> &rate, Vector3<Scalar> &velocity,
			       Scalar &height) const
{
	const Nav<Scalar> &n = state_.nav;
	const Matrix3<Scalar> R = matrix(n.q);
	const Vector3<Scalar> &r = params_.lever_leader_m;

	velocity = n.v - R * cross(Vector3<Scalar>(rate - n.b_g), r);
	height = n.p[2] - R.row(2).dot(r);
}

/// Clipping, impacts, gaps and turns: docs/estimator.md, section 5.
template <class Scalar>
unsigned Estimator<Scalar>::inflate(const Filtered<Scalar> &own, const Vector3<Scalar> &turn,
				    Scalar dt_s, ExtraNoise<Scalar> &extra)
{
	State<Scalar> &s = state_;
	const Params<Scalar> &p = params_;
	unsigned flags = 0;

	if (own.clipped) {
		flags |= FLAG_CLIPPED;
		extra.v += square(p.clip_sigma_mps2 * dt_s);
		extra.theta += square(p.clip_sigma_radps * dt_s);
	}
	const Scalar jump2 = (own.force - s.force_last).squaredNorm();

	if (jump2 > square(p.gravity_mps2)) {
		flags |= FLAG_IMPACT;
		extra.v += square(p.impact_share) * jump2 * square(dt_s);
	}
	if (dt_s > seconds<Scalar>(MAX_GAP_TICKS)) {
		flags |= FLAG_GAP;
		extra.v += square(p.gravity_mps2 * dt_s);
	}
	// Scale errors of a turn undone undo themselves: only a record of the net turn counts.
	s.turned += dt_s * (turn - s.nav.b_g);
	const Scalar turned2 = s.turned.squaredNorm();

	if (turned2 > s.turned2_max) {
		extra.theta += square(p.gyro_scale_sigma) * (turned2 - s.turned2_max);
		s.turned2_max = turned2;
	}
	// Gravity seen from a new side: what was learned as bias may have to be unlearned. Errors
	// of scale grow with the turn itself, so along one way variance grows with its square;
	// where the bar turns back, a new way begins.
	const Scalar away2 = (s.turned - s.turned_seen).squaredNorm();
	const Scalar step2 = square(p.turn_step_rad);

	if (away2 > std::max(s.away2_max, step2)) {
		extra.a = (away2 - s.away2_max) * square(p.accel_scale_sigma * p.gravity_mps2);
		s.away2_max = away2;
		s.turned_far = s.turned;
	} else if (s.away2_max > 0 && (s.turned - s.turned_far).squaredNorm() > step2) {
		s.turned_seen = s.turned_far;
		s.away2_max = 0;
	}
	if ((turn - s.nav.b_g).squaredNorm() > square(p.hold_turn_radps)) {
		s.turned_over = true;
	}
	if ((s.turned - s.turned_fresh).squaredNorm() > square(p.turn_fresh_rad)) {
		s.sums.fresh_force = p.rigid_fast;
		s.turned_fresh = s.turned;
	}
	return flags;
}

// Front end ---------------------------------------------------------------------------------

template <class Scalar>
unsigned Estimator<Scalar>::take_followers(const Sample<Scalar> *followers, int count,
					   Ticks now_ticks)
{
	State<Scalar> &s = state_;
	unsigned flags = 0;

	for (int i = 0; i < count; i++) {
		const Sample<Scalar> &sample = followers[i];

		if (!finite(sample) || sample.t_ticks > now_ticks + MAX_GAP_TICKS ||
		    (s.follower_heard && sample.t_ticks <= s.t_follower_ticks)) {
			flags |= FLAG_FOLLOWER_REFUSED;
			continue;
		}
		const Filtered<Scalar> other =
			s.follower.filter(params_, prefilter_, params_.rotation_follower, sample);

		s.follower_heard = true;
		s.t_follower_ticks = sample.t_ticks;
		s.detector.follower.push(params_, other.force, other.rate);
		if (!s.aligned) {
			s.alignment.follower_count++;
			s.alignment.follower_rate += other.rate;
		} else if (!other.clipped) {
			s.waiting.push(
				{sample.t_ticks, other.force, other.rate, sample.t_sigma_s});
		}
	}
	return flags;
}

/// Attitude from the mean force, gyroscope bias from the mean rate if all is still.
template <class Scalar>
void Estimator<Scalar>::align(Ticks t_ticks, const Filtered<Scalar> &own)
{
	const Params<Scalar> &p = params_;
	Alignment<Scalar> &a = state_.alignment;
	Nav<Scalar> &n = state_.nav;

	if (a.count == 0) {
		a.t_first_ticks = t_ticks;
		a.force_first = own.force;
	}
	const Vector3<Scalar> off = own.force - a.force_first;

	a.count++;
	a.force += off;
	a.rate += own.rate;
	a.force2 += off.squaredNorm();
	a.rate2 += own.rate.squaredNorm();
	state_.detector.leader.push(p, own.force, own.rate);
	// Half a sample of room: where the rate divides the span, rounding must not decide.
	if (seconds<Scalar>(t_ticks - a.t_first_ticks) < p.align_s - Scalar(0.5) / p.rate_hz) {
		return;
	}

	const Scalar share = 1 / static_cast<Scalar>(a.count);
	const Vector3<Scalar> off_mean = a.force * share;
	const Vector3<Scalar> f = a.force_first + off_mean;
	const Vector3<Scalar> w = a.rate * share;
	const bool still = a.force2 * share - off_mean.squaredNorm() < 3 * p.zupt_accel_var &&
			   a.rate2 * share - w.squaredNorm() < p.zupt_gyro_var;
	const Scalar velocity_sigma =
		still ? p.velocity_sigma_still_mps : p.velocity_sigma_moving_mps;
	const Scalar gyro_sigma =
		still ? p.gyro_bias_sigma_still_radps : p.gyro_bias_sigma_radps;

	n.q = from_gravity(f);
	state_.q_madgwick = n.q;
	n.P.setZero();
	for (int i = 0; i < 3; i++) {
		n.P(AT_V + i, AT_V + i) = square(velocity_sigma);
		n.P(AT_A + i, AT_A + i) = square(p.accel_bias_sigma_mps2);
		n.P(AT_G + i, AT_G + i) = square(gyro_sigma);
	}
	if (still) {
		n.b_g = w;
		if (a.follower_count > 0) {
			state_.detector.gyro_bias_follower =
				a.follower_rate / static_cast<Scalar>(a.follower_count);
		}
	}
	correlate_tilt(still);
	state_.a_world = matrix(n.q) * f - Vector3<Scalar>(0, 0, p.gravity_mps2);
	state_.t_bound_ticks = t_ticks;
	state_.aligned = true;
}

/// A levelled attitude carries the horizontal bias as tilt, fully correlated: section 7.2.
template <class Scalar> void Estimator<Scalar>::correlate_tilt(bool still)
{
	Nav<Scalar> &n = state_.nav;
	const Matrix3<Scalar> R = matrix(n.q);
	const Scalar tilt_sigma = still ? params_.tilt_sigma_still_rad
					: params_.tilt_sigma_moving_rad;
	const Scalar variance = square(params_.accel_bias_sigma_mps2);
	Matrix3<Scalar> to_tilt = Matrix3<Scalar>::Zero();

	to_tilt.row(0) = -R.row(1) / params_.gravity_mps2;
	to_tilt.row(1) = R.row(0) / params_.gravity_mps2;
	n.P.template block<3, 3>(AT_T, AT_A) = variance * to_tilt;
	n.P.template block<3, 3>(AT_T, AT_T) = variance * to_tilt * to_tilt.transpose();
	for (int i = 0; i < 2; i++) {
		n.P(AT_T + i, AT_T + i) += square(tilt_sigma);
	}
}

// Updates -----------------------------------------------------------------------------------

/// Correct if the innovation passes its gate; keeps both for the output. The gate knows the
/// measurement's own variances, the correction takes `added` on top.
template <class Scalar>
template <int M, int At, int From, int Columns>
bool Estimator<Scalar>::gated(const Measurement<Scalar, M, At, From, Columns> &m, Scalar gate,
			      Scalar added)
{
	Correction<Scalar, M> c = correction(state_.nav, m);

	shown_.innovation.setZero();
	shown_.innovation.template head<M>() = m.innovation;
	shown_.nis = c.nis;
	shown_.gate = gate;
	// Written so that a NaN does not pass.
	if (!(c.nis <= gate)) {
		return false;
	}
	if (added > 0) {
		c.weigh(m.innovation, m.variance + added);
	}
	apply(state_.nav, c);
	return true;
}

template <class Scalar> bool Estimator<Scalar>::follower_lost(Ticks t_ticks) const
{
	return !state_.follower_heard ||
	       seconds<Scalar>(t_ticks - state_.t_follower_ticks) > params_.follower_timeout_s;
}

template <class Scalar> unsigned Estimator<Scalar>::rigid_residuals(Ticks t_ticks)
{
	State<Scalar> &s = state_;

	if (follower_lost(t_ticks)) {
		s.sums.clear();
		s.waiting.clear();
		s.detector.follower.clear();
		return FLAG_FOLLOWER_LOST;
	}
	if (s.history.size() < 3) {
		return 0;
	}
	// The newest entry's angular acceleration is provisional until its successor is in.
	const Ticks settled_ticks = s.history[s.history.size() - 2].t_ticks;

	// A whole batch at once would double the cost of its step; what is left can wait.
	for (int n = 0; n < MAX_RESIDUALS && !s.waiting.empty() &&
			s.waiting[0].t_ticks <= settled_ticks;
	     n++) {
		Past<Scalar> past;
		Vector3<Scalar> slope;

		if (at_time(s.history, s.waiting[0].t_ticks, past, slope)) {
			add_residual(params_, s.nav, s.sums, past, slope, s.waiting[0]);
		}
		s.waiting.pop();
	}
	return 0;
}

template <class Scalar> unsigned Estimator<Scalar>::rigid_update()
{
	Averager<Scalar> &sums = state_.sums;
	const bool force = sums.force_next;
	Scalar &spread2 = force ? sums.force_spread2 : sums.rate_spread2;
	std::int32_t &fresh = force ? sums.fresh_force : sums.fresh_rate;
	const bool passed =
		force ? gated(rigid_force_measurement(params_, state_.nav, sums),
			      params_.rigid_gate, spread2)
		      : gated(rigid_rate_measurement(params_, state_.nav, sums),
			      params_.rigid_gate, spread2);

	sums.force_next = !force;
	sums.clear();
	if (!passed) {
		return FLAG_RIGID_GATED;
	}
	const Scalar y2 = shown_.innovation.squaredNorm();

	spread2 += params_.rigid_forget * (y2 / 3 - spread2);
	if (fresh > 0) {
		fresh--;
	}
	return FLAG_RIGID;
}

/// Count consecutive detections on both sensors; a lost follower has no vote.
template <class Scalar>
bool Estimator<Scalar>::detect(Ticks t_ticks, const Filtered<Scalar> &own)
{
	Detector<Scalar> &d = state_.detector;

	d.leader.push(params_, own.force, own.rate);
	const bool still = window_is_still(params_, d.leader, state_.nav.b_g) &&
			   (follower_lost(t_ticks) ||
			    window_is_still(params_, d.follower, d.gyro_bias_follower));

	if (!still) {
		d.hits = 0;
	} else if (d.hits < params_.zupt_dwell) {
		d.hits++;
	}
	return d.hits >= params_.zupt_dwell;
}

template <class Scalar>
unsigned Estimator<Scalar>::still_updates(unsigned phase, const Vector3<Scalar> &rate, Scalar dt_s)
{
	State<Scalar> &s = state_;

	if (!gated(velocity_measurement(params_, s.nav), params_.zupt_gate)) {
		s.detector.refused_s += dt_s;
		if (s.detector.refused_s > params_.zupt_force_s) {
			// Stillness this long outweighs the filter's belief: reopen the velocity.
			s.trip.forget_anchors();
			for (int i = AT_V; i < AT_V + 3; i++) {
				s.nav.P(i, i) += square(params_.velocity_sigma_moving_mps);
			}
		}
		return FLAG_ZUPT_GATED;
	}
	s.detector.refused_s = 0;
	if (phase == 1) {
		correct(s.nav,
			gravity_measurement(params_, s.nav, s.detector.leader.mean_force(params_)));
		return FLAG_ZUPT | FLAG_GRAVITY;
	}
	if (phase == 3) {
		correct(s.nav, rate_measurement(params_, s.nav, rate));
	}
	return FLAG_ZUPT;
}

/// A rest is where the net turn starts anew.
template <class Scalar> void Estimator<Scalar>::rest()
{
	state_.turned.setZero();
	state_.turned_seen.setZero();
	state_.turned_far.setZero();
	state_.away2_max = 0;
	state_.turned_fresh.setZero();
	state_.turned2_max = 0;
	state_.turned_over = false;
	state_.hold.clear();
}

template <class Scalar> unsigned Estimator<Scalar>::round_trip(Ticks t_ticks)
{
	State<Scalar> &s = state_;
	const int anchor = associate(params_, s.nav, s.trip);

	if (anchor < 0) {
		add_anchor(params_, s.nav, s.trip);
		return FLAG_ANCHOR;
	}
	if (!gated(return_measurement(params_, s.nav, s.trip, anchor, t_ticks),
		   params_.round_trip_gate)) {
		return FLAG_ROUND_TRIP_GATED;
	}
	// The correction moves height and velocity at once; that is no descent and no turn.
	s.trip.begin_descent();
	return FLAG_ROUND_TRIP;
}

/// A bar turned over is caught, then held. One that surely moves does not pass the gate.
template <class Scalar> unsigned Estimator<Scalar>::hold()
{
	State<Scalar> &s = state_;
	const Direct<Scalar, 1, AT_VZ> m = hold_measurement(params_, s.hold);

	s.hold.clear();
	return gated(m, params_.hold_gate) ? static_cast<unsigned>(FLAG_BOUND) : 0;
}

/// 0 = v_xy + n: a bar does not travel sideways for long.
template <class Scalar> void Estimator<Scalar>::bound()
{
	Direct<Scalar, 2, AT_V> m;

	m.innovation = -state_.nav.v.template head<2>();
	m.variance = square(params_.bound_sigma_mps);
	correct(state_.nav, m);
}

template class Estimator<float>;
template class Estimator<double>;

} // namespace bv
