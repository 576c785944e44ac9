// SPDX-License-Identifier: Apache-2.0
#ifndef BV_ESTIMATOR_MOVING_AVERAGE_HPP_
#define BV_ESTIMATOR_MOVING_AVERAGE_HPP_

#include <array>

#include "params.hpp"

namespace bv
{

/// Mean of the last samples of six channels; delay (length - 1) / 2 samples at every frequency.
///
/// The sum is made anew from the memory each time. A running sum would keep the rounding of
/// every large sample that ever went through it, in float for good.
template <class Scalar> class MovingAverage
{
public:
	using Vector6 = Eigen::Matrix<Scalar, 6, 1>;

	/// length in 1..MAX_AVERAGE_LENGTH, the same on every call. The first sample fills the
	/// memory, so there is no start-up transient on a constant.
	Vector6 operator()(int length, const Vector6 &x)
	{
		const auto n = static_cast<std::size_t>(length);

		if (!primed_) {
			memory_.fill(x);
			primed_ = true;
		}
		memory_[next_] = x;
		next_ = next_ + 1 == n ? 0 : next_ + 1;

		Vector6 total = memory_[0];

		for (std::size_t i = 1; i < n; i++) {
			total += memory_[i];
		}
		return total * (1 / static_cast<Scalar>(length));
	}

private:
	std::array<Vector6, MAX_AVERAGE_LENGTH> memory_{};
	std::size_t next_ = 0;
	bool primed_ = false;
};

} // namespace bv

#endif // BV_ESTIMATOR_MOVING_AVERAGE_HPP_
