// SPDX-License-Identifier: Apache-2.0
#include "zupt.hpp"

namespace bv
{

template <class Scalar>
void Window<Scalar>::push(const Params<Scalar> &params, const Vector3<Scalar> &f,
			  const Vector3<Scalar> &w)
{
	newest = newest + 1 < params.zupt_window ? newest + 1 : 0;
	const auto at = static_cast<std::size_t>(newest);

	force[at] = f;
	rate[at] = w;
	excess[at] = std::sqrt(f.squaredNorm()) - params.gravity_mps2;
	if (filled < params.zupt_window) {
		filled++;
	}
}

template <class Scalar> void Window<Scalar>::clear()
{
	filled = 0;
	newest = -1;
}

template <class Scalar> bool Window<Scalar>::full(const Params<Scalar> &params) const
{
	return filled == params.zupt_window;
}

template <class Scalar>
Vector3<Scalar> Window<Scalar>::mean_force(const Params<Scalar> &params) const
{
	Vector3<Scalar> sum = Vector3<Scalar>::Zero();

	for (std::size_t i = 0; i < static_cast<std::size_t>(params.zupt_window); i++) {
		sum += force[i];
	}
	return sum / static_cast<Scalar>(params.zupt_window);
}

template <class Scalar>
bool window_is_still(const Params<Scalar> &params, const Window<Scalar> &window,
		     const Vector3<Scalar> &b_g)
{
	if (!window.full(params)) {
		return false;
	}
	const auto n = static_cast<std::size_t>(params.zupt_window);
	const auto newest = static_cast<std::size_t>(window.newest);
	const Scalar share = 1 / static_cast<Scalar>(params.zupt_window);
	const Scalar accel_limit = params.zupt_release * params.zupt_accel_var;

	// A window forgets slowly; one sample far outside it ends the stillness at once. What
	// costs least is asked first: in motion, most steps end here.
	if ((window.rate[newest] - b_g).squaredNorm() > params.zupt_release * params.zupt_gyro_var) {
		return false;
	}

	Scalar excess_mean = 0;

	for (std::size_t i = 0; i < n; i++) {
		excess_mean += window.excess[i];
	}
	excess_mean *= share;
	if (square(window.excess[newest] - excess_mean) > accel_limit ||
	    std::abs(excess_mean) > params.zupt_level_mps2) {
		return false;
	}

	Vector3<Scalar> mean = Vector3<Scalar>::Zero();
	Scalar turning2 = 0;

	for (std::size_t i = 0; i < n; i++) {
		mean += window.force[i];
		turning2 += (window.rate[i] - b_g).squaredNorm();
	}
	mean *= share;
	turning2 *= share;
	// The whole vector as well: a bar that sets out sideways does not change |a|.
	if ((window.force[newest] - mean).squaredNorm() > accel_limit) {
		return false;
	}
	if (params.zupt_shoe) {
		const Vector3<Scalar> up =
			(params.gravity_mps2 / std::sqrt(mean.squaredNorm())) * mean;
		Scalar off2 = 0;

		for (std::size_t i = 0; i < n; i++) {
			off2 += (window.force[i] - up).squaredNorm();
		}
		return off2 * share / square(params.shoe_accel_sigma_mps2) +
			       turning2 / square(params.shoe_gyro_sigma_radps) <
		       params.shoe_threshold;
	}

	Scalar spread2 = 0;

	for (std::size_t i = 0; i < n; i++) {
		spread2 += square(window.excess[i] - excess_mean);
	}
	return spread2 * share < params.zupt_accel_var && turning2 < params.zupt_gyro_var;
}

template <class Scalar>
Measurement<Scalar, 3> velocity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav)
{
	return direct<Scalar>(AT_V, -nav.v, params.zupt_variance);
}

template <class Scalar>
Measurement<Scalar, 3> rate_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					const Vector3<Scalar> &rate)
{
	return direct<Scalar>(AT_G, rate - nav.b_g, square(params.zaru_sigma_radps));
}

template <class Scalar>
Measurement<Scalar, 2> gravity_measurement(const Params<Scalar> &params, const Nav<Scalar> &nav,
					   const Vector3<Scalar> &mean_force)
{
	const Matrix3<Scalar> R = matrix(nav.q);
	const Vector3<Scalar> f_world = R * (mean_force - nav.b_a);
	Measurement<Scalar, 2> m;

	// Rows 1 and 2 of -[f_world]x, the third column left out.
	m.row[0].add(AT_T + 1, f_world[2]);
	m.row[1].add(AT_T, -f_world[2]);
	for (int i = 0; i < 2; i++) {
		for (int j = 0; j < 3; j++) {
			m.row[i].add(AT_A + j, -R(i, j));
		}
		m.innovation[i] = -f_world[i];
		m.variance[i] = square(params.gravity_sigma_mps2);
	}
	return m;
}

#define BV_INSTANTIATE(Scalar)                                                                     \
	template struct Window<Scalar>;                                                            \
	template bool window_is_still(const Params<Scalar> &, const Window<Scalar> &,              \
				      const Vector3<Scalar> &);                                    \
	template Measurement<Scalar, 3> velocity_measurement(const Params<Scalar> &,               \
							     const Nav<Scalar> &);                 \
	template Measurement<Scalar, 3> rate_measurement(                                          \
		const Params<Scalar> &, const Nav<Scalar> &, const Vector3<Scalar> &);             \
	template Measurement<Scalar, 2> gravity_measurement(                                       \
		const Params<Scalar> &, const Nav<Scalar> &, const Vector3<Scalar> &)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE

} // namespace bv
