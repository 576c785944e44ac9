// SPDX-License-Identifier: Apache-2.0
/// Rotations: Hamilton quaternions (w, x, y, z), body to world, and their 3-vectors.
///
/// Equation numbers after J. Sola, Quaternion kinematics for the error-state Kalman filter,
/// arXiv:1711.02508. Only sums, products, quotients and square roots are used: IEEE 754 defines
/// those to the last bit, while sin, cos and atan2 differ from one libm to the next.
#ifndef BV_ESTIMATOR_ATTITUDE_HPP_
#define BV_ESTIMATOR_ATTITUDE_HPP_

#include "types.hpp"

namespace bv
{

/// [v]x with [v]x u = v x u (Sola 69).
template <class Scalar> Matrix3<Scalar> skew(const Vector3<Scalar> &v)
{
	Matrix3<Scalar> m;

	m << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
	return m;
}

template <class Scalar>
EIGEN_STRONG_INLINE Vector3<Scalar> cross(const Vector3<Scalar> &a, const Vector3<Scalar> &b)
{
	return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// p (x) q (Sola 12).
template <class Scalar>
Quaternion<Scalar> multiply(const Quaternion<Scalar> &p, const Quaternion<Scalar> &q)
{
	return {p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
		p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
		p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
		p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]};
}

template <class Scalar> Quaternion<Scalar> conjugate(const Quaternion<Scalar> &q)
{
	return {q[0], -q[1], -q[2], -q[3]};
}

template <class Scalar> Quaternion<Scalar> normalised(const Quaternion<Scalar> &q)
{
	return q * (1 / std::sqrt(q.squaredNorm()));
}

/// Quaternion of a rotation vector (Sola 101), correct to rounding for any angle.
///
/// With x = (angle/2)^2, cos(angle/2) and sin(angle/2)/angle are series in x; after x^6 they
/// are cut off by less than 1e-19 for angles up to 0.5 rad, after x^4 by less than 3e-13, which no
/// float can show beside 1. A larger angle is halved, and the
/// quaternion squared, as often as it takes.
template <class Scalar> Quaternion<Scalar> exp(const Vector3<Scalar> &rotation_vector)
{
	Vector3<Scalar> half = Scalar(0.5) * rotation_vector;
	int halvings = 0;

	while (half.squaredNorm() > Scalar(0.0625) && halvings < 32) {
		half *= Scalar(0.5);
		halvings++;
	}
	// 1 / (2n (2n - 1)) and 1 / (2n (2n + 1))
	constexpr int last = sizeof(Scalar) > sizeof(float) ? 5 : 3;
	constexpr Scalar cosine_step[] = {Scalar(1. / 2),  Scalar(1. / 12), Scalar(1. / 30),
					  Scalar(1. / 56), Scalar(1. / 90), Scalar(1. / 132)};
	constexpr Scalar sinc_step[] = {Scalar(1. / 6),  Scalar(1. / 20),  Scalar(1. / 42),
					Scalar(1. / 72), Scalar(1. / 110), Scalar(1. / 156)};
	const Scalar x = half.squaredNorm();
	Scalar cosine = 1;
	Scalar sinc = 1;

	for (int n = last; n >= 0; n--) {
		cosine = 1 - cosine_step[n] * x * cosine;
		sinc = 1 - sinc_step[n] * x * sinc;
	}
	Quaternion<Scalar> q{cosine, sinc * half[0], sinc * half[1], sinc * half[2]};

	for (; halvings > 0; halvings--) {
		q = multiply(q, q);
	}
	return q;
}

/// Rotation matrix body to world (Sola 115).
template <class Scalar> Matrix3<Scalar> matrix(const Quaternion<Scalar> &q)
{
	const Scalar w = q[0], x = q[1], y = q[2], z = q[3];
	Matrix3<Scalar> m;

	m << w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
		2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
		2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z;
	return m;
}

/// Cosine and sine of half the angle whose cosine and sine are proportional to c and s.
template <class Scalar> void half_angle(Scalar c, Scalar s, Scalar &cos_half, Scalar &sin_half)
{
	const Scalar norm = std::sqrt(c * c + s * s);

	if (!(norm > 0)) {
		cos_half = 1;
		sin_half = 0;
	} else if (c >= 0) {
		cos_half = std::sqrt(Scalar(0.5) * (1 + c / norm));
		sin_half = Scalar(0.5) * (s / norm) / cos_half;
	} else {
		// Near half a turn 1 + c cancels; 1 - c does not.
		sin_half = std::copysign(std::sqrt(Scalar(0.5) * (1 - c / norm)), s);
		cos_half = Scalar(0.5) * (s / norm) / sin_half;
	}
}

/// Quaternion with zero yaw whose world z axis is the direction of specific_force.
///
/// Zero yaw: the body's x axis points along world x, seen from above.
template <class Scalar> Quaternion<Scalar> from_gravity(const Vector3<Scalar> &specific_force)
{
	const Scalar fx = specific_force[0], fy = specific_force[1], fz = specific_force[2];
	Scalar cr, sr, cp, sp;

	half_angle(fz, fy, cr, sr);
	half_angle(std::sqrt(fy * fy + fz * fz), -fx, cp, sp);
	return {cr * cp, sr * cp, cr * sp, -sr * sp};
}

/// arctan(s / c) for c, s >= 0, not both zero.
///
/// Halved four times, t -> t / (1 + sqrt(1 + t^2)), the tangent is below 0.1, where eight terms
/// of the series leave less than 1e-17.
template <class Scalar> Scalar arctangent(Scalar s, Scalar c)
{
	Scalar t = s / (c + std::sqrt(s * s + c * c));

	for (int i = 0; i < 3; i++) {
		t = t / (1 + std::sqrt(1 + t * t));
	}
	constexpr Scalar series[] = {Scalar(1),       Scalar(1. / 3),  Scalar(1. / 5),
				     Scalar(1. / 7),  Scalar(1. / 9),  Scalar(1. / 11),
				     Scalar(1. / 13), Scalar(1. / 15), Scalar(1. / 17)};
	const Scalar x = t * t;
	Scalar sum = 0;

	for (int n = 8; n >= 0; n--) {
		sum = series[n] - x * sum;
	}
	return 16 * t * sum;
}

/// Angle of the rotation from p to q, rad, 0..pi.
template <class Scalar>
Scalar angle_between(const Quaternion<Scalar> &p, const Quaternion<Scalar> &q)
{
	const Quaternion<Scalar> d = multiply(conjugate(p), q);

	return 2 * arctangent(std::sqrt(d[1] * d[1] + d[2] * d[2] + d[3] * d[3]), std::abs(d[0]));
}

} // namespace bv

#endif // BV_ESTIMATOR_ATTITUDE_HPP_
