// SPDX-License-Identifier: Apache-2.0
#include "fusion.hpp"

#include <cstdlib>
#include <new>

#include "lsm6dsox_scale.h"

namespace bv
{
namespace
{

constexpr double SUBTICKS_PER_TICK = 256.0;
// The bar may have gone anywhere while its sensor slept: after this long, level and begin again.
constexpr Ticks GAP_MAX_TICKS = TICKS_PER_S / 4;

Params<float> params_for(float rate_hz)
{
	Params<float> params;

	params.rate_hz = rate_hz;
	// At 12.5 and 26 Hz the usual cutoff would lie beyond half of the rate.
	if (params.cutoff_hz > rate_hz / 4.0f) {
		params.cutoff_hz = rate_hz / 4.0f;
	}
	return params;
}

Vector3<float> to_si(const std::int16_t lsb[3], float si_per_lsb)
{
	return {static_cast<float>(lsb[0]) * si_per_lsb, static_cast<float>(lsb[1]) * si_per_lsb,
		static_cast<float>(lsb[2]) * si_per_lsb};
}

bool is_clipped(const std::int16_t lsb[3])
{
	return std::abs(static_cast<int>(lsb[0])) >= LSM6DSOX_CLIPPED_LSB ||
	       std::abs(static_cast<int>(lsb[1])) >= LSM6DSOX_CLIPPED_LSB ||
	       std::abs(static_cast<int>(lsb[2])) >= LSM6DSOX_CLIPPED_LSB;
}

Sample<float> sample_of(const wire_imu_batch &batch, unsigned int i)
{
	const wire_imu_batch_samples &raw = batch.samples[i];
	const std::uint64_t since_subticks = static_cast<std::uint64_t>(i) * batch.period_ticks;
	Sample<float> sample;

	sample.t_ticks =
		static_cast<Ticks>(batch.t_first_ticks_node + ((since_subticks + 128U) >> 8));
	sample.accel_mps2 =
		to_si(raw.accel_lsb,
		      static_cast<float>(batch.accel_fs_g * LSM6DSOX_ACCEL_MPS2_PER_LSB_PER_G));
	sample.gyro_radps =
		to_si(raw.gyro_lsb,
		      static_cast<float>(batch.gyro_fs_dps * LSM6DSOX_GYRO_RADPS_PER_LSB_PER_DPS));
	sample.clipped = is_clipped(raw.accel_lsb) || is_clipped(raw.gyro_lsb);
	sample.t_sigma_s = static_cast<float>(batch.t_sigma_ticks) *
			   static_cast<float>(1.0 / (SUBTICKS_PER_TICK * TICKS_PER_S));
	return sample;
}

} // namespace

Fusion::Fusion(Sink sink, void *context)
	: sink_(sink), context_(context), estimator_(params_for(Params<float>{}.rate_hz))
{
}

void Fusion::start(const wire_imu_batch &batch)
{
	const float rate_hz = static_cast<float>(SUBTICKS_PER_TICK * TICKS_PER_S) /
			      static_cast<float>(batch.period_ticks);

	// In place: a second estimator would not fit on a thread's stack.
	new (&estimator_) Estimator<float>(params_for(rate_hz));
	waiting_.clear();
	steps_ = 0;
	started_ = true;
}

void Fusion::take(const wire_imu_batch &batch)
{
	if (batch.source != WIRE_ROLE_LEADER) {
		for (unsigned int i = 0; i < batch.count; i++) {
			dropped_ += waiting_.size() == WAITING_MAX ? 1U : 0U;
			waiting_.push(sample_of(batch, i));
		}
		return;
	}
	if (batch.period_ticks == 0U) {
		return;
	}
	if (!started_ || batch.sample_index < next_index_ ||
	    static_cast<Ticks>(batch.t_first_ticks_node) - t_last_ticks_ > GAP_MAX_TICKS) {
		start(batch);
	}
	next_index_ = batch.sample_index + batch.count;
	for (unsigned int i = 0; i < batch.count; i++) {
		step(sample_of(batch, i));
	}
}

void Fusion::step(const Sample<float> &sample)
{
	Sample<float> arrived[RIDES_MAX];
	Output<float> output;
	int count = 0;

	while (count < RIDES_MAX && !waiting_.empty()) {
		arrived[count++] = waiting_[0];
		waiting_.pop();
	}
	t_last_ticks_ = sample.t_ticks;
	if (estimator_.step(sample, arrived, count, output) == Status::ESTIMATED) {
		sink_(context_, steps_, output);
	}
	steps_++;
}

} // namespace bv
