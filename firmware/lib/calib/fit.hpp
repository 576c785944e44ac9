// SPDX-License-Identifier: Apache-2.0
/// Accelerometer calibration from still poses. docs/calibration.md, sections 1 to 3.
///
/// The sensor measures raw = S a + b + noise; the correction is a = M (raw - b) with M = S^-1.
/// Inputs are means over still samples, in m/s^2 at the nominal scale. No heap, no exceptions.
#ifndef BV_CALIB_FIT_HPP_
#define BV_CALIB_FIT_HPP_

// The same switches as lib/estimator, so that both may be linked into one program.
#ifndef EIGEN_DONT_VECTORIZE
#define EIGEN_DONT_VECTORIZE
#endif
#ifndef EIGEN_NO_MALLOC
#define EIGEN_NO_MALLOC
#endif

#include <Eigen/Core>

#include <cstdint>

namespace bv::calib
{

constexpr double STANDARD_GRAVITY_MPS2 = 9.80665;

/// Condition number of the pose geometry above which a fit is refused: with nine poses the worst
/// standard error is then some five times that of one pose's mean (docs/calibration.md, 3).
constexpr double MAX_CONDITION = 10.0;
constexpr int MAX_ITERATIONS = 50;

enum class Status : std::uint8_t {
	CONVERGED,
	BAD_INPUT,     ///< a number is not finite, a mean is zero, or gravity is not positive
	TOO_FEW_POSES, ///< fewer poses than unknowns
	POORLY_SPREAD, ///< the poses do not tell the unknowns apart
	NOT_CONVERGED, ///< the iteration did not settle
};

/// Means of the six faces, one per column: +x -x +y -y +z -z, named by the axis that points up.
using Faces = Eigen::Matrix<double, 3, 6>;

constexpr int MAX_UNKNOWNS = 9;
using FitCovariance = Eigen::Matrix<double, MAX_UNKNOWNS, MAX_UNKNOWNS>;

struct AccelFit {
	Status status = Status::BAD_INPUT;
	Eigen::Vector3d bias_mps2 = Eigen::Vector3d::Zero();    ///< b
	Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();   ///< M
	Eigen::Vector3d bias_sigma_mps2 = Eigen::Vector3d::Zero(); ///< standard errors of b
	Eigen::Matrix3d matrix_sigma = Eigen::Matrix3d::Zero();    ///< standard errors of M
	/// Of the magnitude fits: M_xx M_yy M_zz b_x b_y b_z M_xy M_xz M_yz, b in m/s^2; rows and
	/// columns of what was not fitted are zero, as is all of it after a closed form.
	FitCovariance covariance = FitCovariance::Zero();
	double condition = 0; ///< of the pose geometry; 0 after a closed form
	int iterations = 0;
};

/// Scale and bias of each axis apart: s_i = (m+ - m-) / 2g, b_i = (m+ + m-) / 2, M = diag(1/s).
/// Right only for faces that are level. `sigma_mps2` is the standard error of one mean.
AccelFit fit_faces_diagonal(const Faces &means_mps2, double gravity_mps2, double sigma_mps2);

/// Linear least squares of the full S: column j = (m_j+ - m_j-) / 2g, b = mean of all six. For a
/// unit held square in a fixture, to whose axes the misalignment then refers.
AccelFit fit_faces_square(const Faces &means_mps2, double gravity_mps2, double sigma_mps2);

enum class Model : std::uint8_t {
	DIAGONAL,  ///< M diagonal: 6 unknowns, 6 poses or more
	SYMMETRIC, ///< M symmetric: 9 unknowns, 9 poses or more
};

/// Minimise the sum of (|M (raw_k - b)| - g)^2 over poses of any orientation, by Levenberg and
/// Marquardt's damped Gauss-Newton (Nocedal and Wright, Numerical Optimization, 10.3).
///
/// @param means_mps2 count x 3, row by row.
/// @param sigma_mps2 standard error of one mean; where the residuals are larger than it says,
///        standard errors are scaled by them.
/// @param residuals_mps2 count numbers, |M (raw - b)| - g; zero unless CONVERGED.
AccelFit fit_magnitude(Model model, const double *means_mps2, int count, double gravity_mps2,
		       double sigma_mps2, double *residuals_mps2);

} // namespace bv::calib

#endif // BV_CALIB_FIT_HPP_
