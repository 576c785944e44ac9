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
/// Index of the vertical position error.
constexpr int AT_PZ = 2;

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

/// One row of a measurement's Jacobian: `count` entries, the rest is zero.
template <class Scalar> struct Row {
	static constexpr int MOST = 4;

	int count = 0;
	int index[MOST] = {};
	Scalar value[MOST] = {};

	void add(int at, Scalar x)
	{
		index[count] = at;
		value[count] = x;
		count++;
	}
};

/// M independent components y = H x + n: rows of H, measured minus predicted, variances.
template <class Scalar, int M> struct Measurement {
	Row<Scalar> row[M];
	Scalar innovation[M];
	Scalar variance[M];
};

/// The error state's 3-vector at `first` is measured directly: three components, one variance.
template <class Scalar>
Measurement<Scalar, 3> direct(int first, const Vector3<Scalar> &innovation, Scalar variance)
{
	Measurement<Scalar, 3> m;

	for (int i = 0; i < 3; i++) {
		m.row[i].add(first + i, 1);
		m.innovation[i] = innovation[i];
		m.variance[i] = variance;
	}
	return m;
}

/// What a measurement would do to the state; (6) with its components one after the other.
template <class Scalar, int M> struct Correction {
	/// P H^T and gain of each component, given the components before it.
	ErrorState<Scalar> a[M];
	ErrorState<Scalar> K[M];
	/// Error state to inject.
	ErrorState<Scalar> dx;
	/// Normalised innovation squared y^T S^-1 y.
	Scalar nis;
};

/// Work out the correction by a measurement; changes nothing.
template <class Scalar, int M>
Correction<Scalar, M> correction(const Nav<Scalar> &nav, const Measurement<Scalar, M> &m);

/// Apply a correction that was worked out for this very state.
///
/// For one component with S = H a + R and K = a / S, the terms of the Joseph form,
/// P - K a^T - a K^T + K S K^T, come to P - K a^T. Only the upper triangle is touched, so P is
/// symmetric by construction.
template <class Scalar, int M> void apply(Nav<Scalar> &nav, const Correction<Scalar, M> &c);

template <class Scalar, int M> void correct(Nav<Scalar> &nav, const Measurement<Scalar, M> &m)
{
	apply(nav, correction(nav, m));
}

} // namespace bv

#endif // BV_ESTIMATOR_STATE_HPP_
