// SPDX-License-Identifier: Apache-2.0
/// Repetitions on line, from the estimate of the bar's centre: docs/repetitions.md. No Zephyr.
///
///     bv::Reps reps(sink, context);
///     reps.push({t_ticks, velocity_z_mps, height_m, tilt_rad, flags});
///
/// The definition is that of hil/motion/repetitions.py and hil/reps/find.py, with the same numbers.
/// On line the rest of the set is not known. So each repetition is judged by the set so far, it is
/// reported once it has certainly ended, and what a later sample changes about it is reported anew
/// under its number. When the set has ended, the last report of each number is what the definition
/// makes of the whole set; docs/repetitions.md lists what may differ until then, and the limits.
///
/// Bounded memory, no heap, no clock: time comes in with each sample.
#ifndef BV_REPS_HPP_
#define BV_REPS_HPP_

#include <array>
#include <cstddef>
#include <cstdint>

#include "wire.h"

namespace bv
{

/// Lifts of one set that are kept. The set's range is that of the last so many.
constexpr std::size_t REPS_KEPT = 32;

/// What is of interest in the estimator's flags for one sample; any combination.
enum RepsFlag : std::uint8_t {
	REPS_STILL = 1,
	REPS_FOLLOWER_LOST = 2,
	REPS_CLIPPED = 4,
};

/// The bar's centre at one instant.
struct RepsSample {
	/// On the leader's clock, 16 MHz.
	std::int64_t t_ticks = 0;
	/// Upwards.
	float velocity_z_mps = 0;
	/// Above where the estimate began.
	float height_m = 0;
	/// Of the bar's axis above the horizontal, leader's end up.
	float tilt_rad = 0;
	/// Bits of RepsFlag.
	std::uint8_t flags = 0;
};

class Reps
{
public:
	/// Takes one report, valid during the call.
	using Sink = void (*)(void *context, const wire_rep &report);

	Reps(Sink sink, void *context) : sink_(sink), context_(context)
	{
	}

	/// One sample. What is not finite is left out. Time that does not increase, or pauses for more
	/// than a quarter of a second, ends the set.
	void push(const RepsSample &sample);

	/// End the set: report what is still waiting. The next sample begins another.
	void end();

private:
	using Ticks = std::int64_t;

	/// The largest tilt by amount, with its sign; the first of equal ones.
	struct Tilt {
		float rad = 0;

		void take(float tilt_rad);
	};

	/// A span in which the bar goes down.
	struct Descent {
		bool any = false;
		Ticks t_start_ticks = 0;
		Ticks t_end_ticks = 0;
		float travel_m = 0;
		/// From its start to now.
		Tilt since;
		/// From the start of the lift before it to its end.
		Tilt with_lift;
	};

	/// A span in which the bar rises.
	struct Rise {
		bool on = false;
		Ticks t_start_ticks = 0;
		float travel_m = 0;
		/// The fastest sample and its neighbours; the one behind it comes a sample later.
		RepsSample before, fastest, behind;
		bool behind_due = false;
		Tilt since;
		std::uint8_t flags = 0;
	};

	/// What is reported of one concentric phase.
	struct Phase {
		Ticks t_start_ticks = 0;
		Ticks t_end_ticks = 0;
		float mean_mps = 0;
		float peak_mps = 0;
		float time_to_peak_s = 0;
		float travel_m = 0;
	};

	/// Concentric phases that belong together.
	struct Lift {
		Phase main;
		Ticks t_start_ticks = 0;
		Ticks t_end_ticks = 0;
		float low_m = 0;
		float top_m = 0;
		std::uint8_t phases = 0;
		std::uint8_t flags = 0;
		/// It has certainly ended.
		bool settled = false;
		/// The longest descents before and after it.
		Descent before, after;
		/// Of the lift alone, and from the start of `before` on.
		Tilt own, whole;
		/// 0 until it is reported for the first time.
		std::uint16_t number = 0;
		std::array<std::uint8_t, WIRE_REP_SIZE> reported{};

		float range_m() const
		{
			return top_m - low_m;
		}

		bool lowered() const;
	};

	/// How the lifts look from here.
	struct View {
		float full_m = 0;
		bool from_floor = false;
		/// Of the full repetitions before the one that is looked at.
		std::uint16_t full_count = 0;
		float fastest_mps = 0;
	};

	void fall(const RepsSample &sample);
	void rise(const RepsSample &sample);
	void extend(const RepsSample &sample);
	Phase phase(Ticks t_end_ticks) const;
	void accept(const Phase &phase, float top_m);
	bool climbs(const Lift &last, float low_m, float top_m) const;
	void settle_descent();
	void settle_lift();
	void forget_oldest();
	std::uint8_t kind(const Lift &lift, const View &view) const;
	bool from_floor(const View &view) const;
	float range_of_set_m() const;
	void report();
	void report(Lift &lift, View &view);

	Sink sink_;
	void *context_;
	/// The last sample; `running_` says whether there is one.
	RepsSample last_;
	bool running_ = false;
	Rise rise_;
	/// The present descent, and the longest one since the last lift.
	Descent descent_, longest_;
	/// From the start of the last lift to now.
	Tilt since_lift_;
	std::array<Lift, REPS_KEPT> lifts_{};
	std::size_t count_ = 0;
	std::uint16_t set_ = 0;
	std::uint16_t numbers_ = 0;
	/// Of lifts that are no longer kept.
	View gone_;
	bool gone_decides_ = false;
};

} // namespace bv

#endif // BV_REPS_HPP_
