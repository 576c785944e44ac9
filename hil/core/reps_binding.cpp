// SPDX-License-Identifier: Apache-2.0
// Python's view of firmware/lib/reps: conversion and argument checks, no mathematics.
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include "reps.hpp"
#include "reps_binding.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace
{

template <class T>
using Column = nb::ndarray<const T, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

// Which sample each report came with, and the reports as payloads of the wire.
using Reports = std::pair<std::vector<std::int64_t>, nb::bytes>;

class Detector
{
public:
	Detector() : reps_(take, this)
	{
	}

	// The detector knows where it lies.
	Detector(const Detector &) = delete;
	Detector &operator=(const Detector &) = delete;

	Reports push(const Column<std::int64_t> &t_ticks, const Column<float> &velocity_z_mps,
		     const Column<float> &height_m, const Column<float> &tilt_rad,
		     const Column<std::uint8_t> &flags)
	{
		const std::size_t n = t_ticks.shape(0);

		if (velocity_z_mps.shape(0) != n || height_m.shape(0) != n ||
		    tilt_rad.shape(0) != n || flags.shape(0) != n) {
			throw nb::value_error("columns of different lengths: give one row per sample");
		}
		for (at_ = 0; at_ < static_cast<std::int64_t>(n); at_++) {
			bv::RepsSample s;

			s.t_ticks = t_ticks.data()[at_];
			s.velocity_z_mps = velocity_z_mps.data()[at_];
			s.height_m = height_m.data()[at_];
			s.tilt_rad = tilt_rad.data()[at_];
			s.flags = flags.data()[at_];
			reps_.push(s);
		}
		return collected();
	}

	Reports end()
	{
		at_ = -1;
		reps_.end();
		return collected();
	}

private:
	static void take(void *context, const wire_rep &report)
	{
		auto &self = *static_cast<Detector *>(context);
		std::uint8_t payload[WIRE_REP_SIZE];

		wire_rep_put(payload, &report);
		self.payloads_.insert(self.payloads_.end(), payload, payload + WIRE_REP_SIZE);
		self.with_.push_back(self.at_);
	}

	Reports collected()
	{
		Reports found = {std::move(with_), nb::bytes(payloads_.data(), payloads_.size())};

		with_.clear();
		payloads_.clear();
		return found;
	}

	bv::Reps reps_;
	std::int64_t at_ = 0;
	std::vector<std::int64_t> with_;
	std::vector<std::uint8_t> payloads_;
};

} // namespace

void bind_reps(nb::module_ &m)
{
	m.attr("REPS_KEPT") = bv::REPS_KEPT;
	m.attr("REPS_STILL") = static_cast<int>(bv::REPS_STILL);
	m.attr("REPS_FOLLOWER_LOST") = static_cast<int>(bv::REPS_FOLLOWER_LOST);
	m.attr("REPS_CLIPPED") = static_cast<int>(bv::REPS_CLIPPED);
	nb::class_<Detector>(m, "Reps")
		.def(nb::init<>())
		.def("push", &Detector::push, "t_ticks"_a, "velocity_z_mps"_a, "height_m"_a,
		     "tilt_rad"_a, "flags"_a)
		.def("end", &Detector::end);
}
