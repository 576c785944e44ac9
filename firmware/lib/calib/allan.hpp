// SPDX-License-Identifier: Apache-2.0
/// Allan deviation of a sensor at rest, the noise in it, and the gyroscope's bias.
/// docs/calibration.md, sections 4 and 5. No heap: the caller lends the memory.
#ifndef BV_CALIB_ALLAN_HPP_
#define BV_CALIB_ALLAN_HPP_

#include <cstddef>

namespace bv::calib
{

constexpr int TAUS_PER_DECADE = 10;
constexpr int MAX_TAUS = 96;
/// Averages of the longest averaging time that a record holds. With fewer than four, chance
/// decides: the Allan variance then has some four degrees of freedom.
constexpr std::size_t LEAST_AVERAGES = 4;
/// Bias instability B seen as the flat floor of the Allan deviation: sqrt(2 ln 2 / pi) B
/// (IEEE Std 952-1997, annex C).
constexpr double FLOOR_OF_INSTABILITY = 0.664;

/// sums[0] = 0, sums[i] = sum of the first i of (y - mean), i up to n. Returns the mean.
double centred_sums(const double *y, std::size_t n, double *sums);

/// Overlapping Allan variance for averages over m samples (Riley, NIST SP 1065, section 5.2.4).
/// @param sums n + 1 numbers of centred_sums; 2 m <= n.
double allan_variance(const double *sums, std::size_t n, std::size_t m);

/// Averaging lengths in samples, log-spaced, 1 to n / LEAST_AVERAGES. Returns how many.
int averaging_lengths(std::size_t n, std::size_t (&lengths)[MAX_TAUS]);

/// The three kinds of noise in sigma^2(tau) = N^2 / tau + F^2 + K^2 tau / 3.
struct Noise {
	double white = 0; ///< N: white noise, unit x sqrt(s)
	double floor = 0; ///< F: flat floor, 0.664 B
	double walk = 0;  ///< K: random walk of the bias, unit / sqrt(s)

	double variance(double tau_s) const;
};

struct Allan {
	int count = 0;
	double tau_s[MAX_TAUS] = {};
	double deviation[MAX_TAUS] = {};
	Noise noise;
};

/// Deviations of n samples and the noise fitted to them. `sums` lends n + 1 numbers.
Allan allan_of(const double *y, std::size_t n, double rate_hz, double *sums);

struct Rest {
	double mean = 0;
	double sigma = 0; ///< fitted Allan deviation at the length of the rest
	Noise noise;
};

/// Mean of a rest, and how well another rest of this length would repeat it.
Rest rest_of(const double *y, std::size_t n, double rate_hz, double *sums);

} // namespace bv::calib

#endif // BV_CALIB_ALLAN_HPP_
