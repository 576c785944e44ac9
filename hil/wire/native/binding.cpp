// SPDX-License-Identifier: Apache-2.0
// hil.wire._native: streams.hpp for Python. Checks of arguments stand here; records become arrays
// that own their bytes.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <tuple>

#include "streams.hpp"

namespace nb = nanobind;
using hil::wire::Layout;

namespace {

using Bytes = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Row = std::tuple<uint8_t, size_t, size_t, size_t, size_t, size_t>;

template <typename T> nb::object array(std::vector<T> values)
{
	auto *kept = new std::vector<T>(std::move(values));
	nb::capsule owner(kept, [](void *p) noexcept { delete static_cast<std::vector<T> *>(p); });
	return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(kept->data(), {kept->size()}, owner));
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
		found.append(nb::make_tuple(array(std::move(one.records)),
					    array(std::move(one.rows))));
	}
	return nb::make_tuple(array(std::move(stream.start)), array(std::move(stream.length)),
			      array(std::move(stream.seq)), stream.delimiters, stream.head_end,
			      stream.tail_start, stream.unknown_types, stream.bad_lengths, found);
}

} // namespace

NB_MODULE(_native, m)
{
	m.def("take_apart", &take_apart, nb::arg("data"), nb::arg("layouts"));
}
