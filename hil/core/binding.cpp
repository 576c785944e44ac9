// SPDX-License-Identifier: Apache-2.0
// Python's view of firmware/lib/estimator: conversion and argument checks, no mathematics. That of
// firmware/lib/calib stands in calib_binding.cpp, that of firmware/lib/reps in reps_binding.cpp.
#include <cstddef>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "calib_binding.hpp"
#include "estimator.hpp"
#include "reps_binding.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace
{

template <class T, class Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Vectors = Input<double, nb::shape<-1, 3>>;
template <class T> using Column = Input<T, nb::shape<-1>>;

// ---- Parameters ----------------------------------------------------------------------------

template <class Scalar> struct FromDict {
	const nb::dict &values;
	std::size_t taken = 0;

	nb::object value(const char *name)
	{
		if (!values.contains(name)) {
			throw nb::value_error(
				("parameter '" + std::string(name) + "' is missing: give all").c_str());
		}
		taken++;
		return values[name];
	}

	void operator()(const char *name, bool &member)
	{
		member = nb::cast<bool>(value(name));
	}

	void operator()(const char *name, std::int32_t &member)
	{
		member = nb::cast<std::int32_t>(value(name));
	}

	void operator()(const char *name, Scalar &member)
	{
		member = static_cast<Scalar>(nb::cast<double>(value(name)));
	}

	template <int Rows, int Columns>
	void operator()(const char *name, Eigen::Matrix<Scalar, Rows, Columns> &member)
	{
		const auto list = nb::cast<std::vector<double>>(value(name));

		if (list.size() != Rows * Columns) {
			throw nb::value_error(("parameter '" + std::string(name) + "' needs " +
					       std::to_string(Rows * Columns) + " numbers")
						      .c_str());
		}
		for (int i = 0; i < Rows * Columns; i++) {
			member(i / Columns, i % Columns) =
				static_cast<Scalar>(list[static_cast<std::size_t>(i)]);
		}
	}
};

struct ToDict {
	nb::dict values;

	template <class T> void operator()(const char *name, const T &member)
	{
		values[name] = member;
	}

	template <class Scalar, int Rows, int Columns>
	void operator()(const char *name, const Eigen::Matrix<Scalar, Rows, Columns> &member)
	{
		std::vector<double> list;

		for (int i = 0; i < Rows * Columns; i++) {
			list.push_back(member(i / Columns, i % Columns));
		}
		values[name] = list;
	}
};

template <class Scalar> bv::Params<Scalar> params_from(const nb::dict &values)
{
	bv::Params<Scalar> params;
	FromDict<Scalar> from{values};

	bv::for_each_param(params, from);
	if (from.taken != values.size()) {
		throw nb::value_error("a parameter that the core does not know: leave it out");
	}
	if (const char *fault = bv::params_fault(params)) {
		throw nb::value_error(fault);
	}
	return params;
}

nb::dict default_params()
{
	const bv::Params<double> params;
	ToDict to;

	bv::for_each_param(params, to);
	return to.values;
}

// ---- Output records ------------------------------------------------------------------------

template <class Scalar> struct Record {
	std::int64_t t_ticks;
	std::int64_t step;
	Scalar p[3], v[3], q[4], b_a[3], b_g[3];
	Scalar variance[bv::ERROR_STATES];
	Scalar centre_velocity_mps[3];
	Scalar centre_height_m;
	Scalar innovation[3];
	Scalar nis, gate;
	Scalar q_madgwick[4];
	Scalar divergence_rad;
	std::uint16_t flags;
};

using Layout = std::vector<std::tuple<std::string, std::string, std::size_t, std::size_t>>;

// (name, format of one number, how many, offset) of every member, for a NumPy dtype.
template <class Scalar> Layout layout()
{
	const std::string scalar = "f" + std::to_string(sizeof(Scalar));
	Layout rows;

#define BV_FIELD(name, format)                                                                     \
	rows.emplace_back(#name, format,                                                           \
			  sizeof(Record<Scalar>::name) /                                           \
				  sizeof(std::remove_all_extents_t<decltype(Record<Scalar>::name)>), \
			  offsetof(Record<Scalar>, name))
	BV_FIELD(t_ticks, "i8");
	BV_FIELD(step, "i8");
	BV_FIELD(p, scalar);
	BV_FIELD(v, scalar);
	BV_FIELD(q, scalar);
	BV_FIELD(b_a, scalar);
	BV_FIELD(b_g, scalar);
	BV_FIELD(variance, scalar);
	BV_FIELD(centre_velocity_mps, scalar);
	BV_FIELD(centre_height_m, scalar);
	BV_FIELD(innovation, scalar);
	BV_FIELD(nis, scalar);
	BV_FIELD(gate, scalar);
	BV_FIELD(q_madgwick, scalar);
	BV_FIELD(divergence_rad, scalar);
	BV_FIELD(flags, "u2");
#undef BV_FIELD
	return rows;
}

template <class Scalar, int N> void copy(const Eigen::Matrix<Scalar, N, 1> &from, Scalar (&to)[N])
{
	for (int i = 0; i < N; i++) {
		to[i] = from[i];
	}
}

template <class Scalar> Record<Scalar> record(const bv::Output<Scalar> &output, std::size_t step)
{
	Record<Scalar> r{};

	r.t_ticks = output.t_ticks;
	r.step = static_cast<std::int64_t>(step);
	copy(output.p, r.p);
	copy(output.v, r.v);
	copy(output.q, r.q);
	copy(output.b_a, r.b_a);
	copy(output.b_g, r.b_g);
	copy(output.variance, r.variance);
	copy(output.centre_velocity_mps, r.centre_velocity_mps);
	r.centre_height_m = output.centre_height_m;
	copy(output.innovation, r.innovation);
	r.nis = output.nis;
	r.gate = output.gate;
	copy(output.q_madgwick, r.q_madgwick);
	r.divergence_rad = output.divergence_rad;
	r.flags = output.flags;
	return r;
}

// A NumPy array that owns the vector's memory.
template <class T, class... Shape> auto owned(std::vector<T> &&values, std::size_t rows, Shape... rest)
{
	auto *kept = new std::vector<T>(std::move(values));
	nb::capsule owner(kept, [](void *p) noexcept { delete static_cast<std::vector<T> *>(p); });

	return nb::ndarray<nb::numpy, T>(kept->data(), {rows, static_cast<std::size_t>(rest)...},
					 owner);
}

// ---- Estimator -----------------------------------------------------------------------------

void check_length(std::size_t found, std::size_t wanted, const char *name)
{
	if (found != wanted) {
		throw nb::value_error((std::string(name) + " has " + std::to_string(found) +
				       " rows, its times " + std::to_string(wanted) +
				       ": give one row per sample")
					      .c_str());
	}
}

struct Stream {
	Column<std::int64_t> t_ticks;
	Vectors accel_mps2, gyro_radps;
	Column<bool> clipped;
	Column<double> t_sigma_s;

	std::size_t size() const
	{
		return t_ticks.shape(0);
	}

	void check() const
	{
		check_length(accel_mps2.shape(0), size(), "accel_mps2");
		check_length(gyro_radps.shape(0), size(), "gyro_radps");
		check_length(clipped.shape(0), size(), "clipped");
		check_length(t_sigma_s.shape(0), size(), "t_sigma_s");
	}

	template <class Scalar> bv::Sample<Scalar> sample(std::size_t i) const
	{
		bv::Sample<Scalar> s;

		s.t_ticks = t_ticks.data()[i];
		for (int j = 0; j < 3; j++) {
			s.accel_mps2[j] = static_cast<Scalar>(accel_mps2.data()[3 * i + j]);
			s.gyro_radps[j] = static_cast<Scalar>(gyro_radps.data()[3 * i + j]);
		}
		s.clipped = clipped.data()[i];
		s.t_sigma_s = static_cast<Scalar>(t_sigma_s.data()[i]);
		return s;
	}
};

std::string refusal(bv::Status status, std::size_t step)
{
	const std::string where = "leader sample " + std::to_string(step);

	switch (status) {
	case bv::Status::TIME_NOT_INCREASING:
		return where + ": its time does not follow the one before: sort, or leave it out";
	case bv::Status::NOT_FINITE:
		return where + " is not finite: leave it out";
	case bv::Status::TOO_MANY_FOLLOWERS:
		return where + ": more than " + std::to_string(bv::MAX_FOLLOWER_SAMPLES) +
		       " follower samples on one step: spread them over the next steps";
	default:
		return "";
	}
}

template <class Scalar> class Core
{
public:
	explicit Core(const nb::dict &params) : estimator_(params_from<Scalar>(params))
	{
	}

	nb::tuple run(const Stream &leader, const Stream &follower,
		      const Column<std::int64_t> &arrival, bool covariances)
	{
		leader.check();
		follower.check();
		check_length(arrival.shape(0), follower.size(), "arrival");
		for (std::size_t i = 0; i < follower.size(); i++) {
			const std::int64_t at = arrival.data()[i];

			if (at < 0 || at >= static_cast<std::int64_t>(leader.size()) ||
			    (i > 0 && at < arrival.data()[i - 1])) {
				throw nb::value_error(
					("arrival[" + std::to_string(i) + "] = " + std::to_string(at) +
					 ": give the index of a leader step, never falling")
						.c_str());
			}
		}

		std::vector<Record<Scalar>> records;
		std::vector<Scalar> matrices;
		std::string fault;
		{
			nb::gil_scoped_release release;
			fault = steps(leader, follower, arrival, records,
				      covariances ? &matrices : nullptr);
		}
		if (!fault.empty()) {
			throw nb::value_error(fault.c_str());
		}

		const std::size_t n = records.size();
		std::vector<std::uint8_t> bytes(n * sizeof(Record<Scalar>));

		std::memcpy(bytes.data(), records.data(), bytes.size());
		return nb::make_tuple(
			owned(std::move(bytes), n, sizeof(Record<Scalar>)),
			owned(std::move(matrices), covariances ? n : 0, bv::ERROR_STATES,
			      bv::ERROR_STATES));
	}

	// p, v, q, b_a, b_g in one row of 16, and the whole symmetric covariance.
	nb::tuple nav() const
	{
		const bv::Nav<Scalar> &n = estimator_.state().nav;
		std::vector<Scalar> row, matrix;

		row.insert(row.end(), n.p.data(), n.p.data() + 3);
		row.insert(row.end(), n.v.data(), n.v.data() + 3);
		row.insert(row.end(), n.q.data(), n.q.data() + 4);
		row.insert(row.end(), n.b_a.data(), n.b_a.data() + 3);
		row.insert(row.end(), n.b_g.data(), n.b_g.data() + 3);
		append(n.P, matrix);
		return nb::make_tuple(owned(std::move(row), 16),
				      owned(std::move(matrix), bv::ERROR_STATES, bv::ERROR_STATES));
	}

	void set_nav(const Input<double, nb::shape<16>> &row,
		     const Input<double, nb::shape<15, 15>> &matrix)
	{
		bv::State<Scalar> state = estimator_.state();
		bv::Nav<Scalar> &n = state.nav;
		const auto at = [&](int i) { return static_cast<Scalar>(row.data()[i]); };

		n.p = {at(0), at(1), at(2)};
		n.v = {at(3), at(4), at(5)};
		n.q = {at(6), at(7), at(8), at(9)};
		n.b_a = {at(10), at(11), at(12)};
		n.b_g = {at(13), at(14), at(15)};
		for (int i = 0; i < bv::ERROR_STATES; i++) {
			for (int j = 0; j < bv::ERROR_STATES; j++) {
				n.P(i, j) = static_cast<Scalar>(
					matrix.data()[i * bv::ERROR_STATES + j]);
			}
		}
		estimator_.set_state(state);
	}

	Core copy() const
	{
		return *this;
	}

	std::tuple<double, double, double, double, double, double> prefilter() const
	{
		const bv::PrefilterCoefficients<Scalar> &c = estimator_.prefilter();

		return {c.iir.b0, c.iir.b1, c.iir.b2, c.iir.a1, c.iir.a2, c.delay_samples};
	}

private:
	static void append(const bv::Covariance<Scalar> &P, std::vector<Scalar> &to)
	{
		for (int i = 0; i < bv::ERROR_STATES; i++) {
			for (int j = 0; j < bv::ERROR_STATES; j++) {
				to.push_back(i <= j ? P(i, j) : P(j, i));
			}
		}
	}

	// Returns what was refused, or nothing.
	std::string steps(const Stream &leader, const Stream &follower,
			  const Column<std::int64_t> &arrival,
			  std::vector<Record<Scalar>> &records, std::vector<Scalar> *matrices)
	{
		std::vector<bv::Sample<Scalar>> arrived;
		bv::Output<Scalar> output;
		std::size_t next = 0;

		records.reserve(leader.size());
		for (std::size_t k = 0; k < leader.size(); k++) {
			arrived.clear();
			for (; next < follower.size() &&
			       arrival.data()[next] == static_cast<std::int64_t>(k);
			     next++) {
				arrived.push_back(follower.sample<Scalar>(next));
			}
			const bv::Status status =
				estimator_.step(leader.sample<Scalar>(k), arrived.data(),
						static_cast<int>(arrived.size()), output);

			if (status == bv::Status::ESTIMATED) {
				records.push_back(record(output, k));
				if (matrices != nullptr) {
					append(estimator_.state().nav.P, *matrices);
				}
			} else if (status != bv::Status::ALIGNING) {
				return refusal(status, k);
			}
		}
		return "";
	}

	bv::Estimator<Scalar> estimator_;
};

template <class Scalar> void bind(nb::module_ &m, const char *name)
{
	using C = Core<Scalar>;

	nb::class_<C>(m, name)
		.def(nb::init<const nb::dict &>(), "params"_a)
		.def(
			"run",
			[](C &core, Column<std::int64_t> t_ticks, Vectors accel, Vectors gyro,
			   Column<bool> clipped, Column<double> t_sigma,
			   Column<std::int64_t> t_ticks_f, Vectors accel_f, Vectors gyro_f,
			   Column<bool> clipped_f, Column<double> t_sigma_f,
			   Column<std::int64_t> arrival, bool covariances) {
				return core.run({t_ticks, accel, gyro, clipped, t_sigma},
						{t_ticks_f, accel_f, gyro_f, clipped_f, t_sigma_f},
						arrival, covariances);
			})
		.def("nav", &C::nav)
		.def("set_nav", &C::set_nav)
		.def("copy", &C::copy)
		.def("prefilter", &C::prefilter)
		.def_static("layout", &layout<Scalar>)
		.def_prop_ro_static("record_bytes", [](nb::handle) { return sizeof(Record<Scalar>); })
		.def_prop_ro_static("state_bytes",
				    [](nb::handle) { return sizeof(bv::Estimator<Scalar>); });
}

} // namespace

NB_MODULE(_core, m)
{
	m.attr("TICKS_PER_S") = bv::TICKS_PER_S;
	m.attr("ESTIMATOR_SHA256") = BV_ESTIMATOR_SHA256;
	m.attr("MAX_FOLLOWER_SAMPLES") = bv::MAX_FOLLOWER_SAMPLES;
	m.def("default_params", &default_params);
	bind<float>(m, "Estimator32");
	bind<double>(m, "Estimator64");
	bind_calib(m);
	bind_reps(m);
}
