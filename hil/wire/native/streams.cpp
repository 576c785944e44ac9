// SPDX-License-Identifier: Apache-2.0
#include "streams.hpp"

#include <array>
#include <cstring>

namespace hil::wire {
namespace {

constexpr size_t kSlices = 8;
constexpr uint16_t kPolynomial = 0x1021;
constexpr uint16_t kSeed = 0xFFFF;
constexpr uint8_t kFull = 0xFF; // code of a group that stands for no zero

using Tables = std::array<std::array<uint16_t, 256>, kSlices>;

// tables[k][b]: what a byte b contributes to the register when k more bytes follow it.
// Source: M. Kounavis and F. Berry, A Systematic Approach to Building High Performance
// Software-based CRC Generators, ISCC 2005 ("slicing by 8").
constexpr Tables make_tables()
{
	Tables tables{};
	for (unsigned byte = 0; byte < 256; byte++) {
		unsigned crc = byte << 8;
		for (int bit = 0; bit < 8; bit++) {
			crc = (crc << 1) ^ ((crc & 0x8000u) ? kPolynomial : 0u);
		}
		tables[0][byte] = static_cast<uint16_t>(crc);
	}
	for (size_t k = 1; k < kSlices; k++) {
		for (unsigned byte = 0; byte < 256; byte++) {
			const uint16_t before = tables[k - 1][byte];
			tables[k][byte] =
				static_cast<uint16_t>((before << 8) ^ tables[0][before >> 8]);
		}
	}
	return tables;
}

constexpr Tables kTables = make_tables();

// Unstuffs a chunk to `out`, which holds `size` bytes; returns the message's size, or 0 when the
// chunk is the stuffed form of nothing.
size_t unstuff(const uint8_t *chunk, size_t size, uint8_t *out)
{
	size_t at = 0;
	size_t fill = 0;

	if (size < kFull) {
		// No group can be full: the message is the chunk with its codes as zeros.
		std::memcpy(out, chunk + 1, size - 1);
		at = chunk[0];
		while (at < size) {
			const uint8_t code = chunk[at];
			out[at - 1] = 0;
			at += code;
		}
		return at == size ? size - 1 : 0;
	}
	while (at < size) {
		const uint8_t code = chunk[at];
		if (code > size - at) {
			return 0;
		}
		std::memcpy(out + fill, chunk + at + 1, code - 1u);
		fill += code - 1u;
		at += code;
		if (code != kFull && at < size) {
			out[fill++] = 0;
		}
	}
	return fill;
}

template <typename T> uint8_t *put(uint8_t *to, T value)
{
	for (size_t i = 0; i < sizeof(T); i++) {
		to[i] = static_cast<uint8_t>(static_cast<uint64_t>(value) >> (8 * i));
	}
	return to + sizeof(T);
}

size_t row_count(const uint8_t *payload, const Layout &layout)
{
	size_t count = 0;
	for (size_t i = 0; i < layout.count_size; i++) {
		count |= static_cast<size_t>(payload[layout.count_at + i]) << (8 * i);
	}
	return count;
}

// Appends a frame; false when its payload does not have the size of its message.
bool add(Found &found, const Layout &layout, const uint8_t *payload, size_t size, uint16_t seq,
	 int64_t start)
{
	if (size < layout.fixed) {
		return false;
	}
	const size_t count = layout.row ? row_count(payload, layout) : 0;
	if (count > layout.max_count || size != layout.fixed + count * layout.row) {
		return false;
	}
	uint8_t *to = found.records.grow(layout.fixed + sizeof(seq) + sizeof(start));
	if (layout.fixed) {
		std::memcpy(to, payload, layout.fixed);
	}
	put(put(to + layout.fixed, seq), start);
	if (count) {
		to = found.rows.grow(count * (layout.row + sizeof(found.count)));
		for (size_t r = 0; r < count; r++) {
			std::memcpy(to, payload + layout.fixed + r * layout.row, layout.row);
			to = put(to + layout.row, found.count);
		}
	}
	found.count++;
	return true;
}

} // namespace

uint16_t crc16(const uint8_t *data, size_t size)
{
	unsigned crc = kSeed;

	for (; size >= kSlices; size -= kSlices, data += kSlices) {
		crc = kTables[7][data[0] ^ (crc >> 8)] ^ kTables[6][data[1] ^ (crc & 0xFFu)] ^
		      kTables[5][data[2]] ^ kTables[4][data[3]] ^ kTables[3][data[4]] ^
		      kTables[2][data[5]] ^ kTables[1][data[6]] ^ kTables[0][data[7]];
	}
	for (; size; size--, data++) {
		crc = ((crc << 8) & 0xFFFFu) ^ kTables[0][(crc >> 8) ^ *data];
	}
	return static_cast<uint16_t>(crc);
}

Stream take_apart(const uint8_t *data, size_t size, const std::vector<Layout> &layouts)
{
	Stream stream;
	std::array<int, 256> by_type;
	std::array<uint8_t, kChunkLimit> message;
	const uint8_t *const end = data + size;
	const uint8_t *at =
		size ? static_cast<const uint8_t *>(std::memchr(data, 0, size)) : nullptr;

	by_type.fill(-1);
	for (size_t i = 0; i < layouts.size(); i++) {
		by_type[layouts[i].id] = static_cast<int>(i);
	}
	stream.found.resize(layouts.size());
	stream.head_end = at ? at - data : static_cast<int64_t>(size);
	stream.tail_start = static_cast<int64_t>(size);
	while (at) {
		// `at` is at a 00.
		stream.delimiters++;
		const uint8_t *const chunk = at + 1;
		stream.tail_start = chunk - data;
		at = chunk == end ? nullptr
				  : static_cast<const uint8_t *>(std::memchr(
					    chunk, 0, static_cast<size_t>(end - chunk)));
		if (!at || at == chunk) {
			continue;
		}
		const size_t length = static_cast<size_t>(at - chunk);
		const int64_t start = chunk - data;
		stream.start.push_back(start);
		stream.length.push_back(static_cast<int64_t>(length));
		stream.seq.push_back(-1);
		if (length <= kHeaderSize + kCrcSize || length > kChunkLimit) {
			continue;
		}
		const size_t whole = unstuff(chunk, length, message.data());
		if (whole < kHeaderSize + kCrcSize) {
			continue;
		}
		const size_t covered = whole - kCrcSize;
		const uint8_t *const m = message.data();
		if (crc16(m, covered) != (m[covered] | m[covered + 1] << 8)) {
			continue;
		}
		const uint16_t seq = static_cast<uint16_t>(m[1] | m[2] << 8);
		stream.seq.back() = seq;
		const int index = by_type[m[0]];
		if (index < 0) {
			stream.unknown_types++;
		} else if (!add(stream.found[static_cast<size_t>(index)],
				layouts[static_cast<size_t>(index)], m + kHeaderSize,
				covered - kHeaderSize, seq, start)) {
			stream.bad_lengths++;
		}
	}
	return stream;
}

} // namespace hil::wire
