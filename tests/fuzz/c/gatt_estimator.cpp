// SPDX-License-Identifier: Apache-2.0
// The leader's fusion as it is, with Eigen's own checks on.
#include <cmath>
#include <new>

#include "check.h"
#include "fusion.hpp"
#include "node_parts.h"

namespace
{

// What one hostile sensor may do to the estimate is bad; what it must not do is end it.
void on_step(void *, std::uint32_t, const bv::Output<float> &output)
{
	CHECK(std::isfinite(output.v[0]) && std::isfinite(output.v[1]) &&
	      std::isfinite(output.v[2]));
	CHECK(std::isfinite(output.q.norm()) && std::isfinite(output.variance.sum()));
}

alignas(bv::Fusion) unsigned char storage[sizeof(bv::Fusion)];

bv::Fusion *fusion()
{
	return std::launder(reinterpret_cast<bv::Fusion *>(storage));
}

} // namespace

extern "C" void estimator_reset(void)
{
	new (storage) bv::Fusion(on_step, nullptr);
}

extern "C" void estimator_take(const wire_imu_batch *batch)
{
	fusion()->take(*batch);
}
