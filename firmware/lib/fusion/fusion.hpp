// SPDX-License-Identifier: Apache-2.0
/// From IMU batches to steps of the estimator: units, times, and who rides with whom. No Zephyr.
///
/// Each sample of the leader is one step. The follower's samples wait until then, and go along
/// oldest first, at most RIDES_MAX on one step: each costs some 1,000 instructions, and a whole
/// batch on one step would make it twice as long as any other.
#ifndef BV_FUSION_HPP_
#define BV_FUSION_HPP_

#include "estimator.hpp"
#include "ring.hpp"
#include "wire.h"

namespace bv
{

constexpr int RIDES_MAX = 4;
constexpr int WAITING_MAX = 64;

class Fusion
{
public:
	/// Called for every step that has an estimate. @p step counts the leader's samples since
	/// the start.
	using Sink = void (*)(void *context, std::uint32_t step, const Output<float> &output);

	Fusion(Sink sink, void *context);

	/// One batch with times on the leader's clock. A leader batch whose samples count from an
	/// earlier index than expected, or come a quarter of a second late, is a new start.
	void take(const wire_imu_batch &batch);

	/// Sample rate that the estimator was started with, Hz.
	float rate_hz() const
	{
		return estimator_.params().rate_hz;
	}

	/// What the last step left, for whoever logs it.
	const Estimator<float> &estimator() const
	{
		return estimator_;
	}

	/// Follower samples that were dropped because too many waited.
	std::uint32_t dropped() const
	{
		return dropped_;
	}

private:
	void start(const wire_imu_batch &batch);
	void step(const Sample<float> &sample);

	Sink sink_;
	void *context_;
	Estimator<float> estimator_;
	Ring<Sample<float>, WAITING_MAX> waiting_;
	bool started_ = false;
	std::uint32_t next_index_ = 0;
	Ticks t_last_ticks_ = 0;
	std::uint32_t steps_ = 0;
	std::uint32_t dropped_ = 0;
};

} // namespace bv

#endif // BV_FUSION_HPP_
