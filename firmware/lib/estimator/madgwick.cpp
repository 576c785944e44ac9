// SPDX-License-Identifier: Apache-2.0
#include "madgwick.hpp"

namespace bv
{

template <class Scalar>
Quaternion<Scalar> madgwick_step(const Quaternion<Scalar> &q, const Vector3<Scalar> &force,
				 const Vector3<Scalar> &rate, Scalar dt_s, Scalar gain_radps)
{
	const Scalar w = q[0], x = q[1], y = q[2], z = q[3];
	Quaternion<Scalar> derivative =
		Scalar(0.5) * multiply(q, Quaternion<Scalar>(0, rate[0], rate[1], rate[2]));
	const Scalar norm = force.norm();

	if (norm > 0) {
		const Vector3<Scalar> a = force / norm;
		const Scalar f1 = 2 * (x * z - w * y) - a[0];
		const Scalar f2 = 2 * (w * x + y * z) - a[1];
		const Scalar f3 = 2 * (Scalar(0.5) - x * x - y * y) - a[2];
		const Quaternion<Scalar> gradient(
			-2 * y * f1 + 2 * x * f2, 2 * z * f1 + 2 * w * f2 - 4 * x * f3,
			-2 * w * f1 + 2 * z * f2 - 4 * y * f3, 2 * x * f1 + 2 * y * f2);
		const Scalar length = gradient.norm();

		if (length > Scalar(1e-12)) {
			derivative -= (gain_radps / length) * gradient;
		}
	}
	return normalised(Quaternion<Scalar>(q + dt_s * derivative));
}

template Quaternion<float> madgwick_step(const Quaternion<float> &, const Vector3<float> &,
					 const Vector3<float> &, float, float);
template Quaternion<double> madgwick_step(const Quaternion<double> &, const Vector3<double> &,
					  const Vector3<double> &, double, double);

} // namespace bv
