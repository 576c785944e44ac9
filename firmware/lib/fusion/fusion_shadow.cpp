// SPDX-License-Identifier: Apache-2.0
#include "fusion_shadow.hpp"

#include <cmath>

#include "shadow_log.h"

namespace
{

void put_vector(const bv::Vector3<float> &vector, int per_unit, std::int32_t out[3])
{
	for (int i = 0; i < 3; i++) {
		out[i] = static_cast<std::int32_t>(
			std::lround(vector[i] * static_cast<float>(per_unit)));
	}
}

} // namespace

void fusion_shadow_take(const bv::Estimator<float> &estimator, const bv::Output<float> &output)
{
	constexpr bv::Ticks TICKS_PER_US = bv::TICKS_PER_S / 1000000;
	shadow_row row = {};

	row.t_us = static_cast<std::uint64_t>(output.t_ticks / TICKS_PER_US);
	put_vector(estimator.state().force_last, SHADOW_PER_MPS2, row.accel);
	put_vector(estimator.state().rate_last, SHADOW_PER_RADPS, row.gyro);
	row.flags = static_cast<std::uint16_t>(
		((output.flags & bv::FLAG_CLIPPED) != 0 ? SHADOW_CLIPPED : 0) |
		((output.flags & bv::FLAG_GAP) != 0 ? SHADOW_GAP : 0));
	shadow_log_sample(&row);
}
