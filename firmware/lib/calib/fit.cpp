// SPDX-License-Identifier: Apache-2.0
#include "fit.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>

namespace bv::calib
{
namespace
{

using Row = Eigen::Matrix<double, 1, MAX_UNKNOWNS>;

constexpr double STEP_LIMIT = 1e-12; ///< of all unknowns, dimensionless: rounding is 1e-16
constexpr double FIRST_DAMPING = 1e-3;
constexpr double MAX_DAMPING = 1e12;
constexpr double SMALLEST_MEAN = 1e-3; ///< in g: below it a pose has no direction
constexpr double SMALLEST_SCALE = 1e-3;

bool usable(double gravity_mps2, double sigma_mps2)
{
	return std::isfinite(gravity_mps2) && gravity_mps2 > 0 && std::isfinite(sigma_mps2) &&
	       sigma_mps2 >= 0;
}

/// The unknowns, b in units of g, so that every column of the Jacobian is dimensionless.
struct Unknowns {
	Eigen::Matrix3d M = Eigen::Matrix3d::Identity();
	Eigen::Vector3d b = Eigen::Vector3d::Zero();
};

/// Value and derivatives of r = |M (raw - b)| - 1.
double residual(const Unknowns &u, const Eigen::Vector3d &raw, Row &J)
{
	const Eigen::Vector3d w = raw - u.b;
	const Eigen::Vector3d v = u.M * w;
	const double length = v.norm();
	const Eigen::Vector3d n = v / length;

	J.head<3>() = n.cwiseProduct(w);
	J.segment<3>(3) = -(u.M * n);
	J[6] = n[0] * w[1] + n[1] * w[0];
	J[7] = n[0] * w[2] + n[2] * w[0];
	J[8] = n[1] * w[2] + n[2] * w[1];
	return length - 1.0;
}

/// The first `P` unknowns of a Row: six of them are the diagonal model, nine the symmetric one.
template <int P> class MagnitudeFit
{
	using Vector = Eigen::Matrix<double, P, 1>;
	using Square = Eigen::Matrix<double, P, P>;
	using Spectrum = Eigen::SelfAdjointEigenSolver<Square>;

public:
	MagnitudeFit(const double *means_mps2, int count, double gravity_mps2)
	    : means_(means_mps2), count_(count), gravity_(gravity_mps2)
	{
	}

	Eigen::Vector3d raw(int k) const
	{
		return Eigen::Map<const Eigen::Vector3d>(means_ + 3 * k) / gravity_;
	}

	/// Condition of the Jacobian of an ideal sensor that is held in these directions.
	double condition() const
	{
		Square normal = Square::Zero();
		Row J;

		for (int k = 0; k < count_; k++) {
			residual(Unknowns{}, raw(k).normalized(), J);
			normal += outer(J);
		}
		const Spectrum spectrum(normal, Eigen::EigenvaluesOnly);
		const double least = spectrum.eigenvalues()[0];
		const double most = spectrum.eigenvalues()[P - 1];

		// Eigenvalues are good to rounding times the largest one.
		return least > 1e-14 * most ? std::sqrt(most / least)
					    : std::numeric_limits<double>::infinity();
	}

	/// True when the iteration settled; then `iterations` says after how many steps.
	bool solve(int &iterations)
	{
		double damping = FIRST_DAMPING;
		double cost = linearise(at_);

		for (iterations = 1; iterations <= MAX_ITERATIONS; iterations++) {
			const Vector step = -inverse(damping).lazyProduct(gradient_);

			if (!step.allFinite()) {
				return false;
			}
			if (step.cwiseAbs().maxCoeff() < STEP_LIMIT) {
				return true;
			}
			const Unknowns before = at_;

			at_ = moved(before, step);
			const double found = linearise(at_);

			if (found < cost) {
				cost = found;
				damping *= 0.1;
				continue;
			}
			// At the least cost a step that rounding spoils is no failure.
			if (step.cwiseAbs().maxCoeff() < 1e3 * STEP_LIMIT) {
				at_ = before;
				linearise(at_);
				return true;
			}
			at_ = before;
			linearise(at_);
			damping *= 10.0;
			if (damping > MAX_DAMPING) {
				return false;
			}
		}
		return false;
	}

	/// Results at the solution, in SI units.
	void report(double sigma_mps2, AccelFit &fit, double *residuals_mps2)
	{
		const double cost = linearise(at_);
		const double expected = sigma_mps2 / gravity_;
		double variance = expected * expected;
		Row J;

		if (count_ > P) {
			variance = std::max(variance, cost / (count_ - P));
		}
		FitCovariance scaled = FitCovariance::Zero();

		scaled.topLeftCorner<P, P>() = variance * inverse(0.0);
		Eigen::Matrix<double, MAX_UNKNOWNS, 1> units;

		units.setOnes();
		units.segment<3>(3).setConstant(gravity_);
		fit.covariance = scaled.cwiseProduct(units.lazyProduct(units.transpose()));
		const Eigen::Matrix<double, MAX_UNKNOWNS, 1> sigma =
			fit.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();

		fit.matrix = at_.M;
		fit.bias_mps2 = at_.b * gravity_;
		fit.bias_sigma_mps2 = sigma.segment<3>(3);
		fit.matrix_sigma << sigma[0], sigma[6], sigma[7], //
			sigma[6], sigma[1], sigma[8],             //
			sigma[7], sigma[8], sigma[2];
		for (int k = 0; k < count_; k++) {
			residuals_mps2[k] = gravity_ * residual(at_, raw(k), J);
		}
	}

private:
	/// Normal equations at `u`; returns the sum of squares.
	double linearise(const Unknowns &u)
	{
		double cost = 0;
		Row J;

		normal_.setZero();
		gradient_.setZero();
		for (int k = 0; k < count_; k++) {
			const double r = residual(u, raw(k), J);

			normal_ += outer(J);
			gradient_ += r * J.head<P>().transpose();
			cost += r * r;
		}
		return cost;
	}

	// Coefficient by coefficient: Eigen's blocked product of larger matrices may allocate.
	static Square outer(const Row &J)
	{
		return J.head<P>().transpose().lazyProduct(J.head<P>());
	}

	/// Of normal_ + damping I. One damping for all unknowns, since all are dimensionless.
	Square inverse(double damping) const
	{
		const Spectrum spectrum(normal_);
		const Square &V = spectrum.eigenvectors();
		const Vector reciprocal =
			(spectrum.eigenvalues().array() + damping).inverse().matrix();

		return (V * reciprocal.asDiagonal()).lazyProduct(V.transpose());
	}

	static Unknowns moved(Unknowns u, const Vector &step)
	{
		u.M.diagonal() += step.template head<3>();
		u.b += step.template segment<3>(3);
		if constexpr (P == MAX_UNKNOWNS) {
			u.M(0, 1) += step[6];
			u.M(0, 2) += step[7];
			u.M(1, 2) += step[8];
			u.M(1, 0) = u.M(0, 1);
			u.M(2, 0) = u.M(0, 2);
			u.M(2, 1) = u.M(1, 2);
		}
		return u;
	}

	const double *means_;
	int count_;
	double gravity_;
	Unknowns at_;
	Square normal_ = Square::Zero();
	Vector gradient_ = Vector::Zero();
};

template <int P>
AccelFit fit_poses(const double *means_mps2, int count, double gravity_mps2, double sigma_mps2,
		   double *residuals_mps2)
{
	AccelFit fit;
	MagnitudeFit<P> problem(means_mps2, count, gravity_mps2);

	std::fill(residuals_mps2, residuals_mps2 + std::max(count, 0), 0.0);
	if (!usable(gravity_mps2, sigma_mps2)) {
		return fit;
	}
	for (int k = 0; k < count; k++) {
		const Eigen::Vector3d mean = problem.raw(k);

		if (!mean.allFinite() || mean.norm() < SMALLEST_MEAN) {
			return fit;
		}
	}
	if (count < P) {
		fit.status = Status::TOO_FEW_POSES;
		return fit;
	}
	fit.condition = problem.condition();
	if (fit.condition > MAX_CONDITION) {
		fit.status = Status::POORLY_SPREAD;
		return fit;
	}
	if (!problem.solve(fit.iterations)) {
		fit.status = Status::NOT_CONVERGED;
		return fit;
	}
	fit.status = Status::CONVERGED;
	problem.report(sigma_mps2, fit, residuals_mps2);
	return fit;
}

} // namespace

AccelFit fit_faces_diagonal(const Faces &means_mps2, double gravity_mps2, double sigma_mps2)
{
	AccelFit fit;

	if (!usable(gravity_mps2, sigma_mps2) || !means_mps2.allFinite()) {
		return fit;
	}
	fit.status = Status::CONVERGED;
	for (int i = 0; i < 3; i++) {
		const double up = means_mps2(i, 2 * i);
		const double down = means_mps2(i, 2 * i + 1);
		const double scale = (up - down) / (2.0 * gravity_mps2);

		if (!(scale > SMALLEST_SCALE)) {
			AccelFit refused;

			refused.status = Status::POORLY_SPREAD;
			return refused;
		}
		fit.matrix(i, i) = 1.0 / scale;
		fit.bias_mps2[i] = 0.5 * (up + down);
		fit.matrix_sigma(i, i) =
			sigma_mps2 / (std::sqrt(2.0) * gravity_mps2 * scale * scale);
		fit.bias_sigma_mps2[i] = sigma_mps2 / std::sqrt(2.0);
	}
	return fit;
}

AccelFit fit_faces_square(const Faces &means_mps2, double gravity_mps2, double sigma_mps2)
{
	AccelFit fit;
	Eigen::Matrix3d S;
	Eigen::Matrix3d M;
	bool invertible = false;

	if (!usable(gravity_mps2, sigma_mps2) || !means_mps2.allFinite()) {
		return fit;
	}
	for (int j = 0; j < 3; j++) {
		S.col(j) = (means_mps2.col(2 * j) - means_mps2.col(2 * j + 1)) /
			   (2.0 * gravity_mps2);
	}
	S.computeInverseWithCheck(M, invertible, SMALLEST_SCALE);
	if (!invertible) {
		fit.status = Status::POORLY_SPREAD;
		return fit;
	}
	fit.status = Status::CONVERGED;
	fit.matrix = M;
	fit.bias_mps2 = means_mps2.rowwise().mean();
	fit.bias_sigma_mps2.setConstant(sigma_mps2 / std::sqrt(6.0));
	// dM = -M dS M, and the nine elements of S are independent with one variance.
	const double sigma_S = sigma_mps2 / (std::sqrt(2.0) * gravity_mps2);

	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++) {
			fit.matrix_sigma(i, j) = sigma_S * M.row(i).norm() * M.col(j).norm();
		}
	}
	return fit;
}

AccelFit fit_magnitude(Model model, const double *means_mps2, int count, double gravity_mps2,
		       double sigma_mps2, double *residuals_mps2)
{
	return model == Model::DIAGONAL
		       ? fit_poses<6>(means_mps2, count, gravity_mps2, sigma_mps2, residuals_mps2)
		       : fit_poses<9>(means_mps2, count, gravity_mps2, sigma_mps2, residuals_mps2);
}

} // namespace bv::calib
