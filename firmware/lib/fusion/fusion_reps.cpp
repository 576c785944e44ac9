// SPDX-License-Identifier: Apache-2.0
#include "fusion_reps.hpp"

#include <algorithm>
#include <cmath>

#include "diag_uart.h"
#include "reps.hpp"

namespace
{

void send(void *context, const wire_rep &report)
{
	uint8_t payload[WIRE_REP_SIZE];

	static_cast<void>(context);
	diag_uart_frame(WIRE_REP_ID, payload, wire_rep_put(payload, &report));
}

bv::Reps reps(send, nullptr);

std::uint8_t of_interest(std::uint16_t flags)
{
	return static_cast<std::uint8_t>(
		((flags & bv::FLAG_ZUPT) != 0 ? bv::REPS_STILL : 0) |
		((flags & bv::FLAG_FOLLOWER_LOST) != 0 ? bv::REPS_FOLLOWER_LOST : 0) |
		((flags & bv::FLAG_CLIPPED) != 0 ? bv::REPS_CLIPPED : 0));
}

} // namespace

void fusion_reps_take(const bv::Output<float> &o)
{
	bv::RepsSample sample;

	sample.t_ticks = o.t_ticks;
	sample.velocity_z_mps = o.centre_velocity_mps[2];
	sample.height_m = o.centre_height_m;
	// Third row, first column of the matrix of q: how much of the bar's axis points upwards.
	const float upwards = 2.0f * (o.q[1] * o.q[3] - o.q[0] * o.q[2]);

	sample.tilt_rad = std::asin(std::min(std::max(upwards, -1.0f), 1.0f));
	sample.flags = of_interest(o.flags);
	reps.push(sample);
}
