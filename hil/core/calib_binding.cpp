// SPDX-License-Identifier: Apache-2.0
// Python's view of firmware/lib/calib: conversion and argument checks, no mathematics.
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "allan.hpp"
#include "calib_binding.hpp"
#include "fit.hpp"

namespace nb = nanobind;
using namespace nb::literals;
namespace calib = bv::calib;

namespace
{

template <class Shape>
using Input = nb::ndarray<const double, Shape, nb::c_contig, nb::device::cpu>;
using Numbers = std::vector<double>;

const char *name_of(calib::Status status)
{
	switch (status) {
	case calib::Status::CONVERGED:
		return "converged";
	case calib::Status::TOO_FEW_POSES:
		return "too_few_poses";
	case calib::Status::POORLY_SPREAD:
		return "poorly_spread";
	case calib::Status::NOT_CONVERGED:
		return "not_converged";
	default:
		return "bad_input";
	}
}

template <class Matrix> Numbers row_by_row(const Matrix &matrix)
{
	Numbers numbers;

	for (Eigen::Index i = 0; i < matrix.rows(); i++) {
		for (Eigen::Index j = 0; j < matrix.cols(); j++) {
			numbers.push_back(matrix(i, j));
		}
	}
	return numbers;
}

nb::dict as_dict(const calib::AccelFit &fit, const Numbers &residuals)
{
	nb::dict d;

	d["status"] = name_of(fit.status);
	d["bias_mps2"] = row_by_row(fit.bias_mps2);
	d["matrix"] = row_by_row(fit.matrix);
	d["bias_sigma_mps2"] = row_by_row(fit.bias_sigma_mps2);
	d["matrix_sigma"] = row_by_row(fit.matrix_sigma);
	d["covariance"] = row_by_row(fit.covariance);
	d["residuals_mps2"] = residuals;
	d["condition"] = fit.condition;
	d["iterations"] = fit.iterations;
	return d;
}

nb::dict fit_faces(bool square, const Input<nb::shape<6, 3>> &means, double gravity_mps2,
		   double sigma_mps2)
{
	const calib::Faces faces = Eigen::Map<const calib::Faces>(means.data());
	const auto fit = square ? calib::fit_faces_square : calib::fit_faces_diagonal;

	return as_dict(fit(faces, gravity_mps2, sigma_mps2), Numbers());
}

nb::dict fit_magnitude(bool symmetric, const Input<nb::shape<-1, 3>> &means, double gravity_mps2,
		       double sigma_mps2)
{
	if (means.shape(0) > 100000) {
		throw nb::value_error("more than 100,000 poses: give means, not samples");
	}
	Numbers residuals(means.shape(0));
	const auto model = symmetric ? calib::Model::SYMMETRIC : calib::Model::DIAGONAL;
	const calib::AccelFit fit =
		calib::fit_magnitude(model, means.data(), static_cast<int>(residuals.size()),
				     gravity_mps2, sigma_mps2, residuals.data());

	return as_dict(fit, residuals);
}

using NoiseTuple = std::tuple<double, double, double>;

NoiseTuple as_tuple(const calib::Noise &noise)
{
	return {noise.white, noise.floor, noise.walk};
}

std::tuple<Numbers, Numbers, NoiseTuple> allan(const Input<nb::shape<-1>> &y, double rate_hz)
{
	const std::size_t n = y.shape(0);
	Numbers sums(n + 1);
	calib::Allan found;
	{
		nb::gil_scoped_release release;
		found = calib::allan_of(y.data(), n, rate_hz, sums.data());
	}
	return {Numbers(found.tau_s, found.tau_s + found.count),
		Numbers(found.deviation, found.deviation + found.count), as_tuple(found.noise)};
}

std::tuple<double, double, NoiseTuple> rest(const Input<nb::shape<-1>> &y, double rate_hz)
{
	Numbers sums(y.shape(0) + 1);
	const calib::Rest found = calib::rest_of(y.data(), y.shape(0), rate_hz, sums.data());

	return {found.mean, found.sigma, as_tuple(found.noise)};
}

double allan_variance(const Input<nb::shape<-1>> &y, std::size_t length)
{
	const std::size_t n = y.shape(0);

	if (length == 0 || length > n / 2) {
		throw nb::value_error("an average over no sample, or over more than half of them");
	}
	Numbers sums(n + 1);

	calib::centred_sums(y.data(), n, sums.data());
	return calib::allan_variance(sums.data(), n, length);
}

} // namespace

void bind_calib(nb::module_ &m)
{
	m.attr("CALIB_MAX_CONDITION") = calib::MAX_CONDITION;
	m.attr("CALIB_FLOOR_OF_INSTABILITY") = calib::FLOOR_OF_INSTABILITY;
	m.def("calib_fit_faces", &fit_faces, "square"_a, "means_mps2"_a, "gravity_mps2"_a,
	      "sigma_mps2"_a);
	m.def("calib_fit_magnitude", &fit_magnitude, "symmetric"_a, "means_mps2"_a,
	      "gravity_mps2"_a, "sigma_mps2"_a);
	m.def("calib_allan", &allan, "y"_a, "rate_hz"_a);
	m.def("calib_allan_variance", &allan_variance, "y"_a, "length"_a);
	m.def("calib_rest", &rest, "y"_a, "rate_hz"_a);
}
