// SPDX-License-Identifier: Apache-2.0
#include "reps.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bv
{
namespace
{

// As hil/reps/find.py; what each is for stands there.
constexpr float PARTIAL_SHARE = 0.6f;
constexpr float TRAVEL_MIN_M = 0.10f;
constexpr float PEAK_MIN_MPS = 0.15f;
constexpr float ON_MPS = 0.05f;
constexpr float CLIMB_SHARE = 0.35f;
constexpr float CLIMB_M = 0.10f;
constexpr float DIP_M = 0.08f;
constexpr float LOWERED_SHARE = 0.5f;
constexpr float PAUSE_S = 0.3f;
constexpr float JOIN_S = 0.3f;
constexpr float RANGE_QUANTILE = 0.75f;
// As hil/reps/trace.py.
constexpr std::int64_t GAP_MAX_TICKS = WIRE_TICK_RATE_HZ / 4;

// A lift has ended when the bar goes down, or has not risen for so long.
constexpr float REST_S = 0.3f;

constexpr float NONE = std::numeric_limits<float>::quiet_NaN();

float seconds(std::int64_t ticks)
{
	return static_cast<float>(ticks) * (1.0f / static_cast<float>(WIRE_TICK_RATE_HZ));
}

// Area below the velocity from one sample to the next.
float area_m(float a_mps, float b_mps, std::int64_t ticks)
{
	return 0.5f * (a_mps + b_mps) * seconds(ticks);
}

// When the velocity passes ON_MPS between two samples.
std::int64_t crossing_ticks(const RepsSample &a, const RepsSample &b)
{
	const float share = (ON_MPS - a.velocity_z_mps) / (b.velocity_z_mps - a.velocity_z_mps);

	return a.t_ticks +
	       static_cast<std::int64_t>(share * static_cast<float>(b.t_ticks - a.t_ticks) + 0.5f);
}

} // namespace

void Reps::Tilt::take(float tilt_rad)
{
	if (std::fabs(tilt_rad) > std::fabs(rad)) {
		rad = tilt_rad;
	}
}

bool Reps::Lift::lowered() const
{
	return before.any && before.travel_m >= LOWERED_SHARE * range_m();
}

// Samples -------------------------------------------------------------------------------------

void Reps::push(const RepsSample &sample)
{
	if (!std::isfinite(sample.velocity_z_mps) || !std::isfinite(sample.height_m) ||
	    !std::isfinite(sample.tilt_rad)) {
		return;
	}
	if (running_ && (sample.t_ticks <= last_.t_ticks ||
			 sample.t_ticks - last_.t_ticks > GAP_MAX_TICKS)) {
		end();
	}
	// Spans end before the sample that ends them, so its tilt is not theirs.
	fall(sample);
	rise(sample);
	rise_.since.take(sample.tilt_rad);
	descent_.since.take(sample.tilt_rad);
	longest_.since.take(sample.tilt_rad);
	since_lift_.take(sample.tilt_rad);
	last_ = sample;
	running_ = true;
	if (count_ > 0 && !lifts_[count_ - 1].settled && !rise_.on &&
	    (sample.velocity_z_mps < -ON_MPS || (sample.flags & REPS_STILL) != 0 ||
	     seconds(sample.t_ticks - lifts_[count_ - 1].t_end_ticks) >= REST_S)) {
		settle_lift();
	}
}

void Reps::fall(const RepsSample &sample)
{
	const Ticks pause_ticks = sample.t_ticks - descent_.t_end_ticks;

	if (descent_.any && seconds(pause_ticks) >= JOIN_S) {
		settle_descent();
	}
	if (!(sample.velocity_z_mps < -ON_MPS)) {
		return;
	}
	if (!descent_.any) {
		descent_ = Descent();
		descent_.any = true;
		descent_.t_start_ticks = sample.t_ticks;
	} else if (descent_.t_end_ticks == last_.t_ticks) {
		descent_.travel_m -=
			area_m(last_.velocity_z_mps, sample.velocity_z_mps, pause_ticks);
	}
	descent_.t_end_ticks = sample.t_ticks;
	descent_.with_lift = since_lift_;
}

void Reps::rise(const RepsSample &sample)
{
	const bool above = sample.velocity_z_mps > ON_MPS;

	if (rise_.on) {
		extend(sample);
		if (!above) {
			const Ticks t_end_ticks = crossing_ticks(last_, sample);
			const Phase ended = phase(t_end_ticks);

			rise_.on = false;
			if (ended.travel_m >= TRAVEL_MIN_M && ended.peak_mps >= PEAK_MIN_MPS) {
				accept(ended, sample.height_m);
			}
		}
		return;
	}
	if (!above) {
		return;
	}
	// However short it is, it parts the descents of two lifts.
	settle_descent();
	if (running_ && !(last_.velocity_z_mps > ON_MPS)) {
		rise_ = Rise();
		rise_.on = true;
		rise_.t_start_ticks = crossing_ticks(last_, sample);
		rise_.travel_m = area_m(ON_MPS, sample.velocity_z_mps,
					sample.t_ticks - rise_.t_start_ticks);
		rise_.before = last_;
		rise_.fastest = sample;
		rise_.behind_due = true;
		rise_.flags = sample.flags;
	}
}

void Reps::extend(const RepsSample &sample)
{
	Rise &r = rise_;

	if (r.behind_due) {
		r.behind = sample;
		r.behind_due = false;
	}
	if (!(sample.velocity_z_mps > ON_MPS)) {
		return;
	}
	r.flags |= sample.flags;
	r.travel_m += area_m(last_.velocity_z_mps, sample.velocity_z_mps,
			     sample.t_ticks - last_.t_ticks);
	if (sample.velocity_z_mps > r.fastest.velocity_z_mps) {
		r.before = last_;
		r.fastest = sample;
		r.behind_due = true;
	}
}

/// The rise as a concentric phase: mean is travel over duration, the peak that of a parabola.
Reps::Phase Reps::phase(Ticks t_end_ticks) const
{
	const Rise &r = rise_;
	const float left = r.fastest.velocity_z_mps - r.before.velocity_z_mps;
	const float right = r.fastest.velocity_z_mps - r.behind.velocity_z_mps;
	const float shift = 0.5f * (left - right) / (left + right);
	const float half_s = 0.5f * seconds(r.behind.t_ticks - r.before.t_ticks);
	Phase p;

	p.t_start_ticks = r.t_start_ticks;
	p.t_end_ticks = t_end_ticks;
	p.travel_m = r.travel_m +
		     area_m(last_.velocity_z_mps, ON_MPS, t_end_ticks - last_.t_ticks);
	p.mean_mps = p.travel_m / seconds(t_end_ticks - r.t_start_ticks);
	p.peak_mps = r.fastest.velocity_z_mps + 0.25f * (left - right) * shift;
	p.time_to_peak_s = seconds(r.fastest.t_ticks - r.t_start_ticks) + shift * half_s;
	return p;
}

// Lifts ---------------------------------------------------------------------------------------

void Reps::accept(const Phase &phase, float top_m)
{
	const float low_m = top_m - phase.travel_m;

	if (count_ > 0 && climbs(lifts_[count_ - 1], low_m, top_m)) {
		Lift &last = lifts_[count_ - 1];

		if (phase.peak_mps > last.main.peak_mps) {
			last.main = phase;
		}
		last.t_end_ticks = phase.t_end_ticks;
		last.top_m = top_m;
		last.phases = static_cast<std::uint8_t>(std::min(last.phases + 1, 255));
		last.flags |= rise_.flags;
		last.own = since_lift_;
		last.whole.take(since_lift_.rad);
		last.after = Descent();
		// Reported or not, it has not ended yet.
		last.settled = false;
		longest_ = Descent();
		return;
	}
	if (count_ > 0 && !lifts_[count_ - 1].settled) {
		lifts_[count_ - 1].settled = true;
	}
	if (count_ == REPS_KEPT) {
		forget_oldest();
	}
	Lift &lift = lifts_[count_++];

	lift = Lift();
	lift.main = phase;
	lift.t_start_ticks = phase.t_start_ticks;
	lift.t_end_ticks = phase.t_end_ticks;
	lift.low_m = low_m;
	lift.top_m = top_m;
	lift.phases = 1;
	lift.flags = rise_.flags;
	lift.before = longest_;
	lift.own = rise_.since;
	lift.whole = longest_.since;
	since_lift_ = rise_.since;
	longest_ = Descent();
	report();
}

/// Whether a phase goes on from half way up: a front squat and a jerk after their clean.
bool Reps::climbs(const Lift &last, float low_m, float top_m) const
{
	return low_m > last.low_m + CLIMB_SHARE * last.range_m() && top_m > last.top_m + CLIMB_M &&
	       (last.phases > 1 || (longest_.any && longest_.travel_m >= DIP_M));
}

void Reps::settle_descent()
{
	if (descent_.any && (!longest_.any || descent_.travel_m > longest_.travel_m)) {
		longest_ = descent_;
		if (count_ > 0) {
			lifts_[count_ - 1].after = longest_;
			report();
		}
	}
	descent_ = Descent();
}

void Reps::settle_lift()
{
	lifts_[count_ - 1].settled = true;
	report();
}

void Reps::forget_oldest()
{
	const View view = {PARTIAL_SHARE * range_of_set_m(), false, 0, 0};
	const Lift &oldest = lifts_[0];

	if (kind(oldest, view) == WIRE_REP_KIND_FULL) {
		gone_.from_floor = from_floor(view);
		gone_decides_ = true;
		gone_.full_count++;
		gone_.fastest_mps = std::max(gone_.fastest_mps, oldest.main.mean_mps);
	}
	std::move(lifts_.begin() + 1, lifts_.end(), lifts_.begin());
	count_--;
}

void Reps::end()
{
	settle_descent();
	if (count_ > 0) {
		settle_lift();
	}
	if (running_) {
		set_++;
	}
	running_ = false;
	rise_ = Rise();
	longest_ = Descent();
	since_lift_ = Tilt();
	count_ = 0;
	numbers_ = 0;
	gone_ = View();
	gone_decides_ = false;
}

// Reports -------------------------------------------------------------------------------------

/// Upper quartile of the ranges, by linear interpolation.
float Reps::range_of_set_m() const
{
	std::array<float, REPS_KEPT> sorted;

	for (std::size_t i = 0; i < count_; i++) {
		sorted[i] = lifts_[i].range_m();
	}
	std::sort(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(count_));
	const float at = RANGE_QUANTILE * static_cast<float>(count_ - 1);
	const auto below = static_cast<std::size_t>(at);
	const std::size_t above = std::min(below + 1, count_ - 1);

	return sorted[below] + (at - static_cast<float>(below)) * (sorted[above] - sorted[below]);
}

std::uint8_t Reps::kind(const Lift &lift, const View &view) const
{
	if (lift.range_m() >= view.full_m) {
		return WIRE_REP_KIND_FULL;
	}
	// Not lowered for it: the bar left its rack, or came back into it.
	return lift.lowered() ? WIRE_REP_KIND_PARTIAL : WIRE_REP_KIND_NONE;
}

/// Whether the bar is lowered after each lift: by the first full one of the set.
bool Reps::from_floor(const View &view) const
{
	if (gone_decides_) {
		return gone_.from_floor;
	}
	for (std::size_t i = 0; i < count_; i++) {
		if (kind(lifts_[i], view) == WIRE_REP_KIND_FULL) {
			return !lifts_[i].lowered();
		}
	}
	return !lifts_[0].lowered();
}

/// Report every lift of which something else is to be said than last time.
void Reps::report()
{
	View view = gone_;

	view.full_m = PARTIAL_SHARE * range_of_set_m();
	view.from_floor = from_floor(view);
	for (std::size_t i = 0; i < count_; i++) {
		report(lifts_[i], view);
	}
}

void Reps::report(Lift &lift, View &view)
{
	const Descent &eccentric = view.from_floor ? lift.after : lift.before;
	const bool has_eccentric = view.from_floor ? eccentric.any : lift.lowered();
	const float pause_s = seconds(lift.t_start_ticks - lift.before.t_end_ticks);
	wire_rep rep = {};

	rep.kind = kind(lift, view);
	if (rep.kind == WIRE_REP_KIND_FULL) {
		view.full_count++;
		view.fastest_mps = std::max(view.fastest_mps, lift.main.mean_mps);
	}
	if (!lift.settled || (lift.number == 0 && rep.kind == WIRE_REP_KIND_NONE)) {
		return;
	}
	const bool first = lift.number == 0;

	lift.number = first ? ++numbers_ : lift.number;
	rep.set = set_;
	rep.number = lift.number;
	rep.flags = static_cast<std::uint8_t>(
		(lift.lowered() ? WIRE_REP_FLAG_LOWERED : 0) |
		(lift.lowered() && pause_s >= PAUSE_S ? WIRE_REP_FLAG_PAUSED : 0) |
		(view.from_floor ? WIRE_REP_FLAG_FROM_FLOOR : 0) |
		((lift.flags & REPS_FOLLOWER_LOST) != 0 ? WIRE_REP_FLAG_FOLLOWER_LOST : 0) |
		((lift.flags & REPS_CLIPPED) != 0 ? WIRE_REP_FLAG_CLIPPED : 0));
	rep.phases = lift.phases;
	rep.full_count = view.full_count;
	rep.t_start_ticks_leader = static_cast<std::uint64_t>(lift.t_start_ticks);
	rep.t_end_ticks_leader = static_cast<std::uint64_t>(lift.t_end_ticks);
	rep.mean_mps = lift.main.mean_mps;
	rep.peak_mps = lift.main.peak_mps;
	rep.time_to_peak_s = lift.main.time_to_peak_s;
	rep.eccentric_s = has_eccentric ? seconds(eccentric.t_end_ticks - eccentric.t_start_ticks)
					: NONE;
	rep.pause_s = lift.lowered() ? pause_s : NONE;
	rep.range_m = lift.range_m();
	rep.tilt_rad = !has_eccentric    ? lift.own.rad
		       : view.from_floor ? eccentric.with_lift.rad
					 : lift.whole.rad;
	rep.velocity_loss = rep.kind == WIRE_REP_KIND_FULL && view.full_count > 1
				    ? 1.0f - lift.main.mean_mps / view.fastest_mps
				    : NONE;

	std::array<std::uint8_t, WIRE_REP_SIZE> now;

	wire_rep_put(now.data(), &rep);
	if (now == lift.reported) {
		return;
	}
	lift.reported = now;
	rep.flags |= first ? 0 : WIRE_REP_FLAG_CORRECTION;
	sink_(context_, rep);
}

} // namespace bv
