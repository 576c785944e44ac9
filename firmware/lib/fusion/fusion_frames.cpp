// SPDX-License-Identifier: Apache-2.0
#include "fusion_frames.h"

#include <cmath>
#include <cstring>

#include "diag_uart.h"
#include "fusion.hpp"
#include "fusion_reps.hpp"
#include "fusion_shadow.hpp"

namespace
{

void put_vector(float *out, const bv::Vector3<float> &vector)
{
	std::memcpy(out, vector.data(), 3U * sizeof(float));
}

void send_state(std::uint32_t step, const bv::Output<float> &o)
{
	static wire_ekf_state frame;
	static uint8_t payload[WIRE_EKF_STATE_SIZE];

	frame.t_ticks_leader = static_cast<uint64_t>(o.t_ticks);
	frame.step = step;
	put_vector(frame.position_m, o.p);
	put_vector(frame.velocity_mps, o.v);
	std::memcpy(frame.quaternion, o.q.data(), sizeof(frame.quaternion));
	put_vector(frame.accel_bias_mps2, o.b_a);
	put_vector(frame.gyro_bias_radps, o.b_g);
	std::memcpy(frame.variance, o.variance.data(), sizeof(frame.variance));
	put_vector(frame.innovation, o.innovation);
	frame.nis = o.nis;
	frame.gate = o.gate;
	frame.flags = o.flags;
	put_vector(frame.centre_velocity_mps, o.centre_velocity_mps);
	frame.centre_height_m = o.centre_height_m;
	diag_uart_frame(WIRE_EKF_STATE_ID, payload, wire_ekf_state_put(payload, &frame));
}

void send_baseline(const bv::Output<float> &o)
{
	static wire_attitude frame;
	static uint8_t payload[WIRE_ATTITUDE_SIZE];

	frame.t_ticks_leader = static_cast<uint64_t>(o.t_ticks);
	std::memcpy(frame.quaternion, o.q_madgwick.data(), sizeof(frame.quaternion));
	frame.divergence_rad = o.divergence_rad;
	diag_uart_frame(WIRE_ATTITUDE_ID, payload, wire_attitude_put(payload, &frame));
}

void on_step(void *context, std::uint32_t step, const bv::Output<float> &output);

bv::Fusion fusion(on_step, nullptr);

/// Whether a step is one of about @p wanted_hz evenly spread ones.
bool is_due(std::uint32_t step, int wanted_hz)
{
	const std::uint32_t every = static_cast<std::uint32_t>(
		std::lround(fusion.rate_hz() / static_cast<float>(wanted_hz)));

	return every <= 1U || step % every == 0U;
}

void on_step(void *context, std::uint32_t step, const bv::Output<float> &output)
{
	static_cast<void>(context);
	if (is_due(step, CONFIG_BV_FUSION_STREAM_HZ)) {
		send_state(step, output);
		send_baseline(output);
	}
#ifdef CONFIG_BV_REPS
	if (is_due(step, CONFIG_BV_REPS_STEP_HZ)) {
		fusion_reps_take(output);
	}
#endif
#ifdef CONFIG_BV_SHADOW_LOG
	fusion_shadow_take(fusion.estimator(), output);
#endif
}

} // namespace

void fusion_frames_take(const wire_imu_batch *batch)
{
	fusion.take(*batch);
}
