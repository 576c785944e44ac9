// SPDX-License-Identifier: Apache-2.0
#include "zupt.hpp"

namespace bv
{

template <class Scalar>
void Window<Scalar>::push(const Params<Scalar> &params, const Vector3<Scalar> &f,
			  const Vector3<Scalar> &w)
{
	const int half = params.zupt_window / 2;
	Moments<Scalar> &x = slot[static_cast<std::size_t>(next)];

	x.force = f;
	x.rate = w;
	x.rate2 = w.squaredNorm();
	x.excess = std::sqrt(f.squaredNorm()) - params.gravity_mps2;
	x.excess2 = square(x.excess);
	if (next == 0 || next == half) {
		finished = running;
		running = x;
		summed = (next == 0 ? params.zupt_window : half) - 1;
	} else {
		running += x;
		// The half before begins at `half` while the first one fills.
		if (summed > (next < half ? half : 0)) {
			summed--;
			slot[static_cast<std::size_t>(summed)] +=
				slot[static_cast<std::size_t>(summed + 1)];
		}
	}
	newest = next;
	next = next + 1 == params.zupt_window ? 0 : next + 1;
	if (filled < params.zupt_window) {
		filled++;
	}
}

template <class Scalar> void Window<Scalar>::clear()
{
	filled = 0;
	next = 0;
}

template <class Scalar> bool Window<Scalar>::full(const Params<Scalar> &params) const
{
	return filled == params.zupt_window;
}

template <class Scalar> Moments<Scalar> Window<Scalar>::sums(const Params<Scalar> &params) const
{
	Moments<Scalar> all = running;

	all += finished;
	// Nothing is left of the half before that once its slots are filled anew.
	if (next != 0 && next != params.zupt_window / 2) {
		all += slot[static_cast<std::size_t>(next)];
	}
	return all;
}

template <class Scalar>
Vector3<Scalar> Window<Scalar>::mean_force(const Params<Scalar> &params) const
{
	return sums(params).force * (1 / static_cast<Scalar>(params.zupt_window));
}

template <class Scalar>
bool window_is_still(const Params<Scalar> &params, const Window<Scalar> &window,
		     const Vector3<Scalar> &b_g)
{
	if (!window.full(params)) {
		return false;
	}
	const Scalar share = 1 / static_cast<Scalar>(params.zupt_window);
	const Scalar accel_limit = params.zupt_release * params.zupt_accel_var;
	const Moments<Scalar> &newest = window.slot[static_cast<std::size_t>(window.newest)];

	// A window forgets slowly; one sample far outside it ends the stillness at once. What
	// costs least is asked first: in motion, most steps end here.
	if ((newest.rate - b_g).squaredNorm() > params.zupt_release * params.zupt_gyro_var) {
		return false;
	}

	const Moments<Scalar> sums = window.sums(params);
	const Scalar excess_mean = sums.excess * share;

	if (square(newest.excess - excess_mean) > accel_limit ||
	    std::abs(excess_mean) > params.zupt_level_mps2) {
		return false;
	}

	const Vector3<Scalar> mean = sums.force * share;

	// The whole vector as well: a bar that sets out sideways does not change |a|.
	if ((newest.force - mean).squaredNorm() > accel_limit) {
		return false;
	}

	// Mean squares about a point from those about zero. What cancels is small: (0.3 m/s^2)^2
	// at most, or a gyroscope's bias squared, against 1e-4 of a threshold.
	const Scalar turning2 = sums.rate2 * share - 2 * share * sums.rate.dot(b_g) +
				b_g.squaredNorm();

	if (params.zupt_shoe) {
		const Scalar g = params.gravity_mps2;
		const Scalar off2 = sums.excess2 * share +
				    2 * g * (g + excess_mean - std::sqrt(mean.squaredNorm()));

		return off2 / square(params.shoe_accel_sigma_mps2) +
			       turning2 / square(params.shoe_gyro_sigma_radps) <
		       params.shoe_threshold;
	}
	return sums.excess2 * share - square(excess_mean) < params.zupt_accel_var &&
	       turning2 < params.zupt_gyro_var;
}

template <class Scalar>
Direct<Scalar, 3, AT_V> velocity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav)
{
	return {-nav.v, params.zupt_variance, {}};
}

template <class Scalar>
Direct<Scalar, 3, AT_G> rate_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					 const Vector3<Scalar> &rate)
{
	return {rate - nav.b_g, square(params.zaru_sigma_radps), {}};
}

template <class Scalar>
Measurement<Scalar, 2, NOWHERE, AT_T, 6>
gravity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
		    const Vector3<Scalar> &mean_force)
{
	const Matrix3<Scalar> R = matrix(nav.q);
	const Vector3<Scalar> f_world = R * (mean_force - nav.b_a);
	Measurement<Scalar, 2, NOWHERE, AT_T, 6> m;

	m.innovation = -f_world.template head<2>();
	m.variance = square(params.gravity_sigma_mps2);
	// Rows 1 and 2 of -[f_world]x, the third column left out.
	m.coupling << 0, f_world[2], 0, -R.row(0), -f_world[2], 0, 0, -R.row(1);
	return m;
}

#define BV_INSTANTIATE(Scalar)                                                                     \
	template struct Window<Scalar>;                                                            \
	template bool window_is_still(const Params<Scalar> &, const Window<Scalar> &,              \
				      const Vector3<Scalar> &);                                    \
	template Direct<Scalar, 3, AT_V> velocity_measurement(const Params<Scalar> &,              \
							      const Nav<Scalar> &);                \
	template Direct<Scalar, 3, AT_G> rate_measurement(                                         \
		const Params<Scalar> &, const Nav<Scalar> &, const Vector3<Scalar> &);             \
	template Measurement<Scalar, 2, NOWHERE, AT_T, 6> gravity_measurement(                     \
		const Params<Scalar> &, const Nav<Scalar> &, const Vector3<Scalar> &)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE

} // namespace bv
