// SPDX-License-Identifier: Apache-2.0
// hil.wire._native: streams.hpp for Python. Checks of arguments stand here; records become arrays
// that own their bytes.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdlib>
#include <stdexcept>
#include <tuple>

#include "streams.hpp"

namespace nb = nanobind;
using hil::wire::Layout;

namespace {

using Bytes = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Row = std::tuple<uint8_t, size_t, size_t, size_t, size_t, size_t>;

template <typename T> nb::object array(hil::wire::Column<T> &values)
{
	const size_t size = values.size();
	T *const kept = values.release();
	nb::capsule owner(kept, [](void *p) noexcept { std::free(p); });
	return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(kept, {size}, owner));
}

std::vector<Layout> checked(const std::vector<Row> &rows)
{
	std::vector<Layout> layouts;
	for (const auto &[id, fixed, row, max_count, count_at, count_size] : rows) {
		if (fixed > hil::wire::kChunkLimit || row > hil::wire::kChunkLimit ||
		    max_count > hil::wire::kChunkLimit || count_size > 4 ||
		    count_at > fixed || count_size > fixed - count_at) {
			throw std::invalid_argument("a layout is outside its limits");
		}
		layouts.push_back({id, fixed, row, max_count, count_at, count_size});
	}
	return layouts;
}

nb::tuple take_apart(const Bytes &data, const std::vector<Row> &rows)
{
	const std::vector<Layout> layouts = checked(rows);
	hil::wire::Stream stream;
	{
		nb::gil_scoped_release free;
		stream = hil::wire::take_apart(data.data(), data.size(), layouts);
	}
	nb::list found;
	for (auto &one : stream.found) {
		found.append(nb::make_tuple(array(one.records),
					    array(one.rows)));
	}
	return nb::make_tuple(array(stream.start), array(stream.length),
			      array(stream.seq), stream.delimiters, stream.head_end,
			      stream.tail_start, stream.unknown_types, stream.bad_lengths, found);
}

} // namespace

NB_MODULE(_native, m)
{
	m.def("take_apart", &take_apart, nb::arg("data"), nb::arg("layouts"));
}
