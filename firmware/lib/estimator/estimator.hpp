// SPDX-License-Identifier: Apache-2.0
/// The whole estimator: one step per leader sample. docs/estimator.md, section 4.
///
///     bv::Estimator<float> estimator(params);     // params_fault(params) == nullptr
///     bv::Output<float> out;
///     estimator.step(sample, arrived, count, out);
///
/// No heap, no exceptions, no clock: time comes in with each sample. Parameters, what is derived
/// from them, and the state are apart; the state is a plain copyable struct and can be set.
#ifndef BV_ESTIMATOR_ESTIMATOR_HPP_
#define BV_ESTIMATOR_ESTIMATOR_HPP_

#include "hold.hpp"
#include "params.hpp"
#include "prefilter.hpp"
#include "rigid_body.hpp"
#include "ring.hpp"
#include "round_trip.hpp"
#include "state.hpp"
#include "zupt.hpp"

namespace bv
{

/// Most follower samples on one step: one full IMU batch of the protocol.
constexpr int MAX_FOLLOWER_SAMPLES = 16;

/// Most follower samples compared with the leader on one step.
constexpr int MAX_RESIDUALS = 4;

/// What happened on a step; the bits of Output::flags.
enum Flag : std::uint16_t {
	FLAG_ALIGNED = 1,
	FLAG_STILL = 2,
	FLAG_ZUPT = 4,
	FLAG_ZUPT_GATED = 8,
	FLAG_GRAVITY = 16,
	FLAG_RIGID = 32,
	FLAG_RIGID_GATED = 64,
	FLAG_FOLLOWER_LOST = 128,
	FLAG_ROUND_TRIP = 256,
	FLAG_ROUND_TRIP_GATED = 512,
	FLAG_ANCHOR = 1024,
	FLAG_CLIPPED = 2048,
	FLAG_IMPACT = 4096,
	FLAG_GAP = 8192,
	FLAG_BOUND = 16384,
	FLAG_FOLLOWER_REFUSED = 32768,
};

/// What became of a step. After a refusal the state is what it was before.
enum class Status : std::uint8_t {
	/// The output is filled in.
	ESTIMATED,
	/// Taken; the first align_s seconds give no output.
	ALIGNING,
	/// Refused: leader time does not increase.
	TIME_NOT_INCREASING,
	/// Refused: a leader value is NaN or infinite.
	NOT_FINITE,
	/// Refused: more than MAX_FOLLOWER_SAMPLES at once.
	TOO_MANY_FOLLOWERS,
};

/// The estimate after one step.
template <class Scalar> struct Output {
	/// Time the state refers to: the sample's, less the prefilter's delay to the nearest tick.
	Ticks t_ticks = 0;
	/// Nominal state, see Nav.
	Vector3<Scalar> p, v;
	Quaternion<Scalar> q;
	Vector3<Scalar> b_a, b_g;
	/// Diagonal of the covariance.
	ErrorState<Scalar> variance;
	/// Of the bar's centre, world frame.
	Vector3<Scalar> centre_velocity_mps;
	Scalar centre_height_m = 0;
	/// Of the last gated update on this step; zeros, NaN and 0 if none ran.
	Vector3<Scalar> innovation;
	Scalar nis = 0;
	Scalar gate = 0;
	/// Attitude of the baseline, and the angle between it and q.
	Quaternion<Scalar> q_madgwick;
	Scalar divergence_rad = 0;
	/// Bits of Flag.
	std::uint16_t flags = 0;
};

/// Sums over the first align_s seconds.
///
/// Force and its square are taken relative to the first sample: in float, the variance of a
/// still sensor would otherwise drown in the rounding of g^2.
template <class Scalar> struct Alignment {
	std::int32_t count = 0;
	Ticks t_first_ticks = 0;
	Vector3<Scalar> force_first{Vector3<Scalar>::Zero()};
	Vector3<Scalar> force{Vector3<Scalar>::Zero()};
	Vector3<Scalar> rate{Vector3<Scalar>::Zero()};
	Scalar force2 = 0;
	Scalar rate2 = 0;
	std::int32_t follower_count = 0;
	Vector3<Scalar> follower_rate{Vector3<Scalar>::Zero()};
};

/// Everything that changes from step to step.
template <class Scalar> struct State {
	Nav<Scalar> nav;
	Channel<Scalar> leader;
	Channel<Scalar> follower;
	Detector<Scalar> detector;
	Averager<Scalar> sums;
	RoundTrip<Scalar> trip;
	Hold<Scalar> hold;
	History<Scalar> history;
	Ring<Arrival<Scalar>, 2 * MAX_FOLLOWER_SAMPLES> waiting;
	Alignment<Scalar> alignment;
	Quaternion<Scalar> q_madgwick{1, 0, 0, 0};
	/// Acceleration in the world frame, force and rate of the last step.
	Vector3<Scalar> a_world{Vector3<Scalar>::Zero()};
	Vector3<Scalar> force_last{Vector3<Scalar>::Zero()};
	Vector3<Scalar> rate_last{Vector3<Scalar>::Zero()};
	/// Net turn since the last rest, rad, bar frame; where its present way began, and the
	/// farthest point and squared record of that; where the other sensor's word was last news.
	Vector3<Scalar> turned{Vector3<Scalar>::Zero()};
	Vector3<Scalar> turned_seen{Vector3<Scalar>::Zero()};
	Vector3<Scalar> turned_far{Vector3<Scalar>::Zero()};
	Scalar away2_max = 0;
	Vector3<Scalar> turned_fresh{Vector3<Scalar>::Zero()};
	Scalar turned2_max = 0;
	/// Since the last rest the bar has turned faster than hold_turn_radps.
	bool turned_over = false;
	bool started = false;
	bool aligned = false;
	bool follower_heard = false;
	Ticks t_last_ticks = 0;
	Ticks t_follower_ticks = 0;
	Ticks t_bound_ticks = 0;
	std::uint32_t steps = 0;
};

template <class Scalar> class Estimator
{
public:
	/// Wants params_fault(params) == nullptr.
	explicit Estimator(const Params<Scalar> &params);

	/// One leader sample and the follower samples that arrived since the last, oldest first.
	///
	/// A follower sample that is not finite, not later than the one before, or more than
	/// 50 ms ahead of the leader is left out and flagged; one bad packet must not cost the
	/// leader's own step.
	Status step(const Sample<Scalar> &leader, const Sample<Scalar> *followers, int count,
		    Output<Scalar> &output);

	const Params<Scalar> &params() const
	{
		return params_;
	}

	const PrefilterCoefficients<Scalar> &prefilter() const
	{
		return prefilter_;
	}

	const State<Scalar> &state() const
	{
		return state_;
	}

	/// Go on from a state of the same parameters.
	void set_state(const State<Scalar> &state)
	{
		state_ = state;
	}

private:
	struct Shown {
		Vector3<Scalar> innovation{Vector3<Scalar>::Zero()};
		Scalar nis = 0;
		Scalar gate = 0;
	};

	unsigned take_followers(const Sample<Scalar> *followers, int count, Ticks now_ticks);
	void align(Ticks t_ticks, const Filtered<Scalar> &own);
	void correlate_tilt(bool still);
	unsigned inflate(const Filtered<Scalar> &own, const Vector3<Scalar> &turn, Scalar dt_s,
			 ExtraNoise<Scalar> &extra);
	bool follower_lost(Ticks t_ticks) const;
	unsigned rigid_residuals(Ticks t_ticks);
	unsigned rigid_update();
	bool detect(Ticks t_ticks, const Filtered<Scalar> &own);
	unsigned still_updates(unsigned phase, const Vector3<Scalar> &rate, Scalar dt_s);
	void rest();
	unsigned round_trip(Ticks t_ticks);
	unsigned hold();
	void bound();
	void centre(const Vector3<Scalar> &rate, Vector3<Scalar> &velocity, Scalar &height) const;
	void fill(Ticks t_ticks, unsigned flags, Output<Scalar> &output) const;

	template <int M, int At, int From, int Columns>
	bool gated(const Measurement<Scalar, M, At, From, Columns> &m, Scalar gate,
		   Scalar added = 0);

	Params<Scalar> params_;
	PrefilterCoefficients<Scalar> prefilter_;
	State<Scalar> state_;
	Shown shown_;
};

extern template class Estimator<float>;
extern template class Estimator<double>;

} // namespace bv

#endif // BV_ESTIMATOR_ESTIMATOR_HPP_
