// SPDX-License-Identifier: Apache-2.0
#include "allan.hpp"

#include "fit.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>

namespace bv::calib
{
namespace
{

constexpr int REWEIGHTINGS = 5;

using Terms = Eigen::Vector3d; ///< N^2, F^2, K^2

Terms shape_at(double tau_s)
{
	return {1.0 / tau_s, 1.0, tau_s / 3.0};
}

/// Degrees of freedom of the overlapping estimate under white noise, whose integral is the random
/// walk of NIST SP 1065, section 5.4.
double degrees_of_freedom(std::size_t n, std::size_t m)
{
	const double points = static_cast<double>(n) + 1.0; // of the integral
	const double length = static_cast<double>(m);
	const double square = 4.0 * length * length;

	return (1.5 * (points - 1.0) / length - 2.0 * (points - 2.0) / points) * square /
	       (square + 5.0);
}

/// Least squares over the chosen terms only; infinite cost where one of them comes out negative.
double fit_terms(const Eigen::Matrix3d &normal, const Terms &right, unsigned chosen, Terms &found)
{
	Eigen::Matrix3d A = Eigen::Matrix3d::Identity();
	Terms b = Terms::Zero();

	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++) {
			if ((chosen >> i & 1U) != 0 && (chosen >> j & 1U) != 0) {
				A(i, j) = normal(i, j);
			}
		}
		if ((chosen >> i & 1U) != 0) {
			b[i] = right[i];
		}
	}
	found = A.inverse() * b;
	if (!found.allFinite() || found.minCoeff() < 0) {
		return std::numeric_limits<double>::infinity();
	}
	return found.dot(normal * found) - 2.0 * found.dot(right);
}

/// Terms that are not negative and agree best with the deviations; each is weighted by its degrees
/// of freedom over the variance that the fit before expects there.
Noise fit_noise(const Allan &allan, const double (&freedom)[MAX_TAUS])
{
	Terms best = Terms::Zero();
	double expected[MAX_TAUS];

	for (int k = 0; k < allan.count; k++) {
		expected[k] = allan.deviation[k] * allan.deviation[k];
	}
	for (int pass = 0; pass < REWEIGHTINGS; pass++) {
		Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
		Terms right = Terms::Zero();

		for (int k = 0; k < allan.count; k++) {
			if (!(expected[k] > 0)) {
				continue;
			}
			const Terms row = shape_at(allan.tau_s[k]) / expected[k];
			const double value =
				allan.deviation[k] * allan.deviation[k] / expected[k];

			normal += freedom[k] * row * row.transpose();
			right += freedom[k] * value * row;
		}
		// Unit diagonal: the terms differ by the square of the range of averaging times.
		const Terms unit = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
		const Eigen::Matrix3d scaled = unit.asDiagonal() * normal * unit.asDiagonal();
		double least = std::numeric_limits<double>::infinity();

		best.setZero();
		for (unsigned chosen = 1; chosen < 8; chosen++) {
			Terms found;
			const double cost =
				fit_terms(scaled, unit.cwiseProduct(right), chosen, found);

			if (cost < least) {
				least = cost;
				best = unit.cwiseProduct(found);
			}
		}
		for (int k = 0; k < allan.count; k++) {
			expected[k] = best.dot(shape_at(allan.tau_s[k]));
		}
	}
	return {std::sqrt(best[0]), std::sqrt(best[1]), std::sqrt(best[2])};
}

} // namespace

double centred_sums(const double *y, std::size_t n, double *sums)
{
	double total = 0;

	for (std::size_t i = 0; i < n; i++) {
		total += y[i];
	}
	const double mean = n > 0 ? total / static_cast<double>(n) : 0.0;

	// Without the mean the sums stay small, and so does their rounding.
	sums[0] = 0;
	for (std::size_t i = 0; i < n; i++) {
		sums[i + 1] = sums[i] + (y[i] - mean);
	}
	return mean;
}

double allan_variance(const double *sums, std::size_t n, std::size_t m)
{
	const std::size_t terms = n - 2 * m + 1;
	double total = 0;

	for (std::size_t j = 0; j < terms; j++) {
		const double d = sums[j + 2 * m] - 2.0 * sums[j + m] + sums[j];

		total += d * d;
	}
	const double length = static_cast<double>(m);

	return total / (2.0 * length * length * static_cast<double>(terms));
}

int averaging_lengths(std::size_t n, std::size_t (&lengths)[MAX_TAUS])
{
	const std::size_t longest = n / LEAST_AVERAGES;
	int count = 0;

	for (int step = 0; count < MAX_TAUS; step++) {
		const double exact = std::pow(10.0, static_cast<double>(step) / TAUS_PER_DECADE);

		if (exact > static_cast<double>(longest)) {
			break;
		}
		const auto length = static_cast<std::size_t>(exact + 0.5);

		if (length <= longest && (count == 0 || length > lengths[count - 1])) {
			lengths[count++] = length;
		}
	}
	return count;
}

double Noise::variance(double tau_s) const
{
	return Terms(white * white, floor * floor, walk * walk).dot(shape_at(tau_s));
}

Allan allan_of(const double *y, std::size_t n, double rate_hz, double *sums)
{
	Allan allan;
	std::size_t lengths[MAX_TAUS];
	double freedom[MAX_TAUS];

	centred_sums(y, n, sums);
	allan.count = averaging_lengths(n, lengths);
	for (int k = 0; k < allan.count; k++) {
		allan.tau_s[k] = static_cast<double>(lengths[k]) / rate_hz;
		allan.deviation[k] = std::sqrt(allan_variance(sums, n, lengths[k]));
		freedom[k] = degrees_of_freedom(n, lengths[k]);
	}
	allan.noise = fit_noise(allan, freedom);
	return allan;
}

Rest rest_of(const double *y, std::size_t n, double rate_hz, double *sums)
{
	const Allan allan = allan_of(y, n, rate_hz, sums);
	Rest rest;

	rest.mean = centred_sums(y, n, sums);
	rest.noise = allan.noise;
	rest.sigma = std::sqrt(allan.noise.variance(static_cast<double>(n) / rate_hz));
	return rest;
}

} // namespace bv::calib
