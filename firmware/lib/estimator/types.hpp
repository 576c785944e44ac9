// SPDX-License-Identifier: Apache-2.0
// Fixed-size vectors and the time base of the estimator.
#ifndef BV_ESTIMATOR_TYPES_HPP_
#define BV_ESTIMATOR_TYPES_HPP_

// Scalar code adds in one order on every machine, so the host can be compared with a Cortex-M4F
// bit for bit (both also need -ffp-contract=off). Nothing here may touch the heap.
#ifndef EIGEN_DONT_VECTORIZE
#define EIGEN_DONT_VECTORIZE
#endif
#ifndef EIGEN_NO_MALLOC
#define EIGEN_NO_MALLOC
#endif
// Eigen counts on its small functions vanishing; GCC's limits on growth at -O2 leave calls
// behind, and a prediction then costs 8,000 instructions in place of 3,000.
#if defined(__GNUC__) && defined(__OPTIMIZE__) && !defined(EIGEN_STRONG_INLINE)
#define EIGEN_STRONG_INLINE inline __attribute__((always_inline))
#endif

#include <Eigen/Core>

#include <cmath>
#include <cstdint>

namespace bv
{

template <class Scalar> using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
template <class Scalar> using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;
/// Hamilton quaternion (w, x, y, z), body to world.
template <class Scalar> using Quaternion = Eigen::Matrix<Scalar, 4, 1>;

/// Time on the leader's clock. A float of seconds would resolve 4 us after a minute, a
/// six-hundredth of a sample and too coarse to interpolate in; differences of ticks are exact.
using Ticks = std::int64_t;

constexpr std::int32_t TICKS_PER_S = 16000000;

/// A difference of two times in seconds.
///
/// Up to 134 s fit 32 bits, which the Cortex-M4F converts in one instruction; from 64 bits the
/// compiler's library takes 30, to the same value.
template <class Scalar> Scalar seconds(Ticks difference)
{
	const auto low = static_cast<std::int32_t>(difference);

	return (low == difference ? static_cast<Scalar>(low) : static_cast<Scalar>(difference)) *
	       (Scalar(1) / static_cast<Scalar>(TICKS_PER_S));
}

template <class Scalar> Scalar square(Scalar x)
{
	return x * x;
}

} // namespace bv

#endif // BV_ESTIMATOR_TYPES_HPP_
