// SPDX-License-Identifier: Apache-2.0
/// The nominal state, its error state and the covariance; prediction and correction.
/// docs/estimator.md, sections 1, 5 and 6.
#ifndef BV_ESTIMATOR_STATE_HPP_
#define BV_ESTIMATOR_STATE_HPP_

#include "attitude.hpp"
#include "params.hpp"

namespace bv
{

/// Where each 3-vector of the error state begins: position, velocity, attitude, biases.
constexpr int AT_P = 0;
constexpr int AT_V = 3;
constexpr int AT_T = 6;
constexpr int AT_A = 9;
constexpr int AT_G = 12;
constexpr int ERROR_STATES = 15;
/// Indices of the vertical position and velocity errors.
constexpr int AT_PZ = 2;
constexpr int AT_VZ = 5;
/// No error state.
constexpr int NOWHERE = -1;

template <class Scalar> using ErrorState = Eigen::Matrix<Scalar, ERROR_STATES, 1>;
/// Only the upper triangle is meant; what lies below is never read.
template <class Scalar>
using Covariance = Eigen::Matrix<Scalar, ERROR_STATES, ERROR_STATES, Eigen::RowMajor>;

/// Nominal state, 16 numbers, and covariance of the error state.
template <class Scalar> struct Nav {
	/// Position and velocity of the leader's IMU, world frame, m and m/s.
	Vector3<Scalar> p{Vector3<Scalar>::Zero()};
	Vector3<Scalar> v{Vector3<Scalar>::Zero()};
	/// Bar to world.
	Quaternion<Scalar> q{1, 0, 0, 0};
	/// Biases of the leader's sensors, bar frame, m/s^2 and rad/s.
	Vector3<Scalar> b_a{Vector3<Scalar>::Zero()};
	Vector3<Scalar> b_g{Vector3<Scalar>::Zero()};
	Covariance<Scalar> P{Covariance<Scalar>::Zero()};
};

/// Variances that one step adds to velocity, attitude and accelerometer bias.
template <class Scalar> struct ExtraNoise {
	Scalar v = 0, theta = 0, a = 0;
};

/// One inertial step of dt_s: (1) to (5).
///
/// a_before: acceleration in the world frame at the step's beginning, as this function returned
/// it. force: at the step's end, bar frame, prefiltered. rate: mean of the step's two ends.
/// Returns the acceleration in the world frame at the step's end.
template <class Scalar>
Vector3<Scalar> predict(const Params<Scalar> &params, Nav<Scalar> &nav,
			const Vector3<Scalar> &a_before, const Vector3<Scalar> &force,
			const Vector3<Scalar> &rate, Scalar dt_s, const ExtraNoise<Scalar> &extra);

/// M independent components y = H x + n of one variance, and where H is not zero.
///
/// H is the identity on the error states from `At` (none for NOWHERE), plus `coupling` on the
/// Columns states from `From`. The places are known to the compiler, so P H^T takes only what
/// it needs of P.
template <class Scalar, int M, int At, int From = 0, int Columns = 0> struct Measurement {
	using Vector = Eigen::Matrix<Scalar, M, 1>;
	using Coupling = Eigen::Matrix<Scalar, M, Columns>;

	/// Measured minus predicted.
	Vector innovation;
	/// Of each component.
	Scalar variance;
	Coupling coupling;
};

/// The error states from `At` are measured as they are.
template <class Scalar, int M, int At> using Direct = Measurement<Scalar, M, At>;

/// What a measurement would do to the state: (6) with its components one after the other, on
/// the M x M matrix S instead of on P.
///
/// S = H P H^T + R = L D L^T with ones on the diagonal of L. Column k of a L^-T is P H^T of
/// component k given those before it, y of L^-1 y its innovation, and 1 / d times that column
/// its gain.
template <class Scalar, int M> struct Correction {
	/// P H^T, a row for each error state.
	Scalar a[ERROR_STATES][M];
	/// H P H^T, upper triangle.
	Scalar s[M][M];
	/// L below its diagonal, 1 / D, L^-1 y.
	Scalar l[M][M];
	Scalar inverse[M];
	Scalar y[M];
	/// Normalised innovation squared y^T S^-1 y.
	Scalar nis;

	/// Work out what depends on the variance, which is all but a and s.
	void weigh(const Eigen::Matrix<Scalar, M, 1> &innovation, Scalar variance);
};

/// Work out the correction by a measurement; changes nothing.
template <class Scalar, int M, int At, int From, int Columns>
Correction<Scalar, M> correction(const Nav<Scalar> &nav,
				 const Measurement<Scalar, M, At, From, Columns> &m);

/// Apply a correction that was worked out for this very state; it is used up.
///
/// For one component with S = H a + R and K = a / S, the terms of the Joseph form,
/// P - K a^T - a K^T + K S K^T, come to P - K a^T. The upper triangle alone is meant, so P is
/// symmetric by construction.
template <class Scalar, int M> void apply(Nav<Scalar> &nav, Correction<Scalar, M> &c);

template <class Scalar, int M, int At, int From, int Columns>
void correct(Nav<Scalar> &nav, const Measurement<Scalar, M, At, From, Columns> &m)
{
	Correction<Scalar, M> c = correction(nav, m);

	apply(nav, c);
}

} // namespace bv

#endif // BV_ESTIMATOR_STATE_HPP_
